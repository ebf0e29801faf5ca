"""Whether rails and masses stay inside the shell, in many rows: certain where bounds tell, in doubt elsewhere."""

import functools
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from ...physics.breaches import known_furthest, known_points
from ...physics.confinement import rounding
from ...physics.motion import AbstractMotion, Driven, Fixed, OnRail, Oscillating
from ...physics.rails import AbstractPlanarRail, AbstractRail, Tube
from .furthest import furthest, reach_of_series
from .reach import Stacked, bounds, distance, farthest_sample, matrices
from .verdict import GOOD, UNSURE, Verdicts, verdicts, worst

# What is within the shell as computed here is within by the rule, and what is outside by twice what the rule allows for
# rounding is outside, though frames are orthonormal to 1e-9, and tubes' angles, to this size, have fewer digits.
ROUNDING = rounding(np.zeros(()))
OUTSIDE = 1 + 2 * ROUNDING
LARGEST_ANGLE = 1e6


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
            far, near = distance(rail, angle), np.abs(angle) < LARGEST_ANGLE * system.radius
            found.append(verdicts(near & (far <= system.radius), near & (far > system.radius * OUTSIDE)))
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
    return verdicts((far <= shell.radius) & _flat(np.abs(motion.position[..., 1]), shell), far > shell.radius * OUTSIDE)


@_motion.register
def _(motion: Oscillating, changes: Any, shell: Shell) -> np.ndarray:
    if not (_any(changes) or shell.radius_changes or shell.span_changes):
        return np.full((1, 1), GOOD)
    far, aside = reach_of_series(motion.path, shell.start, shell.end)
    return verdicts((far <= shell.radius) & _flat(aside, shell))


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
    return np.maximum(on_rail, verdicts((far <= shell.radius) & _flat(aside, shell)))


def _rail(rail: AbstractRail, changes: Any, shell: Shell) -> np.ndarray:
    if rail.period is None:
        return _open_rail(rail, changes, shell)
    if not _any(changes):
        return _same_rails(rail, shell) if shell.radius_changes else np.full((1, 1), GOOD)
    rows, masses = jax.tree.leaves(rail)[0].shape[:2]
    found, good = bounds(rail, _same_frames(rail, changes)), np.full((rows, masses), False)
    if found is not None:
        good |= (found.far <= shell.radius) & _flat(found.aside, shell)
    bad, doubtful = np.zeros_like(good), np.flatnonzero(~np.all(good, axis=1))
    if doubtful.size:
        sampled = farthest_sample(jax.tree.map(lambda leaf: leaf[doubtful], rail))
        bad[doubtful] = sampled > shell.radius[doubtful] * OUTSIDE
    for row, mass in np.argwhere(~good & ~bad & ~np.any(bad, axis=1, keepdims=True)):
        one = jax.tree.map(lambda leaf, at=(row, mass): leaf[at], rail)
        bad[row, mass] = _out(one, shell.radius[row], shell.disk)[0]
    return verdicts(~bad, bad)


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
    return verdicts(np.asarray((rail.direction[..., 1] == 0) & (rail.centre[..., 1] == 0)))


def _same_rails(rail: AbstractRail, shell: Shell) -> np.ndarray:
    """Rails that are the same in all rows, by what the check itself finds."""
    masses = jax.tree.leaves(rail)[0].shape[1]
    rails = [jax.tree.map(lambda leaf, k=k: leaf[0, k], rail) for k in range(masses)]
    bad = np.stack([_out(one, shell.radius[:, 0], shell.disk) for one in rails], axis=1)
    return verdicts(~bad, bad)


def _out(rail: AbstractRail, radius: Float[np.ndarray, " radii"], disk: bool) -> Bool[np.ndarray, " radii"]:
    """Whether a closed rail leaves shells of several radii, or the plane of a disk, by what the check itself finds."""
    far = np.asarray(known_furthest(rail).distance)
    bad = far > radius * (1 + ROUNDING)
    return bad | (np.max(np.abs(known_points(rail, radius[0])[:, 1])) > ROUNDING * radius) if disk else bad


def _flat(aside: Stacked, shell: Shell) -> Bool[np.ndarray, "_ _"]:
    """Whether masses surely stay in the plane of a disk."""
    return aside < ROUNDING / 2 * shell.radius if shell.disk else np.full_like(aside, True, dtype=bool)
