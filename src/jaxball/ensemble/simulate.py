"""The one entry function for many runs: systems that differ in numbers, times and states in, trajectories out."""

from collections.abc import Mapping
from typing import Any, cast

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .._arrays import Numbers
from ..simulable import SimulableState, SimulableSystem
from ..simulation import DEFAULT_SOLVER, DEFAULT_TOLERANCE, checked_tolerances
from ..trajectory import Trajectory
from .ensemble import Ensemble
from .numbers import split
from .program import Settings, compiled
from .reductions import AbstractReduction
from .runge_kutta import fits
from .threads import balanced, cores, in_blocks

LANES = 96
BLOCK = 4096

# The programs that are compiled, by all that they are compiled for.
_warm: set[Any] = set()


def simulate_ensemble(
    system: SimulableSystem,
    times: Numbers,
    state: SimulableState,
    *,
    solver: diffrax.AbstractSolver | None = None,
    rtol: Numbers = DEFAULT_TOLERANCE,
    atol: Numbers = DEFAULT_TOLERANCE,
    max_steps: int = 16384,
    reductions: Mapping[str, AbstractReduction] | None = None,
    lanes: int | None = None,
    block: int | None = None,
    threads: int | None = None,
) -> Ensemble:
    """Many runs of systems of one structure; each is what :func:`jaxball.simulate` makes of it, to the tolerances.

    **Arguments:**

    - ``system``, ``state``: every array has the runs as leading axis, as ``jax.vmap`` takes them and ``jax.tree.map``
      with ``np.stack`` makes them. What all runs share may be ``np.broadcast_to(array, (runs, ...))``, and costs less.
    - ``times``: of shape (runs, T), or (T,) for all runs.
    - ``solver``: an explicit method of diffrax whose last stage is the first of the next step: ``Dopri8()`` if not
      given, ``Dopri5()``, ``Tsit5()``, ``Bosh3()``.
    - ``rtol``, ``atol``: for all runs, or of shape (runs,).
    - ``max_steps``: as for one run.
    - ``reductions``: what to find of each run while it is computed, by name: some of ``jaxball.ensemble.REDUCTIONS``,
      or any :class:`Maximum`, :class:`Minimum`, :class:`Drift` or :class:`Integral` of a function of one's own.
    - ``lanes``: how many runs are computed side by side. 96 if not given, which was fastest on the CPU that was
      measured; all of a block on a GPU.
    - ``block``: how many runs a compiled program takes at a time. If not given, as many for each thread, and no more
      than 4096; all on a GPU.
    - ``threads``: how many blocks are computed at a time: as many as this process has cores if not given.

    A run that fails has its status and NaN, and harms no other. Within ``jax.jit`` and under ``jax.jvp``, all runs are
    one block. Derivatives are forward: ``jax.jvp``, ``jax.jacfwd``.

    **Raises:** ``ValueError`` where leading axes differ, ``TypeError`` for other solvers, and
    :class:`~jaxball.PrecisionError` when float32 cannot reach the tolerances.
    """
    method = DEFAULT_SOLVER if solver is None else solver
    if not fits(method):
        raise TypeError(
            "Argument `solver` must be an explicit Runge-Kutta method of diffrax whose last stage is the first of the "
            f"next step, such as Dopri8, Dopri5, Tsit5 or Bosh3, but it is a {type(method).__name__}; use jax.vmap of "
            "jaxball.simulate for other methods."
        )
    rtol, atol = checked_tolerances(rtol, atol)
    given = times if isinstance(times, jax.Array) else np.asarray(times, rtol.dtype)
    runs = _count(system, state, given, rtol, atol)
    whole = given if given.ndim == 2 else jnp.broadcast_to(given, (runs, given.shape[-1]))
    limits = tuple(x if x.ndim else jnp.broadcast_to(x, (runs,)) for x in (rtol, atol))
    leaves = jax.tree.leaves((system, state, whole, limits))
    traced = any(isinstance(leaf, Tracer) for leaf in (*leaves, jnp.zeros(())))
    wide, threads = jax.default_backend() != "cpu", threads or cores()
    block = runs if traced else min(runs, block or (runs if wide else balanced(runs, BLOCK, threads)))
    compact, which = split((system, state))
    settings = Settings(
        cast(diffrax.AbstractERK, method),
        max_steps,
        min(block, lanes or (block if wide else LANES)),
        which,
        tuple((reductions or {}).items()),
    )
    program = compiled(settings)
    if traced:
        *found, reported, executed = program(compact, whole, *limits)
        return Ensemble(Trajectory(system, whole, *found), reported, executed)

    arrays = tuple(np.asarray(x) for x in (whole, *limits))
    structure = jax.tree.structure(compact)
    own = [leaf if one else np.asarray(leaf) for leaf, one in zip(jax.tree.leaves(compact), which, strict=True)]

    def take(places: np.ndarray) -> Any:
        part = structure.unflatten([leaf if one else leaf[places] for leaf, one in zip(own, which, strict=True)])
        spans, *others = (x[places] for x in arrays)
        # A run that is there only to fill a block is over as it begins.
        spans[np.append(False, places[1:] == places[:-1])] = spans[-1, :1]
        return part, spans, *others

    key = settings, structure, tuple(leaf.shape[1:] for leaf in own), block, whole.shape[1]
    blocks = in_blocks(lambda part: program(*part), take, runs, block, threads, key in _warm)
    _warm.add(key)
    return _joined(blocks, system, whole, runs)


def _count(system: Any, state: Any, times: Any, *tolerances: Any) -> int:
    counts = {np.shape(leaf)[0] if np.ndim(leaf) else None for leaf in jax.tree.leaves((system, state))}
    counts |= {times.shape[0]} if times.ndim == 2 else set()
    counts |= {x.shape[0] for x in tolerances if x.ndim}
    runs = next(iter(counts)) if len(counts) == 1 else None
    if runs is None:
        raise ValueError(
            "Arguments `system`, `state`, `times` and tolerances must have the same number of runs as leading axis of "
            f"every array, but the leading axes are {sorted(counts, key=str)}; stack systems with jax.tree.map."
        )
    return runs


def _joined(blocks: list[Any], system: SimulableSystem, times: Any, runs: int) -> Ensemble:
    executed = sum(int(block[-1]) for block in blocks)
    *found, reported = jax.tree.map(
        lambda *parts: jnp.asarray(np.concatenate(parts)[:runs]), *(block[:-1] for block in blocks)
    )
    return Ensemble(Trajectory(system, times, *found), reported, jnp.asarray(executed))
