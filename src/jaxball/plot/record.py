"""Takes from a trajectory the parts that figures draw, as NumPy arrays."""

from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from ..interface.arguments import a
from ..physics.body import AbstractBody
from ..simulation.arguments import require_one_run
from ..simulation.one_sided import with_one_sided_limits
from ..simulation.trajectory import Trajectory


class Record(NamedTuple):
    """The saved times that the solve reached, and the observables at each."""

    times: Float[np.ndarray, " T"]
    observables: Any  # Observables whose arrays are NumPy's


def record(trajectory: Trajectory) -> Record:
    """Returns the rows of ``trajectory`` whose states are finite; the others are not drawn.

    **Raises:** ``ValueError`` for a batch of trajectories and for a reduced one.
    """
    require_one(trajectory)
    rows = finite_rows(trajectory)
    observables = jax.tree.map(lambda leaf: np.asarray(leaf)[rows], trajectory.observables)
    return Record(np.asarray(trajectory.times)[rows], observables)


def with_jumps(trajectory: Trajectory) -> Trajectory:
    """Adds the states just before and just after each switch of the run's mode, which are drawn as jumps.

    **Raises:** ``ValueError`` for a batch of trajectories.
    """
    require_one(trajectory)
    limits = with_one_sided_limits(trajectory)
    # With its scenario, whose units the axes have; what makes a new trajectory leaves it out.
    return limits if trajectory.scenario is None else limits.set_scenario(trajectory.scenario)


def require_finite_rows(trajectory: Trajectory) -> np.ndarray:
    """Returns the indices of the saved times at which the state is finite.

    **Raises:** ``ValueError`` for a batch of trajectories, and where there is none.
    """
    require_one(trajectory)
    rows = finite_rows(trajectory)
    if not rows.size:
        raise ValueError(
            f"Argument `trajectory` must have a finite state to show, but it has none. {trajectory.message}"
        )
    return rows


def require_one(trajectory: Trajectory) -> None:
    """Raises ``ValueError`` for a batch of trajectories."""
    require_one_run(trajectory.status, "A picture")


def require_one_of_body(trajectory: Trajectory) -> None:
    """Raises ``ValueError`` for a batch of trajectories, and for one of another system than a ball or a disk."""
    require_one(trajectory)
    if not isinstance(trajectory.system, AbstractBody):
        raise ValueError(
            "Argument `trajectory` must be of a ball or a disk, but it is of "
            f"{a(type(trajectory.system).__name__)}; its method plot() draws its motion."
        )


def finite_rows(trajectory: Trajectory) -> np.ndarray:
    """Returns the indices of the saved times at which every entry of the state is finite."""
    leaves = [np.asarray(leaf).reshape(len(trajectory.times), -1) for leaf in jax.tree.leaves(trajectory.state)]
    return np.flatnonzero(np.all(np.isfinite(np.concatenate(leaves, axis=1)), axis=1))
