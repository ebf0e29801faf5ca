"""Whether the numbers of schedules and frames fit each other, in many rows."""

import functools
from typing import Any

import jax
import numpy as np

from ...physics.frames import AbstractFrame, MatrixFrame, SphericalFrame, VersorFrame
from ...physics.schedules import AbstractSchedule, ConstantRate, PiecewiseAcceleration, Pulse, Sinusoids, Waypoints
from ...scenario.frames import ORTHONORMAL
from .verdict import GOOD, UNSURE, Verdicts, verdicts, worst

# Kinds whose numbers need not fit each other, but for how many there are.
_FREE = (ConstantRate, PiecewiseAcceleration, Sinusoids, Waypoints, SphericalFrame, VersorFrame)


def parts_fit(system: Any, changes: Any, rows: int) -> Verdicts:
    """The verdicts on the schedules and the frames of a stacked system; those that are the same in all rows fit."""
    found = [np.full(rows, GOOD)]
    for part, change in zip(_parts(system), _parts(changes), strict=True):
        if any(jax.tree.leaves(change)):
            verdict = _fits(part)
            found.append(np.max(np.broadcast_to(verdict, (rows, *verdict.shape[1:])).reshape(rows, -1), axis=1))
    return worst(*found)


def _parts(tree: Any) -> list[Any]:
    kinds = (AbstractSchedule, AbstractFrame)
    return [item for item in jax.tree.leaves(tree, is_leaf=lambda x: isinstance(x, kinds)) if isinstance(item, kinds)]


@functools.singledispatch
def _fits(part: Any) -> np.ndarray:
    return np.full(1, GOOD if isinstance(part, _FREE) else UNSURE)


@_fits.register
def _(part: Pulse) -> np.ndarray:
    start, hold, end = map(np.asarray, (part.start, part.hold, part.end))
    bad = (hold < start) | (end <= hold)
    return verdicts(~bad, bad)


@_fits.register
def _(part: MatrixFrame) -> np.ndarray:
    B = np.asarray(part.B)
    excess = np.einsum("...ki,...kj->...ij", B, B) - np.eye(3)
    good = (np.max(np.abs(excess), axis=(-2, -1)) < ORTHONORMAL / 2) & (np.linalg.det(B) > 0.5)
    return verdicts(good)
