"""Wide pictures and wide code are marked as such, for the style sheet.

On a phone such pictures scroll by themselves, because their texts would be too small. Code with long lines has smaller
letters where they make it fit.
"""

from docutils import nodes
from PIL import Image
from sphinx.application import Sphinx

from .links import DOCS

WIDE = 700  # pixels
LONG = 100  # letters of a line, which fit in a column of text at its full width


def mark_wide_pictures(app: Sphinx, doctree: nodes.document) -> None:
    for node in doctree.findall(nodes.image):
        path = DOCS / node["uri"]
        if path.suffix != ".png" or not path.exists():
            continue
        with Image.open(path) as picture:
            if picture.width > WIDE:
                node["classes"].append("wide")


def mark_long_lines(app: Sphinx, doctree: nodes.document) -> None:
    for node in doctree.findall(nodes.literal_block):
        if max(map(len, node.astext().splitlines()), default=0) > LONG:
            node["classes"].append("long-lines")


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("doctree-read", mark_wide_pictures)
    app.connect("doctree-read", mark_long_lines)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
