"""The save times of many rows."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ...scenario.times import MOST_SAVES
from .columns import Columns
from .verdict import GOOD, Verdicts, verdicts

# Rounding moves an equally spaced time by no more than a few units in the last place of the larger end.
_ROUNDING = 16 * float(np.finfo(float).eps)


class Spans(NamedTuple):
    """When each row starts and ends, how many save times it has, and whether it can have them."""

    start: Float[np.ndarray, " rows"]
    end: Float[np.ndarray, " rows"]
    counts: Int[np.ndarray, " rows"]
    verdict: Verdicts


def spans(columns: Columns) -> Spans:
    """The spans of the rows, by the rules of the table ``time``."""
    table = columns.document["time"]
    if "at" in table:
        at = columns.at("time.at")
        return Spans(at[:, 0], at[:, -1], np.full(len(at), at.shape[1]), np.full(len(at), GOOD))
    start, end = columns.at("time.start"), columns.at("time.end")
    long, bad = end - start, ~(end > start)
    if "saves" in table:
        count = np.full(columns.rows, table["saves"])
        clear = long / (count - 1) > _ROUNDING * (np.abs(start) + np.abs(end))
        return Spans(start, end, count, verdicts(clear & np.isfinite(long), bad))
    intervals = long / columns.at("time.step")
    whole = np.rint(intervals)
    bad |= (intervals > MOST_SAVES) | (whole < 1) | (np.abs(intervals - whole) > 1e-9 * intervals)
    count = np.where(bad, 1, whole).astype(int) + 1
    return Spans(start, end, count, verdicts(~bad, bad))


def save_times(columns: Columns, found: Spans, rows: Int[np.ndarray, " some"], count: int) -> np.ndarray:
    """The ``count`` save times of some rows, shape (some, count)."""
    if "at" in columns.document["time"]:
        return columns.at("time.at")[rows]
    return np.ascontiguousarray(np.linspace(found.start[rows], found.end[rows], count, axis=-1))
