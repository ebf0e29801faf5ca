"""Parts of a study: other axes fixed at a point, and rows left out where there are too many to draw."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Int

from .errors import PictureError
from .rows import Rows

SEED = 0
FEW_PATHS = 2


def fixed(rows: Rows, free: set[int], at: Mapping[str, float] | None) -> tuple[Rows, list[str]]:
    """The rows at one point of each axis that is not in ``free``, and sentences that say which.

    The point is the one whose number is next to that in ``at``; else the middle one of an axis, or the first of a
    scattered one, of those at which a row succeeded.

    **Raises:** :class:`PictureError` when ``at`` has a number that the study does not change, or one of a free axis.
    """
    at = at or {}
    for path in at:
        if rows.axis_of(path) in free:
            raise PictureError(f"Argument `at` must have no number of an axis that is drawn, but it has `{path}`.")
    sentences = []
    for axis in sorted(set(range(rows.indices.shape[1])) - free):
        present = np.unique(rows.indices[:, axis])
        if len(present) == 1:
            continue
        paths = rows.paths_of(axis)
        given = [path for path in paths if path in at]
        if given:
            distances = sum(np.abs(rows.number(path) - at[path]) for path in given)
            chosen = rows.indices[np.argmin(distances), axis]
        else:
            good = np.unique(rows.indices[~rows.failed, axis])
            known = good if good.size else present
            chosen = known[0] if rows.is_scattered(paths[0]) else known[len(known) // 2]
        rows = rows.chosen(rows.indices[:, axis] == chosen)
        if given or len(paths) <= FEW_PATHS:
            sentences += [f"{path} = {rows.number(path)[0]:.4g}" for path in given or paths]
        else:
            sentences.append(f"point {chosen} of {paths[0]}, …")
    return rows, sentences


def sample(rows: Rows, most: int) -> tuple[Int[np.ndarray, " some"], list[str]]:
    """So many of the rows, chosen by a generator with a fixed seed, and a sentence that says so; all of them where
    there are no more. Of those that failed, some are always among them.
    """
    if len(rows) <= most:
        return np.arange(len(rows)), []
    generator, failed = np.random.default_rng(SEED), np.flatnonzero(rows.failed)
    some = generator.choice(failed, min(len(failed), max(1, most // 20)), replace=False)
    others = generator.choice(np.setdiff1d(np.arange(len(rows)), some), most - len(some), replace=False)
    drawn = np.sort(np.concatenate([some, others]))
    return drawn, [f"{len(drawn):,} of {len(rows):,} rows drawn"]
