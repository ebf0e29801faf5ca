"""The one entry function for many runs: systems that differ in numbers, times and states in, trajectories out."""

import functools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from .._arrays import Numbers
from ..lanes import LaneProgram
from ..packing import Packing
from ..simulable import SimulableState, SimulableSystem
from ..simulation import DEFAULT_SOLVER, DEFAULT_TOLERANCE, checked_tolerances
from ..status import Status
from ..step_size import by_tolerances, kinks_of, to_kinks
from ..trajectory import Trajectory
from ..validity import possible_start
from .control import Limits
from .ensemble import Ensemble
from .numbers import Prepared, axes, first, split
from .reductions import AbstractReduction
from .rows import Method, Rows, Solved, solve_rows
from .runge_kutta import fits
from .threads import cores, in_blocks
from .watched import Watched

LANES = 96
BLOCK = 4096


class _Program(NamedTuple):
    """What a program is compiled for."""

    solver: diffrax.AbstractERK
    max_steps: int
    lanes: int
    rows: int
    shared: tuple[bool, ...]
    reductions: tuple[tuple[str, AbstractReduction], ...]


def simulate_ensemble(
    system: SimulableSystem,
    times: Numbers,
    state: SimulableState,
    *,
    solver: diffrax.AbstractERK | None = None,
    rtol: Numbers = DEFAULT_TOLERANCE,
    atol: Numbers = DEFAULT_TOLERANCE,
    max_steps: int = 16384,
    reductions: Mapping[str, AbstractReduction] | None = None,
    lanes: int | None = None,
    block: int | None = None,
    threads: int | None = None,
) -> Ensemble:
    """Many runs of systems of one structure; each is what :func:`jaxball.simulate` makes of it.

    **Arguments:**

    - ``system``, ``state``: every array has the runs as leading axis, as ``jax.vmap`` takes and ``jax.tree.map`` over
      ``np.stack`` makes them. What all runs share may be given as ``np.broadcast_to(array, (runs, ...))``, and costs less.
    - ``times``: of shape (runs, T), or (T,) for all runs.
    - ``solver``: an explicit method of diffrax whose last stage is the first of the next step: ``Dopri8()`` if not given,
      ``Dopri5()``, ``Tsit5()``, ``Bosh3()``.
    - ``rtol``, ``atol``: for all runs, or of shape (runs,).
    - ``max_steps``: as for one run.
    - ``reductions``: what to find of each run while it is computed, by name: those of ``jaxball.ensemble.REDUCTIONS``, or
      any :class:`Maximum`, :class:`Minimum`, :class:`Drift` or :class:`Integral` of a function of one's own.
    - ``lanes``: how many runs are computed side by side. 96 if not given, which was fastest on the CPUs that were measured;
      all of a block on a GPU.
    - ``block``: how many runs a compiled program takes at a time: 4096 if not given, all on a GPU.
    - ``threads``: how many blocks are computed at a time: as many as this process has cores if not given.

    A run that fails has its status and NaN, and harms no other. Within ``jax.jit`` and under ``jax.jvp`` all runs are one
    block.

    **Raises:** ``ValueError`` where leading axes differ, ``TypeError`` for other solvers, and
    :class:`~jaxball.PrecisionError` when float32 cannot reach the tolerances.
    """
    method = DEFAULT_SOLVER if solver is None else solver
    if not fits(method):
        raise TypeError(
            "Argument `solver` must be an explicit Runge-Kutta method of diffrax whose last stage is the first of the next "
            f"step, such as Dopri8, Dopri5, Tsit5 or Bosh3, but it is a {type(method).__name__}; use jax.vmap of "
            "jaxball.simulate for other methods."
        )
    rtol, atol = checked_tolerances(rtol, atol)
    runs = _count(system, state, times, rtol, atol)
    times = times if np.ndim(times) == 2 else np.broadcast_to(np.asarray(times, rtol.dtype), (runs, np.shape(times)[-1]))
    rtol, atol = (x if np.ndim(x) else np.broadcast_to(x, (runs,)) for x in (rtol, atol))
    given = (system, times, state, rtol, atol)
    wide = jax.default_backend() != "cpu"
    traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(given)) or isinstance(jnp.zeros(()), Tracer)
    block = runs if traced else min(runs, block or (runs if wide else BLOCK))
    lanes = min(block, lanes or (block if wide else LANES))
    compact, which = split((system, state))
    program = _compiled(_Program(method, max_steps, lanes, block, which, tuple((reductions or {}).items())))
    if traced:
        *found, extra, executed = program(compact, times, rtol, atol)
        return Ensemble(Trajectory(system, times, *found), extra, executed)

    def take(places: np.ndarray) -> Any:
        # A run that is there only to fill a block is over as it begins.
        leaves, structure = jax.tree.flatten(compact)
        own = [leaf if one else np.asarray(leaf)[places] for leaf, one in zip(leaves, which, strict=True)]
        spans = np.array(np.asarray(times)[places])
        spans[np.append(False, places[1:] == places[:-1])] = spans[-1, :1]
        return structure.unflatten(own), spans, *(np.asarray(x)[places] for x in (rtol, atol))

    found = in_blocks(lambda part: program(*part), take, runs, block, threads or cores())
    return _joined(found, system, times, runs)


def _count(*given: Any) -> int:
    system, state, times, *tolerances = given
    leaves = [*jax.tree.leaves((system, state))]
    counts = {np.shape(leaf)[0] if np.ndim(leaf) else None for leaf in leaves}
    counts |= {np.shape(times)[0]} if np.ndim(times) == 2 else set()
    counts |= {np.shape(x)[0] for x in tolerances if np.ndim(x)}
    if len(counts) != 1 or None in counts:
        raise ValueError(
            "Arguments `system`, `state`, `times` and tolerances must have the same number of runs as leading axis of "
            f"every array, but the leading axes are {sorted(counts, key=str)}; stack systems with jax.tree.map."
        )
    return counts.pop()


@functools.cache
def _compiled(program: _Program) -> Callable[..., Any]:
    return jax.jit(functools.partial(_solve, program))


def _solve(program: _Program, compact: Any, times: Array, rtol: Array, atol: Array) -> Any:
    """States, statuses and counts, with the runs as leading axis."""
    rows, t0, t1 = times.shape[0], times[:, 0], times[:, -1]
    along = axes(compact, program.shared)
    system, state = compact
    shares = program.shared[: len(jax.tree.leaves(system))]

    def each(function: Callable[..., Any], *others: Array) -> Any:
        return jax.vmap(function, in_axes=(*along, *(0 for _ in others)))(system, state, *others)

    startable = each(lambda system, state, t: possible_start(system, t, state), t0)
    x = each(lambda system, state, t: Packing.of(system.prepare(), state).pack(t, state), t0)
    startable = startable & jnp.all(jnp.isfinite(x), axis=1)
    kinks = jnp.broadcast_to(each(lambda system, state: kinks_of(system)), (rows, _kink_count(compact, program.shared)))
    like = first(compact, program.shared)

    def field(system, t, x):
        return Packing.of(system.prepare(), like[1]).field(t, x)

    lane_program = LaneProgram(field, like[0], np.zeros((), x.dtype), np.zeros(x.shape[1:], x.dtype))
    prepared = Prepared.of(lane_program, system, shares, rows)
    watched = Watched.of(program.solver, program.reductions, like, system, shares, times, x)
    solved = solve_rows(
        Method(
            prepared,
            program.solver.tableau,
            program.solver.error_order(diffrax.ODETerm(lambda t, y, args: y)),
            lambda kinks, rtol, atol: to_kinks(by_tolerances(rtol, atol), kinks),
            program.max_steps,
        ),
        Rows(prepared.moving, t0, jnp.where(startable, t1, t0), x.T, Limits(kinks.T, rtol, atol), watched.given),
        program.lanes,
        watched.observers,
    )
    status = _status(solved, startable, t1)
    states = _states(solved.x.T, watched.saved(solved.observed), x, startable, status)
    unpacked = each(
        lambda system, state, times, states: jax.vmap(Packing.of(system.prepare(), state).unpack)(times, states),
        times,
        states,
    )
    reached = jnp.where(startable, jnp.minimum(solved.t, t1), t0)
    extra = watched.reduced(solved.observed, t0, x.T)
    extra = {name: jnp.where(startable, value, jnp.nan) for name, value in extra.items()}
    return unpacked, reached, status, solved.steps, solved.rejected, extra, solved.executed


def _kink_count(compact: Any, shared: tuple[bool, ...]) -> int:
    return jax.eval_shape(kinks_of, first(compact, shared)[0]).shape[0]


def _status(solved: Solved, startable: Array, t1: Array) -> Array:
    status = jnp.where(solved.t < t1, Status.MAX_STEPS, Status.SUCCESS)
    status = jnp.where(solved.finite, status, Status.NOT_FINITE)
    return jnp.where(startable, status, Status.IMPOSSIBLE)


def _states(
    end: Float[Array, "rows size"],
    between: Float[Array, "rows between size"],
    x: Float[Array, "rows size"],
    startable: Array,
    status: Array,
) -> Float[Array, "rows times size"]:
    """The vectors at all times; NaN at those to which a run did not come."""
    end = jnp.where((status == Status.SUCCESS)[:, None], end, jnp.nan)
    found = jnp.concatenate([x[:, None], between, end[:, None]], axis=1)
    return jnp.where(startable[:, None, None], found, jnp.nan)


def _joined(blocks: list[Any], system: SimulableSystem, times: Numbers, runs: int) -> Ensemble:
    executed = sum(int(block[-1]) for block in blocks)
    *found, extra = jax.tree.map(lambda *parts: np.concatenate(parts)[:runs], *(block[:-1] for block in blocks))
    return Ensemble(Trajectory(system, np.asarray(times), *found), extra, np.asarray(executed))
