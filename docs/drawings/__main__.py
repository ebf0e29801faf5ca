"""Draws the sketches of the pages: ``python docs/drawings [FOLDER]``, by default into ``docs/figures``."""

import sys
from pathlib import Path

import ground
import modes
import notation
import rooms

FIGURES = Path(__file__).parents[1] / "figures"


def main(folder: Path = FIGURES) -> None:
    for name, sketch in [("notation", notation), ("ground", ground), ("modes", modes), ("rooms", rooms)]:
        sketch.draw().savefig(folder / f"{name}.png", dpi=170)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
