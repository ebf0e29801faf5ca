"""A small font with the signs that many systems lack, so that a page shows them as they are and asks no network."""

import logging
from pathlib import Path

import matplotlib
from fontTools.subset import Options, Subsetter, load_font, save_font
from sphinx.application import Sphinx

from .links import DOCS

SIGNS = "𝕀"  # the tensor of inertia; the style sheet names the same code point
DEJAVU = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"


def write_font(app: Sphinx) -> None:
    logging.getLogger("fontTools.subset").setLevel(logging.ERROR)  # of each table it says what it does
    options = Options(flavor="woff", layout_features=[], notdef_outline=True)
    font = load_font(str(DEJAVU), options)
    subsetter = Subsetter(options)
    subsetter.populate(text=SIGNS)
    subsetter.subset(font)
    save_font(font, str(DOCS / "made" / "site" / "signs.woff"), options)


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("builder-inited", write_font)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
