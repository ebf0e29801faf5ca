"""How the rows of a chunk are solved."""

from collections.abc import Mapping

import jax
import numpy as np

from ..ensemble import AbstractReduction, simulate_ensemble
from ..ensemble.quantities import CONTACT
from ..physics.body import AbstractBody
from ..scenario.solvers import SOLVERS
from .batch import Batch, Wanted
from .outputs import contact_results
from .reductions import solved_in_lanes
from .vmap import solve_by_vmap

# The same for any number of threads, so that results are the same to the last bit.
BLOCK = 2048


def solve_in_lanes(batch: Batch, wanted: Wanted) -> dict[str, np.ndarray]:
    """The rows by :func:`jaxball.ensemble.simulate_ensemble` where it supports the method; an ``Engine``.

    Other methods (implicit ones, the DAE, projection, steps to saved times) are left to :func:`jaxball.simulate` under
    ``vmap``, and so are the runs that end where the ball detaches.

    **Arguments:**

    - ``batch``: the rows.
    - ``wanted``: what to compute for them.
    """
    if not solved_in_lanes(batch.template):
        return solve_by_vmap(batch, wanted)
    solved = _solved(batch, wanted, _contact(batch, wanted) | _finds(wanted))
    if not wanted.detachment:
        return solved
    detached = np.flatnonzero(solved["least_normal_force"] <= 0)
    ended = _ended(batch.take(detached), wanted) if detached.size else {}
    return solved | {name: _replaced(solved[name], detached, array) for name, array in ended.items()}


def _solved(batch: Batch, wanted: Wanted, reductions: Mapping[str, AbstractReduction]) -> dict[str, np.ndarray]:
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
        block=min(wanted.most, BLOCK),
        threads=wanted.threads,
    )
    trajectory = ensemble.trajectory
    rows = {name: np.asarray(getattr(trajectory, name)) for name in ("status", "steps", "rejected", "reached")}
    found = vars(trajectory.state) | contact_results(trajectory) | ensemble.reductions
    return rows | jax.tree.map(np.asarray, found)


def _ended(batch: Batch, wanted: Wanted) -> dict[str, np.ndarray]:
    """Runs that end where the ball detaches, and their results until then."""
    ended = solve_by_vmap(batch, wanted)
    finds = _finds(wanted)
    if not finds:
        return ended
    until = np.stack([batch.times[:, 0], ended["reached"]], axis=1)
    until_then = _solved(batch._replace(times=until), wanted, finds)
    return ended | {name + end: until_then[name + end] for name, item in finds.items() for end in item.ends}


def _contact(batch: Batch, wanted: Wanted) -> dict[str, AbstractReduction]:
    if not isinstance(batch.template.system, AbstractBody):
        return {}
    names = CONTACT if wanted.contact else ("least_normal_force",) if wanted.detachment else ()
    return {name: CONTACT[name] for name in names}


def _finds(wanted: Wanted) -> dict[str, AbstractReduction]:
    return {find.name: find.reduction() for find in wanted.finds}


def _replaced(array: np.ndarray, rows: np.ndarray, values: np.ndarray) -> np.ndarray:
    array = array.copy()
    array[rows] = values
    return array
