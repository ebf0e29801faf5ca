"""The one entry function for many runs: systems that differ in numbers, times and states in, trajectories out."""

from collections.abc import Mapping
from typing import Any, cast

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from ..interface.arguments import described, require
from ..numerics.arrays import Numbers, to_numpy
from ..physics.system import AbstractState, AbstractSystem, require_state
from ..simulation.simulate import DEFAULT_SOLVER, DEFAULT_TOLERANCE, checked_steps, checked_tolerances
from ..simulation.trajectory import Trajectory
from .ensemble import Ensemble
from .numbers import split
from .program import Settings, compiled
from .reductions import AbstractReduction
from .runge_kutta import fits
from .threads import balanced, cores, in_blocks

LANES = 64
BLOCK = 4096

# The programs that are compiled, by all that they are compiled for.
_warm: set[Any] = set()


def simulate_ensemble(
    system: AbstractSystem,
    times: Numbers,
    state: AbstractState,
    *,
    solver: diffrax.AbstractSolver | None = None,
    rtol: Numbers = DEFAULT_TOLERANCE,
    atol: Numbers = DEFAULT_TOLERANCE,
    max_steps: int = 16384,
    reductions: Mapping[str, AbstractReduction] | None = None,
    lanes: int | None = None,
    block: int | None = None,
    threads: int | None = None,
    inside: bool = True,
) -> Ensemble:
    """Many runs of systems of one structure; each is what :func:`jaxball.simulate` makes of it, to the tolerances.

    **Arguments:**

    - ``system``, ``state``: every array has the runs as leading axis, as ``jax.vmap`` takes them and ``jax.tree.map``
      with ``np.stack`` makes them. What all runs share may be ``np.broadcast_to(array, (runs, ...))``, and costs less;
      so do, where there is one run, the arrays that are NumPy's.
    - ``times``: of shape (runs, T), or (T,) for all runs.
    - ``solver``: an explicit method of diffrax whose last stage is the first of the next step: ``Dopri8()`` if not
      given, ``Dopri5()``, ``Tsit5()``, ``Bosh3()``.
    - ``rtol``, ``atol``: for all runs, or of shape (runs,).
    - ``max_steps``: as for one run.
    - ``reductions``: what to find of each run while it is computed, by name: some of ``jaxball.ensemble.REDUCTIONS``,
      or any :class:`Maximum`, :class:`Minimum`, :class:`Drift` or :class:`Integral` of a function of one's own.
    - ``lanes``: how many runs are computed side by side. 64 if not given, which was fastest on the CPU that was
      measured; all of a block on a GPU.
    - ``block``: how many runs a compiled program takes at a time; fewer are filled up, so that calls with other numbers
      of runs share it. If not given, as many for each thread, and no more than 4096; on GPUs, as many for each of them.
    - ``threads``: how many blocks are computed at a time: as many as this process has cores, or GPUs, if not given.
    - ``inside``: whether rails and masses must be in the body, as for one run.

    A run that fails has its status and NaN, and harms no other. Within ``jax.jit`` and under ``jax.jvp``, all runs are
    one block. Derivatives are forward: ``jax.jvp``, ``jax.jacfwd``.

    **Raises:** ``ValueError`` where leading axes differ, ``TypeError`` for other solvers, and
    :class:`~jaxball.PrecisionError` when float32 cannot reach the tolerances.
    """
    require_state(system, state)
    method = _checked_solver(DEFAULT_SOLVER if solver is None else solver)
    rtol, atol = checked_tolerances(rtol, atol)
    given = times if isinstance(times, jax.Array) else to_numpy(times, "times").astype(rtol.dtype)
    reductions = _checked_reductions(reductions)
    runs = _count(system, state, given, rtol, atol)
    whole = given if given.ndim == 2 else jnp.broadcast_to(given, (runs, given.shape[-1]))
    limits = tuple(x if x.ndim else jnp.broadcast_to(x, (runs,)) for x in (rtol, atol))
    leaves = jax.tree.leaves((system, state, whole, limits))
    traced = any(isinstance(leaf, Tracer) for leaf in (*leaves, jnp.zeros(())))
    on_cpu = jax.default_backend() == "cpu"
    threads = threads or (cores() if on_cpu else jax.local_device_count())
    block = runs if traced else block or min(runs, balanced(runs, BLOCK if on_cpu else runs, threads))
    compact, which = split((system, state))
    reduced = tuple(reductions.items())
    size = min(block, lanes or (LANES if on_cpu else block))
    settings = Settings(method, checked_steps(max_steps), size, which, reduced, inside)
    if traced:
        *found, reported, executed = compiled(settings)(compact, whole, *limits)
        return Ensemble(Trajectory(system, whole, *found, start=state), reported, executed)
    blocks = _in_blocks(settings, compact, tuple(np.asarray(x) for x in (whole, *limits)), block, threads)
    return _joined(blocks, system, whole, state, runs)


def _checked_solver(solver: diffrax.AbstractSolver) -> diffrax.AbstractERK:
    if not fits(solver):
        raise TypeError(
            "Argument `solver` must be an explicit Runge-Kutta method of diffrax whose last stage is the first of the "
            f"next step, such as Dopri8, Dopri5, Tsit5 or Bosh3, but it is {described(solver)}; use jax.vmap of "
            "jaxball.simulate for other methods."
        )
    return cast(diffrax.AbstractERK, solver)


def _checked_reductions(reductions: Mapping[str, AbstractReduction] | None) -> Mapping[str, AbstractReduction]:
    found = {} if reductions is None else reductions
    require("reductions", found, Mapping, "a dictionary of reductions by name, some of jaxball.ensemble.REDUCTIONS")
    for name, one in found.items():
        must = "one of jaxball.ensemble.REDUCTIONS, or a Maximum, Minimum, Drift or Integral"
        require(f"reductions[{name!r}]", one, AbstractReduction, must)
    return found


def _in_blocks(settings: Settings, compact: Any, arrays: tuple[np.ndarray, ...], block: int, threads: int) -> list[Any]:
    """What the compiled program finds of each block; ``arrays`` are times and tolerances."""
    leaves, structure = jax.tree.flatten(compact)
    own = [leaf if one else np.asarray(leaf) for leaf, one in zip(leaves, settings.shared, strict=True)]
    program = compiled(settings)

    def take(places: np.ndarray) -> Any:
        parts = [leaf if one else leaf[places] for leaf, one in zip(own, settings.shared, strict=True)]
        spans, *others = (x[places] for x in arrays)
        # A run that is there only to fill a block is over as it begins.
        spans[np.append(False, places[1:] == places[:-1])] = spans[-1, :1]
        return structure.unflatten(parts), spans, *others

    key = settings, structure, tuple(leaf.shape[1:] for leaf in own), block, arrays[0].shape[1]
    blocks = in_blocks(lambda part: program(*part), take, len(arrays[0]), block, threads, key in _warm)
    _warm.add(key)
    return blocks


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


def _joined(blocks: list[Any], system: AbstractSystem, times: Any, state: AbstractState, runs: int) -> Ensemble:
    executed = sum(int(block[-1]) for block in blocks)
    *found, reported = jax.tree.map(
        lambda *parts: jnp.asarray(np.concatenate(parts)[:runs]), *(block[:-1] for block in blocks)
    )
    return Ensemble(Trajectory(system, times, *found, start=state), reported, jnp.asarray(executed))
