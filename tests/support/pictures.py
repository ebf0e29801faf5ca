"""Pictures compared with one another."""

from pathlib import Path

import numpy as np
from PIL import Image


def coarse(path: Path) -> np.ndarray:
    """A picture in squares of six pixels: a line may be one off, as after a search, whose end depends on rounding."""
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB").reduce(6), dtype=float)
