"""A trajectory as a labelled data set."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ..classical import AbstractClassicalSystem
from ..scenario import Scenario
from ..trajectory import Trajectory
from .provenance import attributes
from .variables import COORDINATES, values

if TYPE_CHECKING:
    import xarray


def to_dataset(trajectory: Trajectory[Any, Any], scenario: Scenario | None = None) -> "xarray.Dataset":
    """The trajectory and all its observables, or the laws of a classical system, as an ``xarray.Dataset``.

    Dimensions are ``time``, ``mass``, ``driven`` (the masses whose angles belong to the state) and
    those of vectors: ``axis`` 1 to 3, ``direction`` 1 and 2 in the plane, ``component`` 0 to 3 of a
    versor. Attributes say how the solve ended, and hold the scenario's file; without ``scenario``, one of the system,
    its initial state and the times, if a file can hold them.

    **Raises:** ``ValueError`` for a batch of trajectories.
    """
    # Imported here, because it takes longer than all of jaxball's own modules.
    import xarray

    variables, used = {}, set()
    for name, (variable, array) in values(trajectory).items():
        notes = {"units": variable.units, "long_name": variable.meaning}
        variables[name] = (("time", *variable.dimensions), array, notes)
        used |= set(variable.dimensions)
    system = trajectory.system
    labels: dict[str, Any] = dict(COORDINATES)
    if not isinstance(system, AbstractClassicalSystem):
        labels |= {"mass": np.arange(system.n_masses), "driven": np.asarray(system.driven)}
    coordinates = {name: np.asarray(label) for name, label in labels.items() if name in used}
    times = ("time", np.asarray(trajectory.times), {"units": "time", "long_name": "time"})
    return xarray.Dataset(variables, {"time": times, **coordinates}, attributes(trajectory, scenario))
