"""Adds to a run with a law of contact the states just before and just after each switch of its mode, for figures."""

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .. import programs
from ..physics.contact import friction
from ..physics.contact.body_on_plane import BodyOnPlane
from ..physics.contact.history import ContactHistory, slips_of
from ..physics.contact.modes import ContactState, Mode
from ..physics.contact.over_surface import near_to
from ..physics.contact.released import ReleasedState
from ..physics.contact.slide import slide
from ..physics.contact.window import Beginning
from .trajectory import Trajectory

STILL = 1e-9  # of the speeds of a body: a slower slip is at its beginning or at its end


def with_one_sided_limits(trajectory: Trajectory[Any, Any]) -> Trajectory[Any, Any]:
    """Returns the run with two more rows at each switch that was kept: the state and the mode just before it, and just
    after.

    Nothing jumps between switches, so a curve through these rows shows each jump where it is. The two rows replace a
    saved time that coincides with a switch. Rows without a switch have states of NaN and are at the end: there are
    always 2 ``capacity`` more rows than saved times, so that programs for them do not depend on how many switches there
    were. A run without a law of contact is returned as it is.

    **Arguments:**

    - ``trajectory``: one run, not a batch, of a state that has a place.
    """
    history = trajectory.history
    if not isinstance(history, ContactHistory) or history.holds_more:
        return trajectory  # where more is held, switches do not tell in which direction rolling begins
    times, state = np.asarray(trajectory.times), trajectory.state
    sides = _sides(trajectory, history)
    size = len(times) + 2 * history.law.capacity
    order = _order(times, sides)
    # The rows that are left over take the entry behind all others, which is ``nothing``.
    rows = np.concatenate([order, np.full(size - len(order), len(times) + 2 * history.law.capacity)])

    def join_rows(saved: Any, limits: Any, nothing: float | int) -> Any:
        """Joins the rows of saved values and of limits, in order; ``nothing`` in unused ones."""
        saved, limits = np.asarray(saved), np.asarray(limits)
        none = np.full((1, *saved.shape[1:]), nothing, saved.dtype)
        return jnp.asarray(np.concatenate([saved, limits.astype(saved.dtype), none])[rows])

    losses = _sum_dissipation(times, history, sides, order)
    filled = np.full((2, size), losses[:, -1:] if losses.size else 0.0)
    filled[:, : len(order)] = losses
    return dataclasses.replace(
        trajectory,
        times=np.asarray(join_rows(times, sides.times, times[-1])),
        state=jax.tree.map(lambda leaf, limit: join_rows(leaf, limit, np.nan), state, sides.states.body),
        history=dataclasses.replace(
            history,
            mode=join_rows(history.mode, sides.modes, -1),
            V=join_rows(history.V, sides.states.V, np.nan),
            height=join_rows(history.height, sides.height, np.nan),
            slip=join_rows(history.slip, sides.slip, np.nan),
            sigma=join_rows(history.sigma, sides.sigma, 0.0),
            friction_loss=jnp.asarray(filled[0]),
            impact_loss=jnp.asarray(filled[1]),
        ),
    )


class _Sides(NamedTuple):
    """Both limits at each switch there is room for: row 2 k is before the k-th, row 2 k + 1 after it."""

    times: Float[np.ndarray, " sides"]
    modes: Int[np.ndarray, " sides"]
    states: ReleasedState
    height: Float[np.ndarray, " sides"]
    slip: Float[np.ndarray, "sides 3"]
    sigma: Float[np.ndarray, "sides n"]
    speed: Float[np.ndarray, " sides"]
    kept: int

    def states_of(self, system: BodyOnPlane, sigma: Any) -> ContactState:
        """Returns the states of the system on its plane, with these slip directions."""
        return _contact_states(system, self.states, jnp.asarray(self.modes), jnp.asarray(sigma))


def _sides(trajectory: Trajectory[Any, Any], history: ContactHistory) -> _Sides:
    switches = history.switches
    count = min(int(switches.count), history.law.capacity)

    def both(before: Any, after: Any) -> np.ndarray:
        pair = np.stack([np.asarray(before), np.asarray(after)], axis=1)
        return pair.reshape(2 * len(pair), *pair.shape[2:])

    states = jax.tree.map(lambda *sides: jnp.asarray(both(*sides)), switches.before, switches.after)
    times, modes = both(switches.times, switches.times), both(switches.source, switches.target)
    none, zeros = np.zeros((len(times), history.sigma.shape[-1])), np.zeros(len(times))
    sides = _Sides(times, modes, states, zeros, np.zeros((len(times), 3)), none, zeros, count)
    if not count:
        return sides
    plane = BodyOnPlane(trajectory.system, history.law)
    finite_times = jnp.asarray(np.where(np.isfinite(times), times, 0.0))
    slip, sigma, speed = map(np.asarray, _slips(plane, finite_times, sides.states_of(plane, none)))
    # A switch of a body that touches or lands on the plane is at height 0, up to rounding.
    height = np.asarray(states.height)
    flying = (modes == Mode.FLIGHT) & (both(modes[::2], modes[::2]) == both(modes[1::2], modes[1::2]))
    height = np.where(flying & (np.abs(height) > STILL * float(trajectory.system.radius)), height, 0.0)
    sides = sides._replace(height=height, slip=slip, sigma=sigma, speed=speed)
    return sides._replace(sigma=_directions(trajectory, history, plane, finite_times, sides))


def _directions(
    trajectory: Trajectory[Any, Any], history: ContactHistory, plane: BodyOnPlane, times: Array, sides: _Sides
) -> Float[np.ndarray, "sides n"]:
    """Returns σ on each side: the direction of the velocity, or without slip, of the slip which begins or has ended
    there.
    """
    sigma, count = sides.sigma.copy(), sides.kept
    still = _is_still(trajectory, sides)
    begins = np.flatnonzero(still[1 : 2 * count : 2]) * 2 + 1
    if begins.size:
        first = np.asarray(_first_slips(plane, times, sides.states_of(plane, np.zeros_like(sigma))))
        sigma[begins] = first[begins]
    saved, directions = np.asarray(trajectory.times), np.asarray(history.sigma)
    for row in np.flatnonzero(still[: 2 * count : 2]) * 2:
        start = row - 1
        earlier = np.flatnonzero(saved < sides.times[row])
        # A slip that has ended has the direction last saved within it, or where none was, that with which it began.
        within = earlier.size and (start < 0 or saved[earlier[-1]] > sides.times[start])
        sigma[row] = directions[earlier[-1]] if within else sigma[start] if start >= 0 else 0.0
    return sigma


def _is_still(trajectory: Trajectory[Any, Any], sides: _Sides) -> Bool[np.ndarray, " sides"]:
    """Finds the sides where a body slides but its direction cannot be computed from its velocity."""
    state: Any = sides.states.body
    rates = np.asarray(getattr(state, state.rotation_rate))
    spin = np.linalg.norm(rates.reshape(len(rates), -1), axis=1)
    speed = np.linalg.norm(np.asarray(sides.states.V), axis=1) + float(trajectory.system.radius) * spin
    slow = ~(sides.speed > STILL * speed)
    return (sides.modes == Mode.SLIDING) & slow


def _order(times: Float[np.ndarray, " T"], sides: _Sides) -> Int[np.ndarray, " rows"]:
    """Returns the rows of the run in the order of time: saved ones by their index, sides by theirs after all
    of these.
    """
    when = sides.times[: 2 * sides.kept]
    rows = np.arange(len(when))
    # Times before the start and after the end are not part of the run.
    inside = np.where(rows % 2 == 0, when > times[0], when < times[-1]) & (when >= times[0]) & (when <= times[-1])
    replaced = np.isin(times, when[inside]) & (times > times[0]) & (times < times[-1])
    saved = np.flatnonzero(~replaced)
    places = np.searchsorted(times[saved], when[inside])
    return np.insert(saved, places, len(times) + rows[inside])


def _sum_dissipation(
    times: Float[np.ndarray, " T"], history: ContactHistory, sides: _Sides, order: Int[np.ndarray, " rows"]
) -> Float[np.ndarray, "2 rows"]:
    """Sums the energy dissipated by sliding friction and by impacts until each row.

    Between two saved times, friction dissipates energy while the body slides: all of it in a single slip, or for
    several slips, in proportion to their durations and speeds.
    """
    count = len(times)
    speeds = np.linalg.norm(np.concatenate([np.asarray(history.slip), sides.slip])[order, :2], axis=1)
    when = np.concatenate([times, sides.times])[order]
    modes = np.concatenate([np.asarray(history.mode), sides.modes])[order]
    slides = (modes[:-1] == Mode.SLIDING) & (modes[1:] == Mode.SLIDING) & (np.diff(when) > 0)
    shares = np.concatenate([[0.0], np.cumsum(np.where(slides, np.diff(when) * (speeds[1:] + speeds[:-1]), 0.0))])
    is_saved = order < count
    friction_loss = np.asarray(history.friction_loss)[order[is_saved]]
    filled = _share_out(shares, is_saved, friction_loss)
    lost = np.zeros(len(order))
    after = ~is_saved & ((order - count) % 2 == 1)
    lost[after] = np.asarray(history.switches.lost)[(order[after] - count) // 2]
    impact_loss, total = np.asarray(history.impact_loss)[order[is_saved]], np.cumsum(lost)
    return np.stack([filled, impact_loss[0] - total[is_saved][0] + total if is_saved.any() else total])


def _share_out(
    shares: Float[np.ndarray, " rows"], mask: Bool[np.ndarray, " rows"], values: Float[np.ndarray, " known"]
) -> Float[np.ndarray, " rows"]:
    """Interpolates ``values`` at the known rows: between two of them, they grow as ``shares`` do."""
    rows = np.flatnonzero(mask)
    filled = np.full(len(shares), values[0] if values.size else 0.0)
    for a, b, low, high in zip(rows[:-1], rows[1:], values[:-1], values[1:], strict=True):
        grown = shares[a : b + 1] - shares[a]
        filled[a : b + 1] = low + (high - low) * (grown / grown[-1] if grown[-1] > 0 else grown)
        filled[b] = high
    if rows.size:
        filled[rows[-1] :] = values[-1]
    return filled


def _contact_states(system: BodyOnPlane, states: ReleasedState, modes: Array, sigma: Array) -> ContactState:
    height = states.height
    ever = jnp.full_like(height, jnp.finfo(height.dtype).max)
    none = jnp.zeros_like(height)
    long_ago = jnp.all(sigma == 0, axis=-1)
    begun = Beginning.along(jnp.where(long_ago, -jnp.sqrt(ever), ever), sigma)
    near = near_to(system.body, states.body.z, height)
    return ContactState(states.body, states.V, height, none, none, modes.astype(height.dtype), begun, near)


@programs.filter_jit
def _slips(system: BodyOnPlane, times: Array, states: ContactState) -> tuple[Array, Array, Array]:
    """Computes the slip velocities, their directions, and the speeds along these."""
    prepared = system.prepare()

    def speed(sample: tuple[Array, ContactState]) -> Array:
        return jnp.sqrt(jnp.sum(slide(prepared, *sample) ** 2))

    return *slips_of(prepared, times, states), jax.lax.map(speed, (times, states))


@programs.filter_jit
def _first_slips(system: BodyOnPlane, times: Array, states: ContactState) -> Array:
    """Computes the directions in which slips begin."""
    prepared = system.prepare()

    def first(sample: tuple[Array, ContactState]) -> Array:
        return friction.first_slip(prepared.response(*sample), prepared.law.friction).sigma

    return jax.lax.map(first, (times, states))
