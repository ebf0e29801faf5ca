"""Solves the rows of a chunk of a study as an ensemble; the workers of ``executors`` call it."""

from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
from jaxtyping import Array

from .. import programs
from ..ensemble import AbstractReduction, simulate_ensemble
from ..ensemble.reductions import CONTACT as CONTACT_REDUCTIONS
from ..numerics.arrays import arrays_of
from ..physics.rolling import AbstractRollingSystem
from ..programs.batches import of_rows
from ..scenario.solvers import SOLVERS
from ..simulation.events import AbstractEvent, Detachment
from ..simulation.trajectory import Trajectory
from .outputs import history_results
from .rows import Batch, Request

# Rows that are computed together; results do not depend on it. A GPU has tens of thousands of threads.
ROWS_OF_CALL, ROWS_OF_CALL_ON_GPU = 2048, 2**17


def solve_in_lanes(batch: Batch, request: Request) -> dict[str, np.ndarray]:
    """Solves the rows by :func:`jaxball.ensemble.simulate_ensemble`; an ``Engine``.

    **Arguments:**

    - ``batch``: the rows.
    - ``request``: what to compute for them.
    """
    reductions = {**_contact(batch, request), **{find.name: find.reduction() for find in request.finds}}
    if batch.template.feedback is not None:
        return _solve_closed_loops(batch, request, reductions)
    detachment: dict[str, AbstractEvent] = {"detachment": Detachment()} if request.detachment else {}
    return _solve_rows(batch, request, reductions, detachment)


def _solve_rows(
    batch: Batch,
    request: Request,
    reductions: Mapping[str, AbstractReduction],
    others: dict[str, AbstractEvent],
) -> dict[str, np.ndarray]:
    """Solves the rows; ``others`` are events besides those of the scenario, of which nothing is kept."""
    first = batch.template
    # Arrays that are the same in all rows are not repeated for each, and what depends on them alone is computed once.
    system, state, events = batch.unstack_shared()
    *axes, axes_of_events = batch.in_axes
    ensemble = simulate_ensemble(
        system,
        batch.times,
        state,
        # Further events have no numbers that change.
        in_axes=(*axes, axes_of_events | dict.fromkeys(others)),
        events=events | others,
        contact=batch.contact,
        solver=SOLVERS[first.solver](),
        rtol=batch.rtol,
        atol=batch.atol,
        step_to_times=first.step_to_times,
        dae=first.dae,
        project=first.project,
        max_steps=first.max_steps,
        max_step=first.max_step,
        reductions=reductions,
        # As many for each call, so that all chunks share one compiled program.
        chunk=min(request.most, ROWS_OF_CALL if jax.default_backend() == "cpu" else ROWS_OF_CALL_ON_GPU),
        threads=request.threads,
    )
    trajectory = ensemble.trajectory
    rows = {name: np.asarray(getattr(trajectory, name)) for name in ("status", "steps", "rejected", "reached")}
    results = arrays_of(trajectory.state) | history_results(trajectory.history) | ensemble.reductions
    for name in events:
        seen = trajectory.events[name]
        results |= {f"{name}_count": seen.count, f"{name}_time": seen.times[:, 0]}
    if request.readings:
        results = results | _measure_rows(batch.sensors, trajectory)
    return rows | jax.tree.map(np.asarray, results)


def _measure_rows(sensors: Any, trajectory: Trajectory[Any, Any]) -> dict[str, Array]:
    """Reads the sensors of each row."""
    return {f"measured_{name}": read for name, read in _measure(sensors, trajectory).items()}


@programs.filter_jit
def _measure(sensors: Any, trajectory: Trajectory[Any, Any]) -> dict[str, Array]:
    return of_rows(lambda sensors, run: run.measured(sensors), sensors, trajectory)


def _solve_closed_loops(
    batch: Batch, request: Request, reductions: Mapping[str, AbstractReduction]
) -> dict[str, np.ndarray]:
    """Solves the rows of a scenario with feedback."""
    from .closed_loops import solve_loops  # which other studies do without

    return solve_loops(
        batch.template,
        batch.loop,
        batch.loop_changes,
        batch.sensors,
        request.within,
        reductions,
        request.readings,
        request.threads,
    )


def _contact(batch: Batch, request: Request) -> Mapping[str, AbstractReduction]:
    rolls = isinstance(batch.template.system, AbstractRollingSystem)
    return CONTACT_REDUCTIONS if request.contact and rolls else {}
