"""Rows by :func:`jaxball.simulate` under ``vmap``: slower than lanes, but for every method."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

from ..numerics import programs
from ..numerics.batches import in_batches
from ..physics.body import AbstractBody
from ..scenario.solvers import SOLVERS
from ..simulation.events import Detachment
from ..simulation.extremes import contact_extremes
from ..simulation.simulate import FEW_STEPS, simulate
from ..simulation.variables import EXTREMES
from .batch import Batch, Wanted
from .outputs import contact_results

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
    common = {
        name: getattr(batch.template, name) for name in ("solver", "max_steps", "step_to_times", "dae", "project")
    }
    method = _Method(**common, contact=wanted.contact, detachment=wanted.detachment)
    stacked = (batch.system, batch.times, batch.state, batch.rtol, batch.atol, batch.contact)
    return in_batches(functools.partial(_run, method), stacked, min(LANES, wanted.most))


def _run(method: _Method, stacked: Any) -> dict[str, Any]:
    """The solves. Dense output has room for few steps at first, because it is a large array."""
    for room in FEW_STEPS if method.looks_within_steps else ():
        if room < method.max_steps:
            results = _program(method._replace(max_steps=room))(*stacked)
            if int(np.max(results["steps"])) < room:
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
        dense=method.looks_within_steps,
        events={"detachment": Detachment()} if method.detachment else None,
        contact=contact,
    )
    touches = method.contact and isinstance(system, AbstractBody)
    extremes = contact_extremes(trajectory) if touches else None
    results = {name: getattr(trajectory, name) for name in ("status", "steps", "rejected", "reached")}
    results |= vars(trajectory.state) | contact_results(trajectory)
    return results if extremes is None else results | {name: getattr(extremes, name) for name in EXTREMES}
