"""The program of ``simulate_ensemble``: one run with its reductions, mapped over many by ``jax.vmap``."""

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from ... import programs
from ...interface.status import Status
from ...programs import native
from ...programs.derivatives.differentiation import with_unknown_derivatives
from ...programs.identity.closures import put_captures, take_captures
from ..observers import Found, Observation
from ..quantities import values
from ..simulate import Method, simulate_and_observe
from ..solvers.collocation import fills_vectors
from ..trajectory import Trajectory
from .reductions import AbstractReduction, Observed, Quantity


class Settings(NamedTuple):
    """What a program is compiled for.

    - ``method``: how each run is solved.
    - ``reductions``: the results to find, by name.
    - ``lanes``: how many runs are one solve where XLA compiles them.
    """

    method: Method
    reductions: tuple[tuple[str, AbstractReduction], ...]
    lanes: int


class Ends(NamedTuple):
    """The fields of a trajectory that a program computes."""

    state: Any
    reached: Array
    status: Array
    steps: Array
    rejected: Array
    events: dict[str, Any]
    history: Any


def solve_all(settings: Settings, shared: Sequence[bool], parameters: Any, *others: Any) -> tuple[Any, ...]:
    """Solves runs: ``Ends``, what reductions report, and the steps of all lanes, each with the runs as leading axis.

    - ``parameters``: system, state and events; ``shared`` says which of their leaves all runs share.
    - ``others``: times, rtol and atol, each with the runs as leading axis.
    """
    leaves, structure = jax.tree.flatten(parameters)

    def run(leaves: list[Any], times: Array, rtol: Array, atol: Array) -> Any:
        system, state, events = structure.unflatten(leaves)
        return _program(settings)(system, state, times, rtol, atol, events)

    # What all runs share is not copied for each.
    axes = [None if is_shared else 0 for is_shared in shared]
    ends, reported = jax.vmap(run, in_axes=(axes, 0, 0, 0))(leaves, *others)
    return ends, reported, _count_steps(ends.steps, _together(settings))


def _program(settings: Settings) -> Any:
    opened, captures = take_captures(settings, local=True)  # so that a quantity that is written anew is known again
    try:
        return _compile(settings if captures else opened)
    except TypeError:  # a solver that carries arrays has no hash
        return functools.partial(_run_filtered, settings)


@functools.cache
def _compile(settings: Settings) -> programs.Program:
    in_lanes = not fills_vectors(settings.method.solver)
    return programs.jit(functools.partial(_run, settings), in_lanes=in_lanes, together=settings.lanes, steered=True)


def _together(settings: Settings) -> int:
    """Returns the number of runs that wait for the longest among them."""
    if native.current_choice() == "native" and native.is_allowed():
        return 1 if fills_vectors(settings.method.solver) else native.LANES
    return settings.lanes


def _run(
    settings: Settings, system: Any, state: Any, times: Array, rtol: Array, atol: Array, events: Any
) -> tuple[Ends, dict[str, Array]]:
    """Simulates one of the runs."""
    # Functions that ``_program`` has opened have captured nothing.
    settings = put_captures(settings, [])
    method = settings.method._replace(observation=_observation(settings.reductions))
    fields, observations = simulate_and_observe(method, system, times, state, rtol, atol, events)
    run = Trajectory.of(system.shown, times, *fields[:-1], state, fields[-1])
    reported = _reports(settings.reductions, observations)
    reported = {name: jnp.where(run.status == Status.IMPOSSIBLE, jnp.nan, value) for name, value in reported.items()}
    reported = with_unknown_derivatives(reported, (system, state, times))
    return Ends(run.state, run.reached, run.status, run.steps, run.rejected, run.events, run.history), reported


_run_filtered = programs.filter_jit(_run)


def _count_steps(steps: Int[Array, " runs"], lanes: int) -> Int[Array, ""]:
    """Counts the steps of all lanes: those that go on together end with the last of them."""
    # The last group may have fewer runs than lanes.
    groups = jnp.pad(steps, (0, -steps.size % lanes)).reshape(-1, lanes)
    return lanes * jnp.sum(jnp.max(groups, axis=1))


def _observation(reductions: Sequence[tuple[str, AbstractReduction]]) -> Observation | None:
    if not reductions:
        return None
    quantities = _quantities(reductions)
    searches = [(quantities.index(item.quantity), sign) for _, item in reductions for sign in item.signs]
    integrals = dict.fromkeys(quantities.index(item.quantity) for _, item in reductions if item.is_integral)
    return Observation(values, quantities, tuple(searches), tuple(integrals))


def _quantities(reductions: Sequence[tuple[str, AbstractReduction]]) -> tuple[Quantity, ...]:
    return tuple(dict.fromkeys(item.quantity for _, item in reductions))


def _reports(reductions: Sequence[tuple[str, AbstractReduction]], observations: Found | None) -> dict[str, Array]:
    """Returns the reports of the reductions on one run, by name."""
    if observations is None:
        return {}
    quantities, reports = _quantities(reductions), {}
    extremes = iter(zip(observations.extremes, observations.times, strict=True))
    for name, item in reductions:
        k = quantities.index(item.quantity)
        pairs = [next(extremes) for _ in item.signs]
        observed = Observed(
            observations.start[k], tuple(v for v, _ in pairs), tuple(t for _, t in pairs), observations.integrals[k]
        )
        reports |= {name + end: value for end, value in item.result(observed).items()}
    return reports
