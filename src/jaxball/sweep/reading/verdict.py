"""Verdicts on rows. The worse of two is the larger, so that ``np.maximum`` combines them."""

import numpy as np
from jaxtyping import Bool, Int8

GOOD, UNSURE, BAD = np.int8(0), np.int8(1), np.int8(2)
Verdicts = Int8[np.ndarray, "..."]


def verdicts(good: Bool[np.ndarray, "..."], bad: Bool[np.ndarray, "..."] | None = None) -> Verdicts:
    """GOOD where surely good, BAD where surely bad, and UNSURE elsewhere."""
    found = np.where(good, GOOD, UNSURE)
    return found if bad is None else np.where(bad, BAD, found)


def worst(*found: Verdicts) -> Verdicts:
    """The worst verdict on each row."""
    return np.maximum.reduce(found)
