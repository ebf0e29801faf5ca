"""Whether rails and masses stay inside the shell, in many rows: certain where bounds tell, in doubt elsewhere."""

import functools
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from ...motion import AbstractMotion, Driven, Fixed, OnRail, Oscillating
from ...rails import AbstractPlanarRail, AbstractRail, Tube
from ...scenario.shell import FLAT, reach
from .furthest import furthest, reach_of_series
from .reach import Stacked, bounds, distance, farthest_sample, matrices
from .verdict import GOOD, UNSURE, Verdicts, verdicts, worst

ROUNDING = 1e-9
# Parabolas through samples of a distance rise above the samples by an eighth of the largest of them or less.
RISE = 1.125


class Shell(NamedTuple):
    """The shells of the rows and the spans of time, shape (rows, 1) each, and whether any of them change."""

    radius: Float[np.ndarray, "rows 1"]
    start: Float[np.ndarray, "rows 1"]
    end: Float[np.ndarray, "rows 1"]
    radius_changes: bool
    span_changes: bool
    disk: bool


def stay_inside(system: Any, changes: Any, shell: Shell) -> Verdicts:
    """The verdicts on all masses of ``system``. ``changes`` says of each leaf whether it does."""
    found = [np.full(len(shell.radius), GOOD)]
    for group, change in zip(system.groups, changes.groups, strict=True):
        stacked = _motion(group.motion, change.motion, shell)
        found.append(np.max(np.broadcast_to(stacked, (len(shell.radius), *stacked.shape[1:])), axis=1))
    return worst(*found)


def start_inside(system: Any, theta: Float[np.ndarray, "rows driven"]) -> Verdicts:
    """The verdicts on the places at which driven masses start."""
    found = [np.full(len(theta), GOOD)]
    for group, indices in zip(system.groups, system.order, strict=True):
        for k, index in enumerate(indices if isinstance(group.motion, Driven) else ()):
            rail = jax.tree.map(lambda leaf, k=k: leaf[:, k], group.motion.rail)
            angle = theta[:, system.driven.index(index)]
            far, rounding = distance(rail, angle), ROUNDING * (1 + np.abs(angle))
            found.append(verdicts(far < system.radius * (1 - rounding), far > system.radius * (1 + rounding)))
    return worst(*found)


def _any(changes: Any) -> bool:
    return any(jax.tree.leaves(changes))


@functools.singledispatch
def _motion(motion: AbstractMotion, changes: Any, shell: Shell) -> np.ndarray:
    """The verdicts on the motions of a group, shape (rows or 1, masses)."""
    return np.full((1, 1), UNSURE)


@_motion.register
def _(motion: Fixed, changes: Any, shell: Shell) -> np.ndarray:
    if not (_any(changes) or shell.radius_changes):
        return np.full((1, 1), GOOD)
    far = np.sqrt(np.sum(np.square(motion.position), axis=-1))
    good, bad = far < shell.radius * (1 - ROUNDING), far > shell.radius * (1 + ROUNDING)
    if shell.disk:
        aside = np.abs(motion.position[..., 1])
        good &= aside <= FLAT * shell.radius
    return verdicts(good, bad)


@_motion.register
def _(motion: Oscillating, changes: Any, shell: Shell) -> np.ndarray:
    if not (_any(changes) or shell.radius_changes or shell.span_changes):
        return np.full((1, 1), GOOD)
    far, aside = reach_of_series(motion.path)
    return verdicts((far * RISE < shell.radius) & _flat(aside, shell))


@_motion.register
def _(motion: Driven, changes: Any, shell: Shell) -> np.ndarray:
    return _rail(motion.rail, changes.rail, shell)


@_motion.register
def _(motion: OnRail, changes: Any, shell: Shell) -> np.ndarray:
    on_rail = _rail(motion.rail, changes.rail, shell)
    if motion.rail.period is not None or not (_any(changes) or shell.radius_changes or shell.span_changes):
        return on_rail
    angle = furthest(motion.schedule, shell.start, shell.end)
    if not isinstance(motion.rail, Tube) or angle is None:
        return np.full((1, 1), UNSURE)
    direction, centre = motion.rail.direction, motion.rail.centre
    unit = np.abs(direction) / np.sqrt(np.sum(np.square(direction), axis=-1, keepdims=True))
    far = np.sqrt(np.sum(np.square(np.abs(centre) + angle[..., None] * unit), axis=-1))
    aside = np.abs(centre[..., 1]) + angle * unit[..., 1]
    return np.maximum(on_rail, verdicts((far * RISE < shell.radius) & _flat(aside, shell)))


def _rail(rail: AbstractRail, changes: Any, shell: Shell) -> np.ndarray:
    if rail.period is None:
        return _open_rail(rail, changes, shell)
    if not _any(changes):
        return _same_rails(rail, shell) if shell.radius_changes else np.full((1, 1), GOOD)
    found = bounds(rail, _same_frames(rail, changes))
    good = np.full((len(shell.radius), 1), False)
    if found is not None:
        good = (found.far < shell.radius * (1 - ROUNDING)) & _flat(found.aside, shell)
    bad, doubtful = np.zeros_like(good), np.flatnonzero(~np.all(good, axis=1))
    if doubtful.size:
        some = jax.tree.map(lambda leaf: leaf[doubtful], rail)
        sampled: Stacked = farthest_sample(some)
        bad = np.full((len(good), sampled.shape[1]), False)
        bad[doubtful] = sampled > shell.radius[doubtful] * (1 + ROUNDING)
    return verdicts(good, bad)


def _same_frames(rail: AbstractRail, changes: Any) -> Float[np.ndarray, "1 masses 3 3"] | None:
    """The matrices of frames that are the same in all rows."""
    if not isinstance(rail, AbstractPlanarRail) or _any(changes.frame):
        return None
    return matrices(jax.tree.map(lambda leaf: leaf[:1], rail.frame))


def _open_rail(rail: AbstractRail, changes: Any, shell: Shell) -> np.ndarray:
    """Only its direction matters, and that to a disk alone; the motion along it is another matter."""
    if not shell.disk or not (_any(changes) or shell.radius_changes):
        return np.full((1, 1), GOOD)
    if not isinstance(rail, Tube):
        return np.full((1, 1), UNSURE)
    return verdicts((rail.direction[..., 1] == 0) & (rail.centre[..., 1] == 0))


def _same_rails(rail: AbstractRail, shell: Shell) -> np.ndarray:
    """Rails that are the same in all rows, by what the check itself finds."""
    count = len(jax.tree.leaves(rail)[0][0])
    found = []
    for k in range(count):
        one = jax.tree.map(lambda leaf, k=k: leaf[0, k], rail)
        _, points, far = reach(one, 0.0)
        bad = ~(np.max(far) < shell.radius[:, 0])
        if shell.disk:
            bad |= np.max(np.abs(points[:, 1])) > FLAT * shell.radius[:, 0]
        found.append(verdicts(~bad, bad))
    return np.stack(found, axis=1)


def _flat(aside: Stacked, shell: Shell) -> Bool[np.ndarray, "_ _"]:
    """Whether masses surely stay in the plane of a disk."""
    return aside < FLAT / 2 * shell.radius if shell.disk else np.full_like(aside, True, dtype=bool)
