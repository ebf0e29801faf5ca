"""The variables of a saved trajectory with their arrays and coordinates."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..physics.body import AbstractBody
from ..physics.state import DiskState, ReducedState
from ..sensors import AbstractSensor
from ..simulation.trajectory import Trajectory
from ..simulation.variables import CLASSICAL_STATE, LAWS, OBSERVABLES, STATE, Variable


def values(trajectory: Trajectory[Any, Any]) -> dict[str, tuple[Variable, np.ndarray]]:
    """Every variable of a trajectory with its array, ``time`` first; NaN at times that the solve did not reach.

    A reduced trajectory has its state only, and one of a classical system its state and its laws. For a disk, ``z`` is
    one number.

    **Raises:** ``ValueError`` for a batch of trajectories.
    """
    if np.ndim(trajectory.times) != 1 or np.ndim(trajectory.status) != 0:
        raise ValueError(
            "Argument `trajectory` must be a single trajectory, but it is a batch with times of shape "
            f"{np.shape(trajectory.times)}; save its members one by one."
        )
    if not isinstance(trajectory.system, AbstractBody):
        return _classical_values(trajectory)
    variables = {}
    for name, leaf in vars(trajectory.state).items():
        array = np.asarray(leaf)
        if array.size:
            variables[name] = (described(name, isinstance(trajectory.state, DiskState)), array)
    if isinstance(trajectory.state, ReducedState):
        return variables
    observables = trajectory.observables
    missing = np.isnan(np.asarray(observables.normal_force))
    for name, variable in OBSERVABLES.items():
        array = np.array(getattr(observables, name))
        array[missing] = np.nan
        if array.size or "joint" not in variable.dimensions:
            variables[name] = (variable, array)
    return variables


def measured_values(
    trajectory: Trajectory[Any, Any], sensors: Mapping[str, AbstractSensor]
) -> dict[str, tuple[Variable, np.ndarray]]:
    """The readings of sensors over time, named ``measured_…``; a vector has the axes of its sensor."""
    variables = {}
    for name, leaf in (trajectory.measured(sensors) if sensors else {}).items():
        array, sensor = np.asarray(leaf), sensors[name]
        known = {(): (), (3,): ("axis",)}.get(array.shape[1:])
        dimensions = undescribed(name, array.ndim - 1).dimensions if known is None else known
        variables[f"measured_{name}"] = Variable(dimensions, sensor.units, sensor.meaning), array
    return variables


def described(name: str, planar: bool) -> Variable:
    """The variable of a field of a body's state; the position of a disk is one number."""
    return STATE[name]._replace(dimensions=()) if planar and name == "z" else STATE[name]


def _classical_values(trajectory: Trajectory[Any, Any]) -> dict[str, tuple[Variable, np.ndarray]]:
    variables = {}
    for known, leaves in ((CLASSICAL_STATE, vars(trajectory.state)), (LAWS, trajectory.laws._asdict())):
        for name, leaf in leaves.items():
            array = np.asarray(leaf)
            variables[name] = known.get(name) or undescribed(name, array.ndim - 1), array
    return variables


def undescribed(name: str, dimensions: int) -> Variable:
    """A variable of a system that is not one of jaxball's: its dimensions are named after it."""
    return Variable(tuple(f"{name}_{k}" for k in range(dimensions)), "", name)


def labels(system: Any, sizes: Mapping[str, int]) -> dict[str, np.ndarray]:
    """The coordinate along each dimension: 0, 1, …, or the names of joints, ``mechanisms[0].joints[1]``.

    Along ``driven`` are the numbers of the driven masses or, where joints are among what is driven, the names of all.
    """
    coordinates = {name: np.arange(size) for name, size in sizes.items()}
    if "driven" in sizes:
        coordinates["driven"] = np.asarray(system.coordinates if system.joints else system.driven)
    if "joint" in sizes:
        coordinates["joint"] = np.asarray(
            [f"mechanisms[{k}].joints[{a}]" for k, item in enumerate(system.mechanisms) for a in range(item.n_joints)]
        )
    return coordinates
