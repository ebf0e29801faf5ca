"""Wide pictures are marked as such: on a phone they scroll by themselves, because their texts would be too small."""

from docutils import nodes
from PIL import Image
from sphinx.application import Sphinx

from .links import DOCS

WIDE = 700  # pixels


def mark_wide_pictures(app: Sphinx, doctree: nodes.document) -> None:
    for node in doctree.findall(nodes.image):
        path = DOCS / node["uri"]
        if path.suffix != ".png" or not path.exists():
            continue
        with Image.open(path) as picture:
            if picture.width > WIDE:
                node["classes"].append("wide")


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("doctree-read", mark_wide_pictures)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
