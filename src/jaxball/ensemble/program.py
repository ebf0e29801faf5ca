"""The compiled program of a block of runs."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..interface.status import Status
from ..numerics import programs
from ..numerics.masks import with_unknown_derivatives
from ..physics.body_on_plane import BodyOnPlane
from ..physics.confinement import until_left
from ..physics.modes import ContactState
from ..physics.packing import Packing
from ..physics.validity import possible_start
from ..simulation.history import slips
from ..simulation.modal import unpacked_switch
from ..simulation.step_size import by_tolerances, kinks_of, to_kinks
from ..simulation.switching import Kept
from .control import Limits
from .modes import Given, Modes, switches_of
from .observation import Observation
from .parameters import Prepared, axes, single
from .reductions import AbstractReduction
from .rows import Method, Rows, Solved, solve_rows
from .runge_kutta import tableau_of


class Settings(NamedTuple):
    """What a program is compiled for. ``shared`` says which leaves of system and state all runs share."""

    solver: diffrax.AbstractERK
    max_steps: int
    lanes: int
    shared: tuple[bool, ...]
    reductions: tuple[tuple[str, AbstractReduction], ...]
    inside: bool = True


@functools.cache
def compiled(settings: Settings) -> Callable[..., Any]:
    """The program: from (system, state), times, rtol and atol to the fields of a trajectory from ``state`` on, with the
    runs as leading axis, what reductions report, and the steps of all lanes.
    """
    return programs.jit(functools.partial(_solve, settings))


def _solve(settings: Settings, parameters: Any, times: Array, rtol: Array, atol: Array) -> Any:
    t0, t1 = times[:, 0], times[:, -1]
    parameters, leaves_shared = _started(settings.shared, parameters, t0)
    along = axes(parameters, leaves_shared)
    system, state = parameters
    like, shared = single(parameters, leaves_shared), leaves_shared[: len(jax.tree.leaves(system))]

    def each(function: Callable[..., Any], *others: Any) -> Any:
        return jax.vmap(function, in_axes=(*along, *(0 for _ in others)))(system, state, *others)

    x = each(lambda system, state, t: Packing.of(system.prepare(), state).pack(t, state), t0)
    possible = each(
        lambda system, state, times: possible_start(system, system.prepare(), times, state, settings.inside), times
    )
    startable = possible & jnp.all(jnp.isfinite(x), axis=1)
    kinks = each(lambda system, state, t: kinks_of(system), t0)

    def prepared(function: Callable[..., Any], others: int = 0) -> Prepared:
        return Prepared.of(function, like[0], system, shared, x, others)

    field = prepared(lambda system, t, x: Packing.of(system.prepare(), like[1]).field(t, x))
    observation = Observation.of(settings.solver, settings.reductions, prepared, like[1], field, times, x)
    error_order = settings.solver.error_order(diffrax.ODETerm(lambda t, y, args: y))
    limits, end, modes, given = Limits(kinks.T, rtol, atol), jnp.where(startable, t1, t0), None, None
    if isinstance(system, BodyOnPlane):

        def packed(system: BodyOnPlane) -> Packing:
            return Packing.of(system.prepare(), like[1])

        packing = packed(system) if all(shared) else jax.vmap(packed, in_axes=along[:1])(system)
        modes = Modes.of(prepared, observation.between, packing, all(shared), error_order)
        given = Given(modes.heading.own, modes.guards.own, modes.ended.own, t0, end, limits)
    solved = solve_rows(
        Method(
            field=field,
            tableau=tableau_of(settings.solver),
            error_order=error_order,
            controller=lambda kinks, rtol, atol: to_kinks(by_tolerances(rtol, atol), kinks),
            max_steps=settings.max_steps,
            modes=modes,
            within=observation.within,
        ),
        Rows(
            parameters=field.own,
            t0=t0,
            t1=end,
            x=x.T,
            limits=limits,
            observers=observation.given,
            modes=given,
        ),
        settings.lanes,
        observation.observers,
    )
    status = _status(solved, startable, t1)
    first = x if solved.course is None else solved.course[0].T
    states = _states(solved.x.T, observation.saved(solved.observed, x), first, startable, status)
    unpacked = each(
        lambda system, state, times, states: jax.vmap(Packing.of(system.prepare(), state).unpack)(times, states),
        times,
        states,
    )
    reached = jnp.where(startable, jnp.minimum(solved.t, t1), t0)
    if settings.inside:
        run = (times, unpacked, reached, status)
        reached, status = each(lambda system, _, *run: until_left(system.prepare(), *run), *run)
    reported = observation.reduced(solved.observed, field.own, t0, first.T, settings.lanes)
    reported = {name: jnp.where(startable, value, jnp.nan) for name, value in reported.items()}
    contact = None if solved.switches is None else _contact(each, times, unpacked, solved)
    unpacked, contact, reported = with_unknown_derivatives((unpacked, contact, reported), (system, state, times))
    return unpacked, reached, status, solved.steps, solved.rejected, contact, reported, solved.executed


def _started(
    shared: tuple[bool, ...], parameters: Any, t0: Float[Array, " rows"]
) -> tuple[tuple[Any, Any], tuple[bool, ...]]:
    """System and state of each row, and which of their leaves rows share; with a law of contact, as modes start."""
    system, state = parameters
    if not isinstance(system, BodyOnPlane):
        return parameters, shared
    start = jax.vmap(lambda system, state, t: system.prepare().start(t, state), in_axes=(*axes(parameters, shared), 0))
    started = start(system, state, t0)
    return (system, started), (*shared[: len(jax.tree.leaves(system))], *(False for _ in jax.tree.leaves(started)))


def _contact(each: Callable[..., Any], times: Array, states: ContactState, solved: Solved) -> tuple[Any, ...]:
    """The slips at the times of rows, their directions, and the switches: how many, and those that are kept."""
    assert solved.switches is not None
    slip, sigma = each(lambda system, state, times, states: slips(system.prepare(), times, states), times, states)

    def unpacked(kept: Kept) -> Any:
        return each(lambda system, state, one: unpacked_switch(Packing.of(system.prepare(), state), one), kept)

    # One after the other, because the states of all switches of many rows take much memory.
    kept = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 1, 0), switches_of(solved.switches))
    switches = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, 1), jax.lax.map(unpacked, kept))
    return slip, sigma, solved.course[1], switches


def _status(solved: Solved, startable: Bool[Array, " runs"], t1: Float[Array, " runs"]) -> Int[Array, " runs"]:
    status = jnp.where(solved.t < t1, Status.MAX_STEPS, Status.SUCCESS)
    status = jnp.where(solved.finite, status, Status.NOT_FINITE)
    if solved.course is not None:
        status = jnp.where(solved.course[2] == int(Status.SUCCESS), status, solved.course[2])
    return jnp.where(startable, status, Status.IMPOSSIBLE)


def _states(
    end: Float[Array, "runs size"],
    between: Float[Array, "runs between size"],
    x: Float[Array, "runs size"],
    startable: Bool[Array, " runs"],
    status: Int[Array, " runs"],
) -> Float[Array, "runs times size"]:
    """The vectors at all times; NaN at those that a run did not reach."""
    end = jnp.where((status == Status.SUCCESS)[:, None], end, jnp.nan)
    states = jnp.concatenate([x[:, None], between, end[:, None]], axis=1)
    return jnp.where(startable[:, None, None], states, jnp.nan)
