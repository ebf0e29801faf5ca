"""Describes violations of the rule of ``confinement``: which mass, where and when, and how far it is from the centre.

A force or a ground that would turn a disk out of its plane is reported here too.
"""

import functools
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ... import programs
from ...numerics.arrays import to_array
from ...numerics.calculus import Furthest, furthest
from ...numerics.excursions import first_excursion
from ...numerics.vectors import length
from ...programs.derivatives.differentiation import without_derivatives
from ..conditions import Condition, Problem
from ..dynamics.moments import kinematics
from ..dynamics.parameters import BodyParameters
from ..forces.force import AbstractForce
from ..grounds import AbstractSurface
from ..grounds.ground import Ground
from ..mechanisms import AbstractMechanism
from ..prescribed.motion import AbstractPrescribedMotion, Driven, Fixed, Oscillating, rail_of, schedule_of
from ..prescribed.rails import AbstractRail
from ..prescribed.schedules import Sinusoids
from .confinement import (
    TIME_SAMPLES,
    aside_of,
    beyond_shell,
    is_free_to_leave,
    is_moved_off,
    is_off_plane,
    is_outside,
    leaving_of_mechanisms,
    margin_of_plane,
    margin_of_shell,
    mechanism_positions,
    rail_points,
    rounding,
    time_samples,
)

MOST_SAMPLES = 2**18
SAMPLES_PER_WAVE = 64


IN_PLANE = "lie in the plane of a disk, E1 and E3"


def breaches(
    system: BodyParameters, times: Float[np.ndarray, " T"], theta: Float[np.ndarray, "t driven"] | None
) -> Iterator[Problem]:
    """Yields a problem for everything that is not in the body, from the first of ``times`` to the last; for numbers
    that are known.

    ``theta`` is that of driven masses at the first of ``times``, or at all of them; without it, they are not checked.
    """
    with np.errstate(all="ignore"):
        yield from _breaches(jax.tree.map(np.asarray, system), times, theta)  # NumPy arrays are indexed much faster


def _breaches(
    system: BodyParameters, times: Float[np.ndarray, " T"], theta: Float[np.ndarray, "t driven"] | None
) -> Iterator[Problem]:
    for part, seen in zip(_flat_parts(system), _look_aside(system, times), strict=True):
        yield from part.condition(seen).problems()
    inside = f"inside the shell of radius {float(system.radius):g}"
    for index, item in enumerate(system.point_masses):
        motion, rail = item.motion, rail_of(item.motion)
        if rail is not None:
            yield from _of_rail(system, index, rail, inside)
        if isinstance(motion, Fixed):
            yield from _of_position(system, index, motion, inside)
        elif isinstance(motion, AbstractPrescribedMotion) and is_free_to_leave(motion):
            yield from _of_motion(system, index, motion, inside, times)
        elif isinstance(motion, Driven) and rail is not None and rail.period is None and theta is not None:
            yield from _of_driven(system, index, rail, inside, times, np.asarray(theta))
    for group, order in zip(system.mechanism_groups, system.mechanism_order, strict=True):
        if not group.in_state:
            _, seen = map(np.asarray, _leaving_of_mechanisms(system, group, order, times))
            t = np.asarray(time_samples(jnp.asarray(times)))
            t = np.sort(np.append(t, seen)) if np.isfinite(seen) else t
            yield from _of_mechanisms(system, group, order, inside, t, np.zeros((len(t), len(system.coordinates))))
        elif theta is not None:
            yield from _of_mechanisms(system, group, order, inside, times[: len(theta)], np.asarray(theta))


def _of_position(system: BodyParameters, index: int, motion: Fixed, inside: str) -> Iterator[Problem]:
    if is_outside(system, length(np.asarray(motion.position))):
        yield Problem(f"masses[{index}].motion.position", f"be a point {inside}", f"it is {motion.position.tolist()}")
    if is_off_plane(system, motion.position):
        yield Problem(f"masses[{index}].motion.position", IN_PLANE, f"it passes {motion.position.tolist()}")


def _of_rail(system: BodyParameters, index: int, rail: AbstractRail, inside: str) -> Iterator[Problem]:
    if system.planar:
        yield from _out_of_plane(
            system, f"masses[{index}].motion.rail", np.asarray(compute_points(rail, system.radius))
        )
    if rail.period is None:
        return
    theta, distance = map(np.asarray, compute_furthest(rail))
    if is_outside(system, distance):
        (exactly,) = length(np.asarray(_points(rail, theta[None])))
        where = f"{exactly:.6g} from the centre at theta = {theta % rail.period:.6g}"
        yield Problem(f"masses[{index}].motion.rail", f"be a curve {inside}", f"it is {where}")


def _of_motion(
    system: BodyParameters, index: int, motion: AbstractPrescribedMotion, inside: str, times: Float[np.ndarray, " T"]
) -> Iterator[Problem]:
    name = f"masses[{index}].motion" + (".schedule" if schedule_of(motion) is not None else "")
    t = _fine_times(motion, times)
    chi, top, leaving, aside = jax.tree.map(np.asarray, _sample_path(system, motion, jnp.asarray(t)))
    yield from _out_of_plane(system, name, chi if np.isinf(aside.seen) else np.vstack([chi, aside.chi]))
    if leaving.begin == t[0]:
        time, distance = t[0], length(chi[0])
        yield Problem(name, f"keep the mass {inside}", f"it is {distance:.6g} from the centre at t = {time:.6g}")
    elif np.isfinite(leaving.begin):
        distance, time = max((top.distance, top.x), (length(leaving.chi), leaving.seen))
        yield Problem(
            name,
            f"keep the mass {inside} from t = {times[0]:g} to t = {times[-1]:g}",
            f"the mass leaves it at t = {leaving.begin:.6g}, and is {distance:.6g} from the centre at t = {time:.6g}",
        )


def _of_driven(
    system: BodyParameters,
    index: int,
    rail: AbstractRail,
    inside: str,
    times: Float[np.ndarray, " T"],
    theta: Float[np.ndarray, "t driven"],
) -> Iterator[Problem]:
    distances = length(np.asarray(_points(rail, theta[:, system.driven.index(index)])))
    outside = np.flatnonzero(is_outside(system, distances))
    if not outside.size:
        return
    k = int(outside[0])
    if k == 0:
        which = f"puts mass {index} at the distance {distances[0]:.6g} from the centre"
        but = f"it is {theta[0].tolist()}, which {which}"
        yield Problem("state.theta", f"be angles at which each mass is {inside}", but)
    else:
        but = f"the mass is {distances[k]:.6g} from the centre at t = {times[k]:.6g}"
        yield Problem("law", f"keep mass {index} {inside}", but)


def _of_mechanisms(
    system: BodyParameters,
    group: AbstractMechanism,
    order: tuple[int, ...],
    inside: str,
    times: Float[np.ndarray, " T"],
    theta: Float[np.ndarray, "T coordinates"],
) -> Iterator[Problem]:
    chi = np.asarray(_places_of_mechanisms(system, group, order, times, theta))
    outside = is_outside(system, length(chi))
    aside = (
        np.asarray(_is_moved_off(system, group, order, times[0], theta[0])) if system.planar else len(order) * [False]
    )
    for k, index in enumerate(order):
        if aside[k]:
            must = "move its masses in the plane of a disk, with hinges about E2"
            yield Problem(f"mechanisms[{index}]", must, "a joint of it pushes one aside")
        yield from _out_of_plane(system, f"mechanisms[{index}]", chi[:, k].reshape(-1, 3))
        when = np.flatnonzero(np.any(outside[:, k], axis=1))
        if when.size:
            first = int(when[0])
            mass = int(np.flatnonzero(outside[first, k])[0])
            distance = f"{length(chi[first, k, mass]):.6g} from the centre at t = {times[first]:.6g}"
            must = f"keep its masses {inside}, with end stops if need be"
            yield Problem(f"mechanisms[{index}]", must, f"mass {mass} of it is {distance}")


def _out_of_plane(system: BodyParameters, name: str, chi: Float[np.ndarray, "n 3"]) -> Iterator[Problem]:
    if np.any(is_off_plane(system, chi)):
        worst = chi[int(np.nanargmax(np.abs(chi[:, 1])))]
        yield Problem(name, IN_PLANE, f"it passes {[round(x, 6) for x in worst.tolist()]}")


def _fine_times(motion: AbstractPrescribedMotion, times: Float[np.ndarray, " T"]) -> Float[np.ndarray, " n"]:
    """Returns times fine enough for the fastest sinusoid; their number is one of few, for which programs are
    compiled.
    """
    start, end = float(times[0]), float(times[-1])
    waves = motion.path if isinstance(motion, Oscillating) else getattr(motion, "schedule", None)
    series = waves.series if isinstance(waves, Sinusoids) else waves
    fastest = float(np.max(np.abs(getattr(series, "frequency", np.zeros(1))), initial=0.0))
    sample_count = max(16 * TIME_SAMPLES, SAMPLES_PER_WAVE * fastest * (end - start) / (2 * np.pi))
    return np.linspace(start, end, int(2 ** np.ceil(np.log2(min(sample_count, MOST_SAMPLES)))) + 1)


@programs.filter_jit
def compute_furthest(rail: AbstractRail) -> Furthest:
    """Computes where a closed rail is furthest from the centre, compiled once for a family."""
    return rail.prepare().furthest()


@programs.filter_jit
def compute_points(rail: AbstractRail, radius: Float[ArrayLike, ""]) -> Float[Array, "n 3"]:
    """Computes where a disk's rail must be in its plane, compiled once for a family."""
    return rail_points(rail.prepare(), jnp.asarray(radius))


@programs.filter_jit
def _points(rail: AbstractRail, theta):
    return rail.points(theta)


@programs.filter_jit
def _is_moved_off(system: BodyParameters, group: AbstractMechanism, order, t, theta):
    prepared = eqx.filter_vmap(lambda mechanism: mechanism.prepare())(group)
    return is_moved_off(system, prepared, order, to_array(t), to_array(theta))


@programs.filter_jit
def _places_of_mechanisms(system: BodyParameters, group: AbstractMechanism, order, times, theta):
    prepared = eqx.filter_vmap(lambda mechanism: mechanism.prepare())(group)
    return mechanism_positions(system, prepared, order, to_array(times), to_array(theta))


class _Out(NamedTuple):
    """When a mass is first beyond its bounds, a time soon after that when it is, and χ then."""

    begin: Float[Array, ""]
    seen: Float[Array, ""]
    chi: Float[Array, "3"]


@programs.filter_jit
def _sample_path(system: BodyParameters, motion: Any, t: Float[Array, " n"]):
    """Samples the path of a mass at evenly spaced times, and finds where it is furthest from the centre, and when it
    leaves the shell and a disk's plane.
    """
    prepared = motion.prepare()

    def within(x: Float[Array, ""]) -> Float[Array, ""]:
        return jnp.clip(x, t[0], t[-1])

    def find(excess: Callable[[Array], Array], margin: Array) -> _Out:
        out = first_excursion(lambda x: excess(prepared(x)[None]), margin, t, jnp.ravel(motion.kinks()))
        return _Out(*out, prepared(within(out.seen)))

    chi = jax.vmap(prepared)(t)
    top = furthest(lambda x: prepared(within(x)), t, chi)
    left = find(functools.partial(beyond_shell, system), margin_of_shell(system))
    return chi, top._replace(x=within(top.x)), left, find(aside_of, margin_of_plane(system))


@programs.filter_jit
def _leaving_of_mechanisms(system: BodyParameters, group: AbstractMechanism, order, times):
    prepared = eqx.filter_vmap(lambda mechanism: mechanism.prepare())(group)
    kinks = jnp.ravel(eqx.filter_vmap(lambda mechanism: mechanism.motion_kinks())(group))
    return leaving_of_mechanisms(system, prepared, order, to_array(times), kinks)


class _Flat(NamedTuple):
    """What must be in the plane of a disk: its name, what it must be, k vectors as a function of time whose second
    entries must be 0, relative to a ``size`` or to the largest entry, and the times of its kinks.
    """

    name: str
    must: str
    vectors: Callable[[Float[Array, ""]], Float[Array, "k 3"]]
    kinks: Callable[[], Float[Array, " kinks"]]
    size: Float[Array, ""] | None = None

    def look(self, times: Float[Array, " T"]) -> Float[Array, "n k 3"]:
        """Computes the vectors at evenly spaced times, and at one at which they are first aside, if they ever are.

        What is aside for as long as a bell exp(−(t/w)²) with w 1/1000 of the run is seen, and between kinks anything.
        """
        even = time_samples(times)
        largest = jnp.max(jnp.abs(jax.vmap(self.vectors)(even))) if self.size is None else self.size

        def share_aside(t: Float[Array, ""]) -> Float[Array, " k"]:
            squares = self.vectors(t) ** 2
            # Where all samples are 0, a vector is compared with itself.
            of_all = jnp.sum(squares, axis=1) if self.size is None else 0.0
            return squares[:, 1] / (of_all + largest**2 + jnp.sqrt(jnp.finfo(t.dtype).tiny))

        margin = jnp.asarray(rounding(times) ** 2, times.dtype)
        seen = first_excursion(share_aside, margin, times, self.kinks()).seen
        return jax.vmap(self.vectors)(jnp.append(even, jnp.where(jnp.isfinite(seen), seen, times[0])))

    def condition(self, seen: Float[Array, "n k 3"]) -> Condition:
        """Returns the condition on vectors that :meth:`look` returned."""
        seen = seen.reshape(-1, 3)
        aside = jnp.abs(seen[:, 1])
        largest = jnp.max(jnp.abs(seen)) if self.size is None else self.size
        worst = seen[jnp.argmax(aside)] if self.size is None else jnp.max(aside)
        return Condition(~(jnp.max(aside) > rounding(seen) * largest), self.name, worst, self.must)


def _flat_parts(system: BodyParameters) -> Iterator[_Flat]:
    """Yields a disk's force and the motion of its ground."""
    motion = system.ground.motion if isinstance(system.ground, Ground) else None
    force = system.force if isinstance(system.force, AbstractForce) else None
    frame = system.ground.motion if isinstance(system.ground, AbstractSurface) else None
    must = "in the plane of a disk, E1 and E3, at all times"
    for name, vector in (("force", force), ("ground.motion", motion)):
        if system.planar and vector is not None:
            yield _Flat(name, must, lambda t, vector=vector: vector(t)[None], vector.kinks)
    if system.planar and frame is not None:
        corners = system.radius * jnp.asarray(((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
        must = "one that keeps the plane of a disk, e1 and e3, where it is"
        place = lambda t: jax.vmap(lambda x: frame.place(t, x))(corners)  # noqa: E731
        yield _Flat("ground.motion", must, place, frame.kinks, system.radius)


def in_plane(system: BodyParameters, times: Float[Array, " T"]) -> Iterator[Condition]:
    """Yields the conditions on a disk's force and on the motion of its ground between all of ``times``; traceable,
    without derivatives.
    """
    system, times = without_derivatives((system, times))
    for part in _flat_parts(system):
        yield part.condition(part.look(times))


@programs.filter_jit
def _look_aside(system: BodyParameters, times) -> list[Float[Array, "n k 3"]]:
    return [part.look(to_array(times)) for part in _flat_parts(system)]


def wild_masses(system: Any, t: float, state: Any) -> Iterator[Problem]:
    """Finds the masses whose positions or velocities are not finite at the start."""
    places, rates = jax.tree.map(np.asarray, _at_start(system, state, t))
    names = [f"masses[{index}].motion" for index in range(system.n_masses)]
    for index, mechanism in enumerate(system.mechanisms):
        names += [f"mechanisms[{index}]"] * mechanism.mass.shape[-1]
    for index in np.flatnonzero(~np.all(np.isfinite(places) & np.isfinite(rates), axis=1)):
        description = f"it gives {places[index].tolist()} and {rates[index].tolist()}"
        yield Problem(names[index], f"give a finite position and a finite velocity at t = {t:g}", description)


@programs.filter_jit
def _at_start(system: Any, state: Any, t: Float[ArrayLike, ""]):
    """Computes the positions and velocities of the masses."""
    masses = kinematics(system.prepare(), jnp.asarray(t, system.mass.dtype), (state.theta, state.thetadot, state.theta))
    return masses.chi, masses.chidot
