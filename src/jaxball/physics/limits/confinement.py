"""Whether the masses stay in the body: inside the shell, and those of a disk in its plane.

The rule. A closed rail must lie in the body as a whole, wherever on it the mass goes. On an open rail, and in free
motion, it is the mass that must stay, as long as a run lasts, and so must those of mechanisms. A mass on the shell
counts as inside. A position that is not finite is not counted as outside. When a mass leaves is known from its motion,
where that is prescribed, by a search between all times, and else from the states, by ``clearance``, which a solve
watches in every step. Hinges are watched where they are known to be long enough, because others cost a run time.

All of it can be traced; it has no derivatives. Bounds on how far masses get, from the centre and out of a disk's plane,
are cheaper than the search, which is left out where they settle it.
"""

import functools
import itertools
from collections.abc import Callable
from typing import Any, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...interface.compat import is_traced
from ...numerics.arrays import AnyArray, namespace_of
from ...numerics.excursions import Excursion, first_excursion
from ...numerics.functions import HarmonicSeries
from ...numerics.vectors import length
from ...programs.derivatives.differentiation import without_derivatives
from ..dynamics.parameters import BodyParameters
from ..mechanisms import AbstractMechanism, Hinge, Mechanism
from ..prescribed.motion import AbstractMotion, AbstractPrescribedMotion, Driven, Fixed, OnRail, Oscillating, rail_of
from ..prescribed.rails import AbstractRail, Tube
from ..prescribed.schedules import AbstractSchedule, ConstantRate, Pulse, Sinusoids
from ..state import State
from ..system import AbstractSystem

TIME_SAMPLES = 256
LARGEST_PHASE = 1e6  # to which ``sine_cosine`` is good
Time = Float[Array, ""]


def rounding(x: Array | np.ndarray) -> float:
    """Returns how far rounding may put a mass beyond the shell or off a disk's plane, relative to the radius."""
    return float(np.sqrt(np.finfo(x.dtype).eps))


def is_outside(system: BodyParameters, distance: Float[AnyArray, "*batch"]) -> Any:
    """Returns whether something at this distance from the centre is outside the shell."""
    return distance > system.radius * (1 + rounding(system.radius))


def is_off_plane(system: BodyParameters, chi: Float[AnyArray, "*batch 3"]) -> Any:
    """Returns whether a point is outside the plane of a disk, E1 and E3; never for a ball."""
    aside = abs(chi[..., 1]) > system.radius * rounding(system.radius)
    return aside if system.planar else namespace_of(aside).zeros_like(aside)


def is_bounded(motion: AbstractMotion) -> bool:
    """Returns whether a mass that moves like this stays on a closed rail, or in its place."""
    rail = rail_of(motion)
    return isinstance(motion, Fixed) or (rail is not None and rail.period is not None)


def rail_points(rail: AbstractRail, radius: Float[Array, ""]) -> Float[Array, "n 3"]:
    """Returns the points at which a disk's rail must be in its plane: all round a closed one, and along an open one
    from 0 to ``radius``.
    """
    end = radius if rail.period is None else jnp.asarray(rail.period, radius.dtype)
    return jax.vmap(rail)(jnp.linspace(0.0, end, rail.samples))


def time_samples(times: Float[Array, " T"]) -> Float[Array, " n"]:
    """Returns the times at which a motion is checked between the first and the last of ``times``."""
    return jnp.linspace(times[0], times[-1], TIME_SAMPLES + 1)


def is_confined(
    system: BodyParameters, times: Float[Array, " T"], state: State, kinks: Float[Array, " kinks"]
) -> Bool[Array, ""]:
    """Returns whether rails are in the body, and masses at the first of ``times``; a disk's prescribed motions at all
    times.

    ``system`` is prepared; ``kinks`` are those of its prescribed motions.
    """
    system, times, state, kinks = without_derivatives((system, times, state, kinks))
    astray = jnp.asarray(False)
    for group, places in _groups(system):
        rail = rail_of(group.motion)
        if rail is not None and rail.period is not None:
            distances = eqx.filter_vmap(lambda rail: rail.furthest())(rail).distance
            astray |= jnp.any(is_outside(system, distances))
        if rail is not None and system.planar:
            points = eqx.filter_vmap(rail_points, in_axes=(eqx.if_array(0), None))(rail, system.radius)
            astray |= jnp.any(is_off_plane(system, points))
        if rail is None or rail.period is None:
            chi = _positions(group.motion, times[:1], state.theta[None, places])
            astray |= jnp.any(is_outside(system, norm(chi)) | is_off_plane(system, chi))
    for group, order in zip(system.mechanism_groups, system.mechanism_order, strict=True):
        chi = mechanism_positions(system, group, order, times[:1], state.theta[None])
        astray |= jnp.any(is_outside(system, norm(chi)) | is_off_plane(system, chi))
        if system.planar:
            astray |= jnp.any(is_moved_off(system, group, order, times[0], state.theta))
    if system.planar:
        astray |= jnp.isfinite(first_out(system, times, kinks, aside_of, margin_of_plane(system)))
    return ~astray


def time_of_leaving(
    system: BodyParameters, times: Float[Array, " T"], theta: Float[Array, "T driven"], kinks: Float[Array, " kinks"]
) -> Float[Array, ""]:
    """Finds the first time at which a mass is outside the shell; infinite where none is.

    A mass whose motion is prescribed, by itself or by the joints of a mechanism, is looked at between all of ``times``,
    and the time found to rounding; one that swings on free hinges is checked at ``times``, for bodies of which it is
    not known whether it :func:`may_swing_out`. Masses whose :func:`clearance` tells are left out. ``system`` is
    prepared; ``kinks`` are those of its prescribed motions.
    """
    system, times, theta, kinks = without_derivatives((system, times, theta, kinks))
    beyond = functools.partial(beyond_shell, system)
    first = first_out(system, times, kinks, beyond, margin_of_shell(system))
    for group, order in zip(system.mechanism_groups, system.mechanism_order, strict=True):
        if not group.in_state:
            left = leaving_of_mechanisms(system, group, order, times, kinks).begin
            first = jnp.minimum(first, left)
        elif not _slides(group):
            chi = mechanism_positions(system, group, order, times, theta)
            outside = jnp.any(is_outside(system, norm(chi)), axis=(1, 2))
            first = jnp.minimum(first, jnp.min(jnp.where(outside, times, jnp.inf)))
    return first


def first_out(
    system: BodyParameters,
    times: Float[Array, " T"],
    kinks: Float[Array, " kinks"],
    excess: Callable[[Float[Array, "masses 3"]], Float[Array, " masses"]],
    margin: Float[Array, ""],
) -> Float[Array, ""]:
    """Finds when a mass in prescribed motion is first beyond its bounds: where ``excess`` of its χ rises above
    zero, if it gets above the ``margin``, which is more than rounding.
    """
    never = jnp.asarray(jnp.inf, system.radius.dtype)
    paths = [path_of(group.motion) for group in system.groups if is_free_to_leave(group.motion)]
    if not paths:
        return never

    def search() -> Time:
        return first_excursion(
            lambda t: jnp.concatenate([excess(path(t)) for path in paths]), margin, times, kinks
        ).begin

    return jax.lax.cond(surely_stay(system, times[0], times[-1]), lambda: never, search)


def is_free_to_leave(motion: AbstractMotion) -> bool:
    """Returns whether a mass moves as prescribed, and not on a closed rail or in its place."""
    return isinstance(motion, AbstractPrescribedMotion) and not is_bounded(motion)


def beyond_shell(system: BodyParameters, chi: Float[Array, "*batch 3"]) -> Float[Array, "*batch"]:
    """Computes |χ|² − R², which is smooth also where a mass passes the centre."""
    return jnp.sum(chi**2, axis=-1) - system.radius**2


def margin_of_shell(system: BodyParameters) -> Float[Array, ""]:
    """Computes :func:`beyond_shell` of a mass as far from the centre as one inside may be."""
    return (system.radius * (1 + rounding(system.radius))) ** 2 - system.radius**2


def aside_of(chi: Float[Array, "*batch 3"]) -> Float[Array, "*batch"]:
    """Computes the square of the distance from the plane of a disk."""
    return chi[..., 1] ** 2


def margin_of_plane(system: BodyParameters) -> Float[Array, ""]:
    """Computes :func:`aside_of` of a mass as far aside as one in the plane may be."""
    return (system.radius * rounding(system.radius)) ** 2


def path_of(motion: Any) -> Callable[[Time], Float[Array, "masses 3"]]:
    """Returns χ of a group of masses as a function of time."""
    return lambda t: eqx.filter_vmap(lambda motion: motion(t))(motion)


def leaving_of_mechanisms(
    system: BodyParameters,
    group: AbstractMechanism,
    order: tuple[int, ...],
    times: Float[Array, " T"],
    kinks: Float[Array, " kinks"],
) -> Excursion:
    """Finds when a mass of a group of mechanisms, all of whose joints are prescribed, first leaves the shell."""
    coordinates = jnp.zeros((1, len(system.coordinates)), system.radius.dtype)  # of which none moves them

    def beyond(t: Time) -> Float[Array, " masses"]:
        return jnp.ravel(beyond_shell(system, mechanism_positions(system, group, order, t[None], coordinates)))

    return first_excursion(beyond, margin_of_shell(system), times, kinks)


def clearance(
    system: BodyParameters, t: Time, theta: Float[Array, " driven"], swinging: bool = False
) -> Float[Array, ""] | None:
    """Computes how far inside the shell the masses are whose places only a state tells: R² less the largest |χ|².

    These are the masses that a law drives along open rails, and those of mechanisms with sliders and carriages in the
    state, and with ``swinging`` with hinges alone; None without any. ``system`` is prepared.
    """
    # Squares of distances are smooth also where a mass passes the centre, as what a solve watches should be.
    squares = []
    for group, places in _groups(system):
        if isinstance(group.motion, Driven) and not is_bounded(group.motion):
            squares.append(jnp.sum(_positions(group.motion, t[None], theta[None, places]) ** 2, axis=-1))
    for group, order in zip(system.mechanism_groups, system.mechanism_order, strict=True):
        if _slides(group) or (swinging and group.in_state):
            squares.append(jnp.sum(mechanism_positions(system, group, order, t[None], theta[None]) ** 2, axis=-1))
    if not squares:
        return None
    furthest = jnp.max(jnp.concatenate([jnp.ravel(square) for square in squares]))
    return (system.radius * (1 + rounding(system.radius))) ** 2 - furthest


def _slides(group: AbstractMechanism) -> bool:
    """Returns whether masses of a mechanism may get further than its joints are long, with a parameter that is in the
    state.
    """
    hinged = isinstance(group, Mechanism) and all(isinstance(joint, Hinge) for joint in group.joints)
    return bool(group.in_state) and not hinged


def may_swing_out(system: AbstractSystem) -> bool:
    """Returns whether hinges in the state are so long that their masses may get out of the shell; False where that is
    not known, as within ``jax.jit`` of a body. The system may be of many runs.

    Masses that cannot need not be looked at in each step.
    """
    body = system.shown
    if not isinstance(body, BodyParameters):
        return False
    swinging = [group for group in body.mechanism_groups if group.in_state and not _slides(group)]
    if not swinging or any(map(is_traced, jax.tree.leaves((swinging, body.radius)))):
        return False
    inside = np.min(np.asarray(body.radius)) * (1 + rounding(body.radius))
    return any(np.max(_reach_of_hinges(cast(Mechanism, group)), initial=0.0) > inside for group in swinging)


def clearance_of_all(system: AbstractSystem, t: Time, state: Any) -> Float[Array, ""] | None:
    """Computes the :func:`clearance` of a system that :func:`may_swing_out`, hinges included."""
    body: Any = system.shown
    return clearance(body, t, cast(State, system.state_to_show(state)).theta, swinging=True)


def _reach_of_hinges(group: Mechanism) -> Float[np.ndarray, "*group n"]:
    """Computes a length that no mass is further from the centre than: that of the chain of hinges which carries it."""
    centre, place = np.zeros(3), np.asarray(group.place)

    def along_chain(mass: int) -> Any:
        hinges = [cast(Hinge, group.joints[a]) for a in group.carriers(group.carrier[mass])]
        points = [centre, *(np.asarray(hinge.point) for hinge in hinges), place[..., mass, :]]
        return sum(length(end - start) for start, end in itertools.pairwise(points))

    return np.stack([along_chain(mass) for mass in range(place.shape[-2])], axis=-1)


def until_left(
    system: AbstractSystem,
    times: Float[Array, " T"],
    states: Any,
    reached: Float[Array, ""],
    status: Int[Array, ""],
    seen: Float[Array, ""] | None = None,
) -> tuple[Float[Array, ""], Int[Array, ""]]:
    """Returns the time up to which a run is valid, and its status, where something leaves the inside of the system.

    ``reached`` and ``status`` are those of its solve, ``states`` those at ``times``; ``seen`` is when the ``clearance``
    fell to zero, NaN if it did not. ``system`` is prepared.
    """
    left = system.time_of_leaving(times, states)
    if left is None and seen is None:
        return reached, status
    left = jnp.full_like(reached, jnp.inf) if left is None else left
    if seen is not None:
        left = jnp.where(seen < left, jax.lax.stop_gradient(seen), left)
    return jnp.minimum(reached, left), jnp.where(left <= reached, int(system.leaving_status), status)


def _groups(system: BodyParameters) -> list[tuple[Any, np.ndarray]]:
    """Lists the groups of masses, each with the places of its masses among the driven ones, if they are."""
    slots = {index: slot for slot, index in enumerate(system.driven)}
    return [
        (group, np.asarray([slots[index] for index in indices if index in slots], dtype=int))
        for group, indices in zip(system.groups, system.order, strict=True)
    ]


def _positions(motion: Any, t: Float[Array, " n"], theta: Float[Array, "_ driven"]) -> Float[Array, "n masses 3"]:
    """Computes χ of a group of masses at n times; driven ones have the angles ``theta`` at these."""
    if isinstance(motion, Driven):
        return jax.vmap(lambda theta: eqx.filter_vmap(lambda rail, angle: rail(angle))(motion.rail, theta))(theta)
    return jax.vmap(path_of(motion))(t)


def mechanism_positions(
    system: BodyParameters,
    group: AbstractMechanism,
    order: tuple[int, ...],
    t: Float[Array, " n"],
    theta: Float[Array, "n coordinates"],
) -> Float[Array, "n mechanisms masses 3"]:
    """Computes χ of the masses of a group of mechanisms at n times, with the coordinates ``theta`` at these."""
    slots = system.slots(order, group.in_state)

    def one(mechanism, t, angles):
        return mechanism.places(mechanism.rates(t, (angles, angles, angles))[0]).chi

    return jax.vmap(lambda t, theta: eqx.filter_vmap(one, in_axes=(0, None, 0))(group, t, theta[slots]))(t, theta)


def is_moved_off(
    system: BodyParameters,
    group: AbstractMechanism,
    order: tuple[int, ...],
    t: Float[Array, ""],
    theta: Float[Array, " coordinates"],
) -> Bool[Array, " mechanisms"]:
    """Returns whether a joint of a mechanism would move a mass out of the plane of a disk."""
    angles = theta[system.slots(order, group.in_state)]

    def one(mechanism, angles):
        places = mechanism.places(mechanism.rates(t, (angles, angles, angles))[0])
        # At any rates: whether slopes leave the plane depends on the axes of the joints.
        slopes = mechanism.slopes(places, jnp.ones_like(places.partial[:, 0, 0]))
        size = jnp.maximum(jnp.max(jnp.abs(places.partial)), jnp.max(jnp.abs(slopes)))
        aside = jnp.maximum(jnp.max(jnp.abs(places.partial[..., 1])), jnp.max(jnp.abs(slopes[..., 1])))
        return aside > rounding(places.chi) * size

    return eqx.filter_vmap(one)(group, angles)


def norm(chi: Float[Array, "*batch 3"]) -> Float[Array, "*batch"]:
    """Computes |χ|."""
    return jnp.sqrt(jnp.sum(chi**2, axis=-1))


class Reach(NamedTuple):
    """No point is further than ``far`` from the centre, or than ``aside`` from the plane of E1 and E3."""

    far: Float[Array, "..."]
    aside: Float[Array, "..."]


def surely_stay(system: BodyParameters, start: Time, end: Time) -> Bool[Array, ""]:
    """Returns whether bounds prove that masses in free motion or on open rails stay in the body from ``start`` to
    ``end``.

    Driven masses are not checked.
    """
    stay = jnp.asarray(True)
    for group in system.groups:
        if is_bounded(group.motion) or isinstance(group.motion, Driven):
            continue
        bound = eqx.filter_vmap(lambda motion: reach(motion, start, end))(group.motion)
        stay &= jnp.all(bound.far <= system.radius)
        if system.planar:
            stay &= jnp.all(bound.aside < rounding(system.radius) / 2 * system.radius)
    return stay


@functools.singledispatch
def reach(motion: AbstractMotion, start: Time, end: Time) -> Reach:
    """Bounds a motion between two times; infinite for a kind of which none are known."""
    return _find_unknown(start)


def _find_unknown(t: Time) -> Reach:
    return Reach(jnp.full_like(t, jnp.inf), jnp.full_like(t, jnp.inf))


@reach.register
def _(motion: Oscillating, start: Time, end: Time) -> Reach:
    size = jnp.abs(motion.path.constant) + jnp.sum(jnp.abs(motion.path.amplitude), axis=0)
    size += _beyond_sines(motion.path, start, end)
    if motion.path.powers is not None:
        latest = jnp.maximum(jnp.abs(start), jnp.abs(end))
        size += HarmonicSeries(jnp.zeros_like(size), powers=jnp.abs(motion.path.powers))(latest)
    return Reach(jnp.sqrt(jnp.sum(size**2)), size[1])


@reach.register
def _(motion: OnRail, start: Time, end: Time) -> Reach:
    if not isinstance(motion.rail, Tube):
        return _find_unknown(start)
    direction = jnp.abs(motion.rail.direction)
    along = largest_angle(motion.schedule, start, end) * direction / jnp.sqrt(jnp.sum(direction**2))
    size = jnp.abs(motion.rail.centre) + along
    return Reach(jnp.sqrt(jnp.sum(size**2)), size[1])


@functools.singledispatch
def largest_angle(schedule: AbstractSchedule, start: Time, end: Time) -> Float[Array, ""]:
    """Computes a bound on |θ(t)| between two times; infinite for a kind for which none is known."""
    return jnp.full_like(start, jnp.inf)


@largest_angle.register
def _(schedule: ConstantRate, start: Time, end: Time) -> Float[Array, ""]:
    return _of_line(schedule.theta, schedule.rate, start, end)


@largest_angle.register
def _(schedule: Sinusoids, start: Time, end: Time) -> Float[Array, ""]:
    waves = jnp.sum(jnp.abs(schedule.series.amplitude)) + _beyond_sines(schedule.series, start, end)
    return _of_line(schedule.series.constant, schedule.rate, start, end) + waves


@largest_angle.register
def _(schedule: Pulse, start: Time, end: Time) -> Float[Array, ""]:
    """Computes the bound for a pulse: θ̇ is between ``rate`` and its value after the push."""
    after = schedule.rate + schedule.height * (schedule.hold + schedule.end - 2 * schedule.start) / 2
    fastest = jnp.maximum(jnp.abs(schedule.rate), jnp.abs(after))
    furthest = jnp.maximum(jnp.abs(start - schedule.start), jnp.abs(end - schedule.start))
    return jnp.abs(schedule.theta) + fastest * furthest


def _of_line(theta: Float[Array, ""], rate: Float[Array, ""], start: Time, end: Time) -> Float[Array, ""]:
    return jnp.maximum(jnp.abs(theta + rate * start), jnp.abs(theta + rate * end))


def _beyond_sines(series: HarmonicSeries, start: Time, end: Time) -> Float[Array, ""]:
    """Returns infinity where an angle is so large that its sine as computed is not known to be one, and 0 elsewhere."""
    latest = jnp.maximum(jnp.abs(start), jnp.abs(end))
    phases = jnp.abs(series.frequency) * latest + jnp.abs(series.phase)
    return jnp.where(jnp.max(phases, initial=0.0) > LARGEST_PHASE, jnp.inf, 0.0)
