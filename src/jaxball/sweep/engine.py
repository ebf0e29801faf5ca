"""How the rows of a chunk are solved: as an ensemble."""

from collections.abc import Mapping

import jax
import numpy as np

from ..ensemble import AbstractReduction, simulate_ensemble
from ..ensemble.reductions import CONTACT as CONTACT_REDUCTIONS
from ..physics.body import AbstractBody
from ..scenario.solvers import SOLVERS
from ..simulation.events import AbstractEvent, Detachment
from .outputs import history_results
from .rows import Batch, Request

# The same for any number of threads, so that results are the same to the last bit.
BLOCK = 2048


def solve_in_lanes(batch: Batch, request: Request) -> dict[str, np.ndarray]:
    """The rows by :func:`jaxball.ensemble.simulate_ensemble`; an ``Engine``.

    What is found of runs that end where the ball detaches is found of shorter ones, which end there.

    **Arguments:**

    - ``batch``: the rows.
    - ``request``: what to compute for them.
    """
    reductions = {**_contact(batch, request), **{find.name: find.reduction() for find in request.finds}}
    if not request.detachment:
        return _solved(batch, request, reductions)
    ended = _solved(batch, request, {}, {"detachment": Detachment()})
    if not reductions:
        return ended
    until = np.stack([batch.times[:, 0], ended["reached"]], axis=1)
    results = _solved(batch._replace(times=until), request, reductions)
    return ended | {name + end: results[name + end] for name, item in reductions.items() for end in item.ends}


def _solved(
    batch: Batch,
    request: Request,
    reductions: Mapping[str, AbstractReduction],
    events: Mapping[str, AbstractEvent] | None = None,
) -> dict[str, np.ndarray]:
    first = batch.template
    system, state = batch.shared_once()
    ensemble = simulate_ensemble(
        system,
        batch.times,
        state,
        in_axes=batch.in_axes,
        events=events,
        contact=batch.contact,
        solver=SOLVERS[first.solver](),
        rtol=batch.rtol,
        atol=batch.atol,
        step_to_times=first.step_to_times,
        dae=first.dae,
        project=first.project,
        max_steps=first.max_steps,
        reductions=reductions,
        block=min(request.most, BLOCK),
        threads=request.threads,
    )
    trajectory = ensemble.trajectory
    rows = {name: np.asarray(getattr(trajectory, name)) for name in ("status", "steps", "rejected", "reached")}
    results = vars(trajectory.state) | history_results(trajectory.history) | ensemble.reductions
    return rows | jax.tree.map(np.asarray, results)


def _contact(batch: Batch, request: Request) -> Mapping[str, AbstractReduction]:
    touches = request.contact and isinstance(batch.template.system, AbstractBody)
    return CONTACT_REDUCTIONS if touches else {}
