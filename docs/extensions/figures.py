"""Wide pictures and wide code are marked as such, for the style sheet.

On a phone such pictures scroll by themselves, because their texts would be too small. Code with long lines has smaller
letters where they make it fit, and else its lines go on below.
"""

from docutils import nodes
from PIL import Image
from sphinx.application import Sphinx

from .links import DOCS

WIDE = 700  # pixels
SHORT = 80  # letters of a line that fit in the column of text on every screen but a phone's
TEN = 10
LONGEST_CLASS = 120  # letters, the length of lines in jaxball


def mark_wide_pictures(app: Sphinx, doctree: nodes.document) -> None:
    for node in doctree.findall(nodes.image):
        path = DOCS / node["uri"]
        if path.suffix != ".png" or not path.exists():
            continue
        with Image.open(path) as picture:
            if picture.width > WIDE:
                node["classes"].append("wide")


def mark_long_lines(app: Sphinx, doctree: nodes.document) -> None:
    """Marks code whose longest line has up to 90 letters, 100, 110, or more; the style sheet has their sizes."""
    for kind in (nodes.literal_block, nodes.doctest_block):
        for node in doctree.findall(kind):
            longest = max(map(len, node.astext().splitlines()), default=0)
            if longest > SHORT:
                node["classes"] += ["long-lines", f"letters-{min(-(-longest // TEN) * TEN, LONGEST_CLASS)}"]


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("doctree-read", mark_wide_pictures)
    app.connect("doctree-read", mark_long_lines)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
