"""Events in a solve: where it may stop, and the exact times at which they happened."""

import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any, cast

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..interface.arguments import require
from ..interface.status import Status
from ..numerics import programs
from ..numerics.arrays import is_traced
from ..numerics.differentiation import known_or_nothing, once, with_unknown_derivatives
from ..physics.contact.body_on_plane import BodyOnPlane
from ..physics.packing import Packing
from ..physics.rolling import AbstractRollingSystem
from ..physics.system import AbstractSystem
from ..solvers.dense.crossings import Crossings, Kind, crossings
from ..solvers.dense.steps import Steps
from .events import DOWN, UP, AbstractEvent, Detachment, Occurrences, Slip
from .trajectory import Trajectory

# Programs are compiled for multiples of this number of steps, so that there are few of them.
STEPS_AT_A_TIME = 64


def checked(system: AbstractSystem, events: Mapping[str, AbstractEvent] | None) -> dict[str, AbstractEvent]:
    """The events to look for, of the ``system`` that is solved.

    **Raises:** ``TypeError`` for anything but an event, and for one that cannot happen to such a system.
    """
    events = {} if events is None else events
    require("events", events, Mapping, 'a dictionary of events by name, such as {"lift": Detachment()}')
    for name, event in events.items():
        remedy = "Event(function) is one" if inspect.isfunction(event) else ""
        require(f"events[{name!r}]", event, AbstractEvent, "an event, such as Detachment()", remedy)
    touching = [name for name, event in events.items() if isinstance(event, Detachment | Slip)]
    if touching and not isinstance(system.shown, AbstractRollingSystem):
        raise TypeError(
            f"Argument `events` must not hold a Detachment or a Slip for a {type(system.shown).__name__}, which "
            f'does not roll on a plane, but "{touching[0]}" is one.'
        )
    if touching and isinstance(system, BodyOnPlane):
        raise TypeError(
            f"Argument `events` must hold no {type(events[touching[0]]).__name__} with `contact`, which says what "
            f'happens then, but "{touching[0]}" is one; `trajectory.contact.switches` has the times.'
        )
    return dict(events)


def stop(events: Mapping[str, AbstractEvent], unpack: Callable[[Array], tuple[Packing, Any]]) -> diffrax.Event | None:
    """Ends a solve soon after the first terminal event, at the end of a step.

    ``unpack`` takes a solve's parameters to its packing and its events.
    """

    def levels(t, x, parameters):
        packing, events = unpack(parameters)
        system, state = packing.system.shown, packing.system.shown_state(packing.unpack(t, x))
        return lambda name: events[name].value(system, t, state)

    def limit(t, x, parameters, *, t0, **_):
        # Together, because they have long formulas in common; in a branch, so that XLA computes these once.
        def least(x):
            level = levels(t, x, parameters)
            return functools.reduce(jnp.minimum, [level(name) for name in limits])

        # diffrax evaluates the start before its loop.
        return jnp.ones_like(t) if t is t0 else jax.lax.cond(t > t0, least, lambda x: jnp.ones_like(t), x)

    def condition(name: str) -> Callable:
        # The start is not a crossing, even if rounding changes the sign of a zero; NaN has no sign.
        return lambda t, x, parameters, *, t0, **_: jnp.where(t == t0, jnp.nan, levels(t, x, parameters)(name))

    terminal = {name: event for name, event in events.items() if event.terminal}
    limits = [name for name, event in terminal.items() if event.from_start and event.direction == DOWN]
    conditions, directions = ({"limits": limit}, {"limits": False}) if limits else ({}, {})
    for name, event in terminal.items():
        for direction in (UP, DOWN):
            if name not in limits and event.direction != -direction:
                conditions[f"{name} {direction}"], directions[f"{name} {direction}"] = condition(name), direction == UP
    return diffrax.Event(conditions, direction=directions) if conditions else None


def locate(trajectory: Trajectory[Any, Any], events: Mapping[str, AbstractEvent]) -> Trajectory[Any, Any]:
    """The trajectory with the occurrences of its events, ended at the first terminal one."""
    return _locate(trajectory, dict(events), room_for(trajectory))


def room_for(trajectory: Trajectory[Any, Any]) -> int:
    """How many steps to examine: those that were taken and a few more, or all that there is room for when traced."""
    assert trajectory.interpolant is not None
    largest = cast(Any, trajectory.interpolant.solution.interpolation).ts.shape[-1] - 1
    if is_traced(trajectory.steps):
        return largest
    accepted = int(np.max(np.asarray(trajectory.steps) - np.asarray(trajectory.rejected)))
    return min(largest, STEPS_AT_A_TIME * -(-max(accepted, 1) // STEPS_AT_A_TIME))


@programs.filter_jit
def _locate(trajectory: Trajectory[Any, Any], events: dict[str, AbstractEvent], room: int) -> Trajectory[Any, Any]:
    interpolant = trajectory.interpolant
    assert interpolant is not None
    packing, started = interpolant.packing, trajectory.status != Status.IMPOSSIBLE
    steps = Steps.of(interpolant.solution, trajectory.reached, room)
    located = _crossings(steps, packing, events)
    end, status = jnp.full_like(trajectory.reached, jnp.inf), trajectory.status
    for name, event in events.items():
        if event.terminal:
            first = jnp.where(started & (located[name].count > 0), located[name].times[0], jnp.inf)
            status = jnp.where(first < end, int(event.status), status)
            end = jnp.minimum(first, end)
    # Not a minimum, whose derivative would take in that of the other.
    reached = jnp.where(end < trajectory.reached, end, trajectory.reached)
    times = jnp.asarray(trajectory.times)
    # A function that touched zero at the end of a step has stopped the solve without a crossing.
    touched = (status == Status.SUCCESS) & (reached < times[-1])
    status = jnp.where(touched, int(Status.EVENT), status)

    def cut(leaf):
        return known_or_nothing((times <= reached).reshape(-1, *(1,) * (leaf.ndim - 1)), leaf)

    occurrences = _occurrences(packing, located, started, reached)
    given = (trajectory.system, trajectory.times, trajectory.start)
    found = with_unknown_derivatives((jax.tree.map(cut, trajectory.state), occurrences), given)
    return eqx.tree_at(lambda t: (t.state, t.events, t.reached, t.status), trajectory, (*found, reached, status))


def _crossings(steps: Steps, packing: Packing, events: dict[str, AbstractEvent]) -> dict[str, Crossings]:
    """Those of all events, by name; together, so that what their functions have in common is computed once."""

    def values(t, x):
        system, state = packing.system.shown, packing.system.shown_state(packing.unpack(t, x))
        return jnp.stack([event.value(system, t, state) for event in events.values()])

    kinds = [Kind(event.direction, event.from_start, event.room) for event in events.values()]
    located = once("times and states of events", crossings(steps, values, packing.field, kinds))
    return dict(zip(events, located, strict=True))


def _occurrences(
    packing: Packing, located: dict[str, Crossings], started: Array, reached: Float[Array, ""]
) -> dict[str, Occurrences]:
    """Those up to the end of the run. The states of all events are made of their vectors together."""
    times, vectors = (
        jnp.concatenate([getattr(one, name) for one in located.values()]) for name in ("times", "vectors")
    )
    known = (times <= reached) & started
    whole = jax.lax.map(lambda at: packing.unpack_where(*at), (known, times, vectors))
    states = packing.system.shown_state(whole)
    occurrences, begin = {}, 0
    for name, one in located.items():
        part = slice(begin, begin + one.times.size)
        within, begin = (one.times <= reached) & started, part.stop
        late = jnp.sum(jnp.isfinite(one.times) & ~within)
        occurrences[name] = Occurrences(
            count=jnp.where(started, one.count - late, 0),
            times=jnp.where(within, one.times, jnp.nan),
            state=jax.tree.map(lambda leaf, part=part: leaf[part], states),
            least=one.least,
            largest=one.largest,
        )
    return occurrences
