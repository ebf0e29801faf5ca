"""The program of a block of runs: the solve of a single run, mapped over them; and many runs in such blocks.

The native compiler computes the turns of a ``jax.lax.map`` side by side, in the lanes of vectors, but for solvers whose
steps fill vectors by themselves. XLA would compute one after the other, so for XLA some runs at a time are one solve,
by ``jax.vmap``. Either way those that are computed together wait for the longest of them.
"""

import contextlib
import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from .. import native
from ..cpu import cores
from ..interface.status import Status
from ..numerics import programs
from ..numerics.batches import even_size, in_threads, map_batches, unpadded
from ..numerics.differentiation import with_unknown_derivatives
from ..simulation.observers import Found, Observation
from ..simulation.simulate import Method, simulated_and_found
from ..simulation.trajectory import Trajectory
from ..solvers.collocation import fills_vectors
from .reductions import AbstractReduction, Observed, Quantity, values

# How many runs a program takes at a time by default.
NATIVE_BLOCK = 512
XLA_BLOCK = 4096

# The compiled programs, by everything that they are compiled for.
_warm: set[Any] = set()


class Settings(NamedTuple):
    """What a program is compiled for.

    - ``method``: how each run is solved.
    - ``reductions``: the results to find, by name.
    - ``shared``: which leaves of system, state and events all runs share.
    - ``lanes``: how many runs are one solve; None for the native compiler, which has lanes of its own.
    """

    method: Method
    reductions: tuple[tuple[str, AbstractReduction], ...]
    shared: tuple[bool, ...]
    lanes: int | None


class Ends(NamedTuple):
    """The fields of a trajectory that a program computes."""

    state: Any
    reached: Array
    status: Array
    steps: Array
    rejected: Array
    events: dict[str, Any]
    history: Any


def solved(settings: Settings, *given: Any) -> Any:
    """The solves, by a compiled program: from (system, state, events), times, rtol and atol to the ``Ends`` of runs.

    With the runs as leading axis; then what reductions report, and the steps of all lanes.
    """
    program, first = _program(settings._replace(lanes=None))
    natively = program.natively(*first, *given)
    if natively is not None:
        with contextlib.suppress(native.CallbackReachedError):
            return natively()
    if native.traced_natively():
        return program(*first, *given)
    program, first = _program(settings)
    return program(*first, *given)


def _program(settings: Settings) -> tuple[programs.Program, tuple[Settings, ...]]:
    """The program, and the arguments that precede its own."""
    try:
        return _compiled(settings), ()
    except TypeError:  # a solver that carries arrays has no hash
        return _solve_filtered, (settings,)


@functools.cache
def _compiled(settings: Settings) -> programs.Program:
    return programs.jit(functools.partial(_solve, settings))


def _solve(settings: Settings, parameters: Any, times: Array, rtol: Array, atol: Array) -> Any:
    leaves, structure = jax.tree.flatten(parameters)
    own = [leaf for leaf, shared in zip(leaves, settings.shared, strict=True) if not shared]

    def run(row: Any) -> Any:
        own, times, rtol, atol = row
        following = iter(own)
        whole = [leaf if shared else next(following) for leaf, shared in zip(leaves, settings.shared, strict=True)]
        system, state, events = structure.unflatten(whole)
        return _run(settings, system, state, times, rtol, atol, events)

    rows = own, times, rtol, atol
    if settings.lanes is None and fills_vectors(settings.method.solver):
        executed, results = _one_after_another(run, rows)
        return *results, executed
    results = jax.lax.map(run, rows) if settings.lanes is None else map_batches(run, rows, settings.lanes)
    together = native.LANES if settings.lanes is None else even_size(len(times), settings.lanes, 1)
    return *results, _executed(results[0].steps, together)


def _one_after_another(run: Callable[[Any], tuple[Ends, Any]], rows: Any) -> tuple[Int[Array, ""], tuple[Ends, Any]]:
    """The steps of all runs, and their results.

    Counted from run to run, so that the native compiler does not compute them side by side.
    """

    def turn(steps: Array, row: Any) -> tuple[Array, tuple[Ends, Any]]:
        result = run(row)
        return steps + result[0].steps, result

    return jax.lax.scan(turn, jnp.asarray(0), rows)


_solve_filtered = cast(programs.Program, programs.filter_jit(_solve))


def _run(
    settings: Settings, system: Any, state: Any, times: Array, rtol: Array, atol: Array, events: Any
) -> tuple[Ends, dict[str, Array]]:
    """One of the runs."""
    method = settings.method._replace(observation=_observation(settings.reductions))
    fields, found = simulated_and_found(method, system, times, state, rtol, atol, events)
    run = Trajectory.of(system.shown, times, *fields[:-1], state, fields[-1])
    reported = _reports(settings.reductions, found)
    reported = {name: jnp.where(run.status == Status.IMPOSSIBLE, jnp.nan, value) for name, value in reported.items()}
    reported = with_unknown_derivatives(reported, (system, state, times))
    return Ends(run.state, run.reached, run.status, run.steps, run.rejected, run.events, run.history), reported


def _executed(steps: Int[Array, " runs"], lanes: int) -> Int[Array, ""]:
    """The steps of all lanes: those that go on together end with the last of them."""
    groups = jnp.pad(steps, (0, -steps.size % lanes)).reshape(-1, lanes)
    return lanes * jnp.sum(jnp.max(groups, axis=1))


def _observation(reductions: Sequence[tuple[str, AbstractReduction]]) -> Observation | None:
    if not reductions:
        return None
    quantities = _quantities(reductions)
    searches = [(quantities.index(item.quantity), sign) for _, item in reductions for sign in item.signs]
    return Observation(values, quantities, tuple(searches), any(item.is_integral for _, item in reductions))


def _quantities(reductions: Sequence[tuple[str, AbstractReduction]]) -> tuple[Quantity, ...]:
    return tuple(dict.fromkeys(item.quantity for _, item in reductions))


def _reports(reductions: Sequence[tuple[str, AbstractReduction]], found: Found | None) -> dict[str, Array]:
    """What the reductions report of one run, by name."""
    if found is None:
        return {}
    quantities, reports = _quantities(reductions), {}
    extremes = iter(zip(found.extremes, found.times, strict=True))
    for name, item in reductions:
        k = quantities.index(item.quantity)
        own = [next(extremes) for _ in item.signs]
        observed = Observed(found.start[k], tuple(v for v, _ in own), tuple(t for _, t in own), found.integrals[k])
        reports |= {name + end: value for end, value in item.result(observed).items()}
    return reports


def solved_in_blocks(
    settings: Settings, parameters: Any, *others: Any, block: int | None, threads: int | None
) -> tuple[Any, ...]:
    """The results of the program for all runs; ``others`` are times and tolerances, each with the runs as leading axis.

    - ``block``, ``threads``: as in :func:`~jaxball.ensemble.simulate_ensemble`.
    """
    leaves, structure = jax.tree.flatten(parameters)
    times, *tolerances = map(np.asarray, others)
    runs = len(times)
    natively = native.chosen() == "native" and native.usable([*leaves, *others])
    on_cpu = jax.default_backend() == "cpu"
    threads = threads or (cores() if on_cpu else jax.local_device_count())
    most = (NATIVE_BLOCK if natively else XLA_BLOCK) if on_cpu else runs
    block = block or min(runs, even_size(runs, most, threads))
    if natively:
        block = _filling_vectors(block)
    settings = settings._replace(lanes=min(settings.lanes or block, block))
    own = list(zip(map(np.asarray, leaves), settings.shared, strict=True))

    def call(places: np.ndarray) -> Any:
        parts = [leaf if shared else leaf[places] for leaf, shared in own]
        spans = times[places]
        # A run that only pads a block ends as it begins.
        spans[np.append(False, places[1:] == places[:-1])] = spans[-1, :1]
        given = structure.unflatten(parts), spans, *(x[places] for x in tolerances)
        return solved(settings, *given)

    shapes = tuple(leaf.shape if shared else leaf.shape[1:] for leaf, shared in own)
    key = settings, structure, shapes, block, times.shape[1]
    blocks = in_threads(call, runs, block, threads, compiled=_is_warm(key))
    executed = sum(int(one[-1]) for one in blocks)
    # Not jnp.asarray, for which XLA compiles a program for every shape.
    return jax.device_put((*unpadded([one[:-1] for one in blocks], runs), np.asarray(executed)))


def _is_warm(key: Any) -> bool:
    """Whether there is a program for this already; there will be one now."""
    try:
        known = key in _warm
    except TypeError:  # a solver that carries arrays has no hash
        return False
    _warm.add(key)
    return known


def _filling_vectors(block: int) -> int:
    """A number of runs that fills vectors: with fewer, the compiler would use none, and results differ by rounding."""
    return max(native.FEWEST, -(-block // native.LANES)) * native.LANES
