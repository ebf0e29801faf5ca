"""The cards of the gallery: by what kind an entry is listed, and the small picture that stands for it.

The pictures are stored in ``docs/figures/cards``, so that the gallery shows all of them however few of its pages are
made. ``python -m docs.extensions.cards [NAME ...]`` draws them anew, or those of the entries with these names.
"""

import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image, ImageOps

from .links import DOCS
from .scenes import draw_scenario, draw_thumbnail

if TYPE_CHECKING:
    from .gallery import Entry

CARDS = DOCS / "figures" / "cards"
WORDS = CARDS / "words.json"  # what is seen in each
WIDEST, HIGHEST = 480, 320  # pixels, twice those of a card
QUALITY = 70  # of WebP, in which lines are still sharp
LARGEST = 15_000  # bytes

GROUPS = {
    "The paper": ("ball", "disk", "disk-in-ball"),
    "Robots": (
        *("ellipse-and-eight", "spokes", "six-tubes", "moball", "pendulum", "pendulum-and-yoke", "pendulum-on-a-slope"),
        *("axisymmetric-pendulum", "axisymmetric-pendulum-on-a-slope", "gyroscopic-pendulum", "norma", "roboball"),
        *("roboball-2", "rolling-robot", "rotunbot", "three-rotors", "yoke-robot"),
    ),
    "Grounds": (
        *("ball-and-plate", "ball-in-a-bowl", "ball-off-a-sphere", "golfers-dilemma", "jumping-ball", "tilting-plate"),
        *("turntable", "vibrating-plane", "washboard", "wheel-in-a-half-pipe"),
    ),
    "Slip, flight and rest": (
        *("slipping-ball", "stopping-ball", "bouncing-ball", "bowling-ball", "draw-shot", "masse-shot"),
        *("hoop-with-backspin", "hopping-hoop", "tippe-top"),
    ),
    "Classical systems": (
        *("chaplygin-sphere", "chaplygin-top", "routh-sphere", "oblate-ball", "rattleback", "free-rigid-body"),
        *("heavy-top", "suslov", "nonholonomic-particle", "vakonomic-particle", "chaplygin-sleigh"),
    ),
    "Design and control": (
        *("example-designed-rails", "example-designed-robust-rails", "example-compare-robust-rails"),
        *("example-problem-rail-shape", "example-problem-rail-shape-circles", "example-problem-robust-rails"),
        *("example-ball-past-a-post", "example-problem-disk-control", "example-problem-disk-on-top"),
        *("example-problem-disk-tracking", "example-disk-tracking", "example-problem-pendulum-on-a-slope"),
        *("example-six-tubes", "example-figure-eight-held", "example-train-with-skrl"),
    ),
    "Examples in Python": (
        *("example-first-ball", "example-own-rail-and-law", "example-gradient", "example-sweep", "example-balance"),
        *("example-ode-and-dae", "example-two-principles", "example-identification", "example-own-system"),
        *("example-wobble", "example-measured-robot", "example-flipping-ball"),
    ),
}


def write_card(picture: Path, words: str, name: str) -> None:
    """Writes the small picture of an entry, and what is seen in it, from a larger one.

    **Raises:** ``ValueError`` if it is too large for a page with fifty of them.
    """
    CARDS.mkdir(exist_ok=True)
    with Image.open(picture) as large:
        flat = Image.new("RGB", large.size, "white")
        flat.paste(large, mask=large.convert("RGBA").getchannel("A"))
    box = ImageOps.invert(flat).getbbox()
    small = flat.crop(box)
    small.thumbnail((WIDEST, HIGHEST), Image.Resampling.LANCZOS)
    path = CARDS / f"{name}.webp"
    small.save(path, quality=QUALITY, method=6)
    if path.stat().st_size >= LARGEST:
        raise ValueError(f"{path} must be smaller than {LARGEST} bytes, but it has {path.stat().st_size}.")
    described = read_words() | {name: words}
    WORDS.write_text(json.dumps(dict(sorted(described.items())), indent=1, ensure_ascii=False) + "\n")


def read_words() -> dict[str, str]:
    """Reads what is seen in the pictures, by the names of their entries."""
    return json.loads(WORDS.read_text()) if WORDS.exists() else {}


def draw_cards(entries: Sequence["Entry"]) -> None:
    """Draws the pictures of entries that have their own robot."""
    for entry in entries:
        if entry.robot or entry.make is None:
            continue
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder)
            make = draw_thumbnail if entry.make is draw_scenario else entry.make
            make(entry.source, place)
            drawn = place / "thumbnail.png"
            picture = drawn if drawn.exists() else next(iter(sorted(place.glob("*.png"))))
            told = picture.with_suffix(".txt")
            write_card(picture, told.read_text() if told.exists() else entry.pictures[picture.name], entry.name)
        print(f"{entry.name}: {(CARDS / f'{entry.name}.webp').stat().st_size} bytes", flush=True)


if __name__ == "__main__":
    from .gallery import examples, scenarios

    wanted = set(sys.argv[1:])
    draw_cards([entry for entry in [*scenarios(), *examples()] if not wanted or entry.name in wanted])
