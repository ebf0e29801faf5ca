"""Views read back: their dictionary as HTML's own rules find it, and its arrays."""

import base64
import html.parser
import json

import numpy as np


class _Reader(html.parser.HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.inside, self.texts = [], None, {}

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self.inside = (tag, dict(attrs).get("id"))

    def handle_endtag(self, tag):
        self.inside = None

    def handle_data(self, data):
        if self.inside:
            self.texts[self.inside] = self.texts.get(self.inside, "") + data


def elements(page):
    """The tags of a page with their attributes in order, and the text in each by its tag and id."""
    reader = _Reader()
    reader.feed(page)
    reader.close()
    return reader.tags, reader.texts


def document_in(page):
    """The dictionary that the program of the page reads."""
    return json.loads(elements(page)[1]["script", "run"])


def unpacked(array):
    """The numbers of an array of the dictionary."""
    values = np.frombuffer(base64.b64decode(array["data"]), dtype=np.dtype(array["type"]).newbyteorder("<"))
    return values.reshape(array["shape"])


def arrays_of(document, body=0):
    """The arrays of a body of the dictionary, by their names."""
    places = document["bodies"][body]["arrays"]
    return {name: unpacked(document["arrays"][place]) for name, place in places.items()}
