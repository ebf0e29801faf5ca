"""A trajectory as a labelled data set."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ..scenario import Scenario
from ..simulation.trajectory import Trajectory
from .provenance import attributes
from .variables import labels, values

if TYPE_CHECKING:
    import xarray


def to_dataset(trajectory: Trajectory[Any, Any], scenario: Scenario | None = None) -> "xarray.Dataset":
    """The trajectory and all its observables, or the laws of a classical system, as an ``xarray.Dataset``.

    Dimensions are ``time``, ``mass``, ``driven`` (the masses whose angles belong to the state, by their
    numbers) and those of vectors: ``axis``, ``direction`` in the plane, ``component`` of a versor. All
    are counted from 0. Attributes say how the solve ended, and hold the scenario's file.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.
    - ``scenario``: what the run came from; without one, a file of the system, its initial state and the times is kept,
      if a file can hold them.

    **Raises:** ``ValueError`` for a batch of trajectories.

    **Example:**

    >>> from jaxball import Disk, DiskState, simulate, to_dataset
    >>> run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], DiskState(phidot=-1.0))
    >>> to_dataset(run).normal_force.values
    array([1., 1., 1.])
    """
    # Imported here, because it takes longer than all of jaxball's own modules.
    import xarray

    variables, sizes = {}, {}
    for name, (variable, array) in values(trajectory).items():
        notes = {"units": variable.units, "long_name": variable.meaning}
        variables[name] = (("time", *variable.dimensions), array, notes)
        sizes |= zip(variable.dimensions, array.shape[1:], strict=True)
    times = ("time", np.asarray(trajectory.times), {"units": "time", "long_name": "time"})
    coordinates = {"time": times, **labels(trajectory.system, sizes)}
    return xarray.Dataset(variables, coordinates, attributes(trajectory, scenario))
