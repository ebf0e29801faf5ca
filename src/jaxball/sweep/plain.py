"""Rows by one call of simulate under vmap: slower, and for every method."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

from ..physics.body import Ball, Disk
from ..scenario.solve import SOLVERS
from ..simulation.events import Detachment
from ..simulation.extremes import contact_extremes
from ..simulation.simulate import FEW_STEPS, simulate
from .batch import Batch, Wanted
from .outputs import CONTACT

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
    def looks_within_steps(self) -> bool:
        """Whether it needs dense output."""
        return self.contact or self.detachment


def solve_by_vmap(batch: Batch, wanted: Wanted) -> dict[str, np.ndarray]:
    """The rows, ``LANES`` side by side, by :func:`jaxball.simulate` under ``vmap``; an ``Engine``."""
    parts = [batch.take(slice(start, start + LANES)) for start in range(0, batch.rows, LANES)]
    found = [_solve_part(part, wanted) for part in parts]
    return {name: np.concatenate([part[name] for part in found]) for name in found[0]}


def _solve_part(batch: Batch, wanted: Wanted) -> dict[str, np.ndarray]:
    # Programs are compiled for a number of lanes; the last scenario fills those that are left over.
    padded = batch.take(np.minimum(np.arange(min(LANES, wanted.most)), batch.rows - 1))
    first = batch.template
    as_single = (first.solver, first.max_steps, first.step_to_times, first.dae, first.project)
    method = _Method(*as_single, wanted.contact, wanted.detachment)
    stacked = (padded.system, padded.times, padded.state, padded.rtol, padded.atol)
    state, reached, status, steps, rejected, extremes = jax.tree.map(np.asarray, _run(method, stacked))
    found = {"status": status, "steps": steps, "rejected": rejected, "reached": reached, **vars(state)}
    if extremes is not None:
        found |= {name: getattr(extremes, name) for name in CONTACT}
    return {name: array[: batch.rows] for name, array in found.items()}


def _run(method: _Method, stacked: Any) -> Any:
    """The solves. Dense output has room for few steps at first, because it is a large array."""
    for room in FEW_STEPS if method.looks_within_steps else ():
        if room < method.max_steps:
            found = _program(method._replace(max_steps=room))(*stacked)
            if int(np.max(found[3])) < room:
                return found
    return _program(method)(*stacked)


@functools.cache
def _program(method: _Method) -> Callable[..., Any]:
    def one(system, times, state, rtol, atol):
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
            dense=method.looks_within_steps,
            events={"detachment": Detachment()} if method.detachment else None,
        )
        touches = method.contact and isinstance(system, Ball | Disk)
        extremes = contact_extremes(trajectory) if touches else None
        return (
            trajectory.state,
            trajectory.reached,
            trajectory.status,
            trajectory.steps,
            trajectory.rejected,
            extremes,
        )

    return jax.jit(jax.vmap(one))
