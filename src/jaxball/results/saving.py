"""A trajectory as a labelled data set, and saved to a file."""

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..interface.output import check_destination, replacing
from ..physics.state import DiskState
from ..scenario import Scenario
from ..scenario.paths import entries
from ..sensors import AbstractSensor
from ..simulation.trajectory import Trajectory
from ..simulation.variables import Variable
from .contact import history_values, switch_values
from .files import SUFFIXES
from .provenance import attributes
from .variables import described, labels, measured_values, values

if TYPE_CHECKING:
    import xarray


def to_dataset(
    trajectory: Trajectory[Any, Any],
    scenario: Scenario | None = None,
    sensors: Mapping[str, AbstractSensor] | None = None,
) -> "xarray.Dataset":
    """The trajectory and all its observables, or the laws of a classical system, as an ``xarray.Dataset``.

    Dimensions are ``time``, ``mass``, ``joint`` (by name, ``mechanisms[0].joints[1]``), ``driven`` (the masses whose
    angles belong to the state, by their numbers, or, with joints among them, all by name) and those of vectors:
    ``axis``, ``direction`` in the plane, ``component`` of a versor. All are counted from 0. Attributes say how the
    solve ended, and hold the scenario's file. A run with a law of contact has its modes too, and its switches between
    them along ``switch``.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.
    - ``scenario``: the scenario of the run; by default the one that was run. If there is none, a scenario of the
      system, its initial state and the times is saved, if a file can hold them.
    - ``sensors``: those of :mod:`jaxball.sensors` whose readings are included, each under its name after ``measured_``;
      by default those of the scenario.

    **Raises:** ``ValueError`` for a batch of trajectories, and where the body lacks the part that a sensor is on.

    **Example:**

    >>> from jaxball import Disk, DiskState, simulate, to_dataset
    >>> run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], DiskState(phidot=-1.0))
    >>> to_dataset(run).normal_force.values
    array([1., 1., 1.])
    """
    # Imported here, because it takes longer than all of jaxball's own modules.
    import xarray

    scenario, sensors = _settled(trajectory, scenario, sensors)
    variables, sizes = {}, {}
    for leading, saved in (("time", _over_time(trajectory, sensors)), ("switch", _of_switches(trajectory))):
        for name, (variable, array) in saved.items():
            variables[name] = ((leading, *variable.dimensions), array, variable.notes)
            sizes |= zip((leading, *variable.dimensions), array.shape, strict=True)
    sizes.pop("time")
    times = ("time", np.asarray(trajectory.times), {"units": "time", "long_name": "time"})
    coordinates = {"time": times, **labels(trajectory.system, sizes)}
    return xarray.Dataset(variables, coordinates, attributes(trajectory, scenario, sensors))


def save(
    trajectory: Trajectory[Any, Any],
    path: str | Path,
    scenario: Scenario | None = None,
    sensors: Mapping[str, AbstractSensor] | None = None,
) -> Path:
    """Saves a trajectory with all its observables, or laws, in the format that the suffix of ``path`` names.

    - ``trajectory``: what :func:`jaxball.simulate` returns.
    - ``path``: where to save it. The suffix is one of:

      - ``.nc``: netCDF, see :func:`to_dataset`; ``xarray.open_dataset(path)`` reads it.
      - ``.npz``: the same arrays, and the attributes as texts and numbers.
      - ``.csv``: one row for each time and one column for each number, named like ``Omega[1]`` or
        ``mass_positions_body[0][2]`` (mass 0, the third axis); the column ``status`` is 0 for a solve
        that reached its end, and the number of its :class:`~jaxball.Status` for one that failed. The switches of a run
        with a law of contact are left out.
    - ``scenario``: the scenario whose text is saved with it, as in :func:`to_dataset`.
    - ``sensors``: as in :func:`to_dataset`.

    A failed solve is saved too, with its status, and NaN after the time that it reached. The write is atomic, so a
    failure never damages an existing file. A symbolic link is followed.

    **Returns:** ``path``.

    **Raises:** :class:`OutputError` when the suffix is another one, or the file cannot be written, ``ValueError`` for a
    batch of trajectories, and where the body lacks the part that a sensor is on.

    **Example:**

    >>> import tempfile
    >>> from jaxball import Disk, DiskState, load_run, save, simulate
    >>> run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], DiskState(phidot=-1.0))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = save(run, f"{folder}/run.npz")
    ...     again = load_run(path)
    >>> path.name, bool((again.state.z == run.state.z).all())
    ('run.npz', True)
    """
    path = Path(path)
    check_destination(path, SUFFIXES)
    with replacing(path) as temporary:
        WRITERS[path.suffix](trajectory, temporary, *_settled(trajectory, scenario, sensors))
    return path


Sensors = Mapping[str, AbstractSensor]
Values = dict[str, tuple[Variable, np.ndarray]]


def _settled(
    trajectory: Trajectory[Any, Any], scenario: Scenario | None, sensors: Sensors | None
) -> tuple[Scenario | None, Sensors]:
    """The given sensors, or those of the scenario, and the scenario with them."""
    known = trajectory.scenario if scenario is None else scenario
    own = {} if known is None else known.sensors
    if sensors is None or sensors is own:
        return scenario, own
    return None if known is None else dataclasses.replace(known, sensors=sensors), sensors


def _over_time(trajectory: Trajectory[Any, Any], sensors: Sensors) -> Values:
    """Every variable over time, with its array."""
    history = trajectory.contact
    modes = {} if history is None else history_values(history)
    return values(trajectory) | modes | measured_values(trajectory, sensors)


def _of_switches(trajectory: Trajectory[Any, Any]) -> Values:
    """Every variable of the switches between modes, with its array."""
    if trajectory.contact is None:
        return {}
    planar = isinstance(trajectory.state, DiskState)
    return switch_values(trajectory.contact, {name: described(name, planar) for name in vars(trajectory.state)})


def _write_netcdf(trajectory: Trajectory[Any, Any], path: Path, scenario: Scenario | None, sensors: Sensors) -> None:
    to_dataset(trajectory, scenario, sensors).to_netcdf(path, engine="h5netcdf")


def _write_npz(trajectory: Trajectory[Any, Any], path: Path, scenario: Scenario | None, sensors: Sensors) -> None:
    arrays: dict[str, Any] = {"time": np.asarray(trajectory.times)}
    both = _over_time(trajectory, sensors) | _of_switches(trajectory)
    arrays |= {name: array for name, (_, array) in both.items()}
    arrays |= {name: np.asarray(value) for name, value in attributes(trajectory, scenario, sensors).items()}
    np.savez_compressed(path, **arrays)


def _write_csv(trajectory: Trajectory[Any, Any], path: Path, scenario: Scenario | None, sensors: Sensors) -> None:
    columns = {"time": np.asarray(trajectory.times)}
    for name, (_, array) in _over_time(trajectory, sensors).items():
        for entry, index in entries(name, array.shape[1:]).items():
            columns[entry] = array[(slice(None), *index)]
    columns["status"] = np.full(columns["time"].shape, int(trajectory.status))
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, fmt="%.17g", delimiter=",", header=",".join(columns), comments="")


WRITERS: dict[str, Callable[[Trajectory[Any, Any], Path, Scenario | None, Sensors], None]] = dict(
    zip(SUFFIXES, (_write_netcdf, _write_npz, _write_csv), strict=True)
)
