"""One run by the engine of ensembles: a lane of its own, in a program of numbers."""

import functools
from collections.abc import Callable
from typing import Any

import diffrax
import jax
from jaxtyping import Array

from ..numerics.arrays import Numbers
from ..physics.system import AbstractState, AbstractSystem, require_state
from ..simulation.simulate import (
    DEFAULT_SOLVER,
    DEFAULT_TOLERANCE,
    at_rest,
    checked_steps,
    checked_times,
    checked_tolerances,
)
from ..simulation.trajectory import Trajectory
from .program import Settings, compiled
from .simulate import checked_method


def simulate_one(
    system: AbstractSystem,
    times: Numbers,
    state: AbstractState | None = None,
    *,
    solver: diffrax.AbstractSolver | None = None,
    rtol: Numbers = DEFAULT_TOLERANCE,
    atol: Numbers = DEFAULT_TOLERANCE,
    max_steps: int = 16384,
    inside: bool = True,
) -> Trajectory[Any, Any]:
    """What :func:`jaxball.simulate` returns, to the tolerances, by the engine of ensembles.

    **Arguments:**

    - ``system``, ``state``, ``rtol``, ``atol``, ``max_steps``, ``inside``: as for :func:`jaxball.simulate`.
    - ``times``: of shape (T,), increasing, two or more.
    - ``solver``: as for :func:`simulate_ensemble`.

    Derivatives are forward: ``jax.jvp``, ``jax.jacfwd``.

    **Raises:** ``TypeError`` for other solvers, ``ValueError`` for times that are not two or more and increasing, and
    :class:`~jaxball.PrecisionError` when float32 cannot reach the tolerances.

    **Example:**

    >>> import jax
    >>> jax.config.update("jax_enable_x64", True)
    >>> from jaxball import Disk, DiskState
    >>> from jaxball.ensemble import simulate_one
    >>> run = simulate_one(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], DiskState(phidot=-1.0))
    >>> print(run.state.z)
    [0. 1. 2.]
    """
    times = checked_times(times)
    if state is None:
        state = at_rest(system)
    require_state(system, state)
    rtol, atol = checked_tolerances(rtol, atol)
    settings = Settings(
        solver=checked_method(DEFAULT_SOLVER if solver is None else solver),
        max_steps=checked_steps(max_steps),
        lanes=1,
        shared=tuple(True for _ in jax.tree.leaves((system, state))),
        reductions=(),
        inside=inside,
    )
    solved = _compiled(settings)((system, state), times, rtol, atol)
    return Trajectory(system, times, *solved, start=state)


@functools.cache
def _compiled(settings: Settings) -> Callable[..., Any]:
    """The program of a block of one run, without the axis of runs and what only ensembles report."""

    @jax.jit
    def program(parameters: Any, times: Array, rtol: Array, atol: Array) -> tuple[Any, ...]:
        *solved, _, _ = compiled(settings)(parameters, times[None], rtol[None], atol[None])
        return tuple(jax.tree.map(lambda x: x[0], solved))

    return program
