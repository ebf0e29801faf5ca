"""How the rows of a chunk are solved: in lanes, or, for every method, under vmap."""

import functools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import numpy as np

from ..ensemble import AbstractReduction, simulate_ensemble
from ..ensemble.quantities import CONTACT as CONTACT_REDUCTIONS
from ..numerics import programs
from ..numerics.batches import in_batches
from ..physics.body import AbstractBody
from ..scenario.solvers import SOLVERS
from ..simulation.events import Detachment
from ..simulation.extremes import contact_extremes
from ..simulation.simulate import FEW_STEPS, simulate
from ..simulation.variables import EXTREMES
from .outputs import contact_results
from .rows import Batch, Request
from .study import solved_in_lanes

LANES = 64


class _Method(NamedTuple):
    """What a program is compiled for."""

    solver: str
    max_steps: int
    step_to_times: bool
    dae: bool
    project: bool
    contact: bool
    detachment: bool

    @property
    def needs_dense(self) -> bool:
        """Whether it needs dense output."""
        return self.contact or self.detachment


def solve_by_vmap(batch: Batch, request: Request) -> dict[str, np.ndarray]:
    """The rows, ``LANES`` side by side, by :func:`jaxball.simulate` under ``vmap``; an ``Engine``."""
    common = {
        name: getattr(batch.template, name) for name in ("solver", "max_steps", "step_to_times", "dae", "project")
    }
    method = _Method(**common, contact=request.contact, detachment=request.detachment)
    stacked = (batch.system, batch.times, batch.state, batch.rtol, batch.atol, batch.contact)
    return in_batches(functools.partial(_run, method), stacked, min(LANES, request.most))


def _run(method: _Method, stacked: Any) -> dict[str, Any]:
    """The solves. Dense output is for few steps at first, because it is a large array."""
    for few in FEW_STEPS if method.needs_dense else ():
        if few < method.max_steps:
            results = _program(method._replace(max_steps=few))(*stacked)
            if int(np.max(results["steps"])) < few:
                return results
    return _program(method)(*stacked)


@functools.cache
def _program(method: _Method) -> Callable[..., dict[str, Any]]:
    return programs.jit(functools.partial(_solve, method))


def _solve(method: _Method, *stacked: Any) -> dict[str, Any]:
    return jax.vmap(functools.partial(_solve_one, method))(*stacked)


def _solve_one(
    method: _Method, system: Any, times: Any, state: Any, rtol: Any, atol: Any, contact: Any
) -> dict[str, Any]:
    trajectory = simulate(
        system,
        times,
        state,
        solver=SOLVERS[method.solver](),
        rtol=rtol,
        atol=atol,
        max_steps=method.max_steps,
        step_to_times=method.step_to_times,
        dae=method.dae,
        project=method.project,
        dense=method.needs_dense,
        events={"detachment": Detachment()} if method.detachment else None,
        contact=contact,
    )
    touches = method.contact and isinstance(system, AbstractBody)
    extremes = contact_extremes(trajectory) if touches else None
    results = {name: getattr(trajectory, name) for name in ("status", "steps", "rejected", "reached")}
    results |= vars(trajectory.state) | contact_results(trajectory)
    return results if extremes is None else results | {name: getattr(extremes, name) for name in EXTREMES}


# The same for any number of threads, so that results are the same to the last bit.
BLOCK = 2048


def solve_in_lanes(batch: Batch, request: Request) -> dict[str, np.ndarray]:
    """The rows by :func:`jaxball.ensemble.simulate_ensemble` where it supports the method; an ``Engine``.

    Other methods (implicit ones, the DAE, projection, steps to saved times) are left to :func:`jaxball.simulate` under
    ``vmap``, and so are the runs that end where the ball detaches.

    **Arguments:**

    - ``batch``: the rows.
    - ``request``: what to compute for them.
    """
    if not solved_in_lanes(batch.template):
        return solve_by_vmap(batch, request)
    solved = _solved(batch, request, _contact(batch, request) | _finds(request))
    if not request.detachment:
        return solved
    detached = np.flatnonzero(solved["least_normal_force"] <= 0)
    ended = _ended(batch.take(detached), request) if detached.size else {}
    return solved | {name: _replaced(solved[name], detached, array) for name, array in ended.items()}


def _solved(batch: Batch, request: Request, reductions: Mapping[str, AbstractReduction]) -> dict[str, np.ndarray]:
    first = batch.template
    system, state = batch.shared_once()
    ensemble = simulate_ensemble(
        system,
        batch.times,
        state,
        in_axes=batch.in_axes,
        contact=batch.contact,
        solver=SOLVERS[first.solver](),
        rtol=batch.rtol,
        atol=batch.atol,
        max_steps=first.max_steps,
        reductions=reductions,
        block=min(request.most, BLOCK),
        threads=request.threads,
    )
    trajectory = ensemble.trajectory
    rows = {name: np.asarray(getattr(trajectory, name)) for name in ("status", "steps", "rejected", "reached")}
    results = vars(trajectory.state) | contact_results(trajectory) | ensemble.reductions
    return rows | jax.tree.map(np.asarray, results)


def _ended(batch: Batch, request: Request) -> dict[str, np.ndarray]:
    """Runs that end where the ball detaches, and their results until then."""
    ended = solve_by_vmap(batch, request)
    finds = _finds(request)
    if not finds:
        return ended
    until = np.stack([batch.times[:, 0], ended["reached"]], axis=1)
    results = _solved(batch._replace(times=until), request, finds)
    return ended | {name + end: results[name + end] for name, item in finds.items() for end in item.ends}


def _contact(batch: Batch, request: Request) -> dict[str, AbstractReduction]:
    if not isinstance(batch.template.system, AbstractBody):
        return {}
    names = CONTACT_REDUCTIONS if request.contact else ("least_normal_force",) if request.detachment else ()
    return {name: CONTACT_REDUCTIONS[name] for name in names}


def _finds(request: Request) -> dict[str, AbstractReduction]:
    return {find.name: find.reduction() for find in request.finds}


def _replaced(array: np.ndarray, rows: np.ndarray, values: np.ndarray) -> np.ndarray:
    array = array.copy()
    array[rows] = values
    return array
