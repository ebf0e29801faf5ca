"""How the rows of a chunk are solved."""

from collections.abc import Mapping

import jax
import numpy as np

from ..body import Ball, Disk
from ..ensemble import AbstractReduction, simulate_ensemble
from ..ensemble.quantities import CONTACT
from ..scenario.solve import SOLVERS
from .batch import Batch, Wanted
from .finds import solved_in_lanes
from .plain import solve_by_vmap

# The same for any number of threads, so that results are the same to the last bit.
BLOCK = 2048


def solve_in_lanes(batch: Batch, wanted: Wanted) -> dict[str, np.ndarray]:
    """The rows by :func:`jaxball.ensemble.simulate_ensemble` where it knows the method; an ``Engine``.

    Other methods (implicit ones, the DAE, projection, steps to saved times) and driven masses, which may leave the
    shell, are left to :func:`jaxball.simulate` under ``vmap``.
    """
    first = batch.template
    if not solved_in_lanes(first):
        return solve_by_vmap(batch, wanted)
    found = simulate_ensemble(
        batch.system,
        batch.times,
        batch.state,
        solver=SOLVERS[first.solver](),
        rtol=batch.rtol,
        atol=batch.atol,
        max_steps=first.max_steps,
        reductions=_reductions(batch, wanted),
        block=min(wanted.most, BLOCK),
        threads=wanted.threads,
    )
    trajectory = found.trajectory
    rows = {name: np.asarray(getattr(trajectory, name)) for name in ("status", "steps", "rejected", "reached")}
    return rows | jax.tree.map(np.asarray, vars(trajectory.state)) | jax.tree.map(np.asarray, found.reductions)


def _reductions(batch: Batch, wanted: Wanted) -> Mapping[str, AbstractReduction]:
    touches = wanted.contact and isinstance(batch.template.system, Ball | Disk)
    return (CONTACT if touches else {}) | {find.name: find.reduction() for find in wanted.finds}
