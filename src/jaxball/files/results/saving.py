"""Saves a trajectory as a labelled data set, with its origin as attributes."""

import dataclasses
import importlib.metadata
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import jax
import numpy as np

from ...interface.arguments import a, require
from ...interface.output import replacing
from ...interface.status import Status
from ...physics.contact.released import ReleasedState
from ...physics.sensors import AbstractSensor
from ...physics.state import ReducedState, RotationState
from ...simulation.events import prefix_of_event
from ...simulation.trajectory import Trajectory, always_rolls
from ...simulation.variables import Variable
from ..scenario.errors import ScenarioError
from ..scenario.files import read_scenario, write_scenario
from ..scenario.paths import entries
from ..scenario.scenario import Scenario
from ..scenario.units import Units
from .feedback import feedback_labels
from .files import AT_THE_END, CHECKSUM, FORMAT, UNKNOWN_SOLVER, add_checksum, check_format
from .recording import write_mcap
from .variables import (
    Variables,
    describe_fields,
    event_values,
    history_attributes,
    history_values,
    labels,
    sensor_values,
    switch_values,
    values,
    with_units_of_own,
)

if TYPE_CHECKING:
    import xarray


PACKAGES = ("jaxball", "jax", "diffrax")
CONVENTIONS = "CF-1.11"  # of attributes, where units are stated
TIME = Variable((), "time", "time")


def attributes(
    trajectory: Trajectory[Any, Any], scenario: Scenario | None, sensors: Mapping[str, AbstractSensor] | None = None
) -> dict[str, str | int | float]:
    """Returns the title, how the solve ended, the scenario's text, and the versions of the packages.

    Without a ``scenario``, it is the one that was run; if there was none, its text describes the trajectory's system,
    initial state, times and ``sensors``, and is empty where a file cannot hold them. ``format`` is the version of the
    file format, which :func:`load_run` checks. ``ok`` is 1 for a solve that reached its end and 0 for one that failed.
    A run with dense output also has the extremes of the contact force over the whole run, ``friction_needed`` and the
    others of :class:`~jaxball.simulation.extremes.ContactExtremes`, with the same names as in the store of a sweep. One
    with a law of contact has its coefficients instead, ``contact_friction`` and so on, and its ``contact_switches``.
    ``event_…_count`` says how often each event happened.
    """
    run_scenario = trajectory.scenario if scenario is None else scenario
    if scenario is not None:
        text = write_scenario(scenario)
    elif not (text := _text(trajectory.scenario)) and (description := _text(_scenario_of(trajectory, sensors or {}))):
        text = UNKNOWN_SOLVER + description
    run: dict[str, str | int | float] = {
        "format": FORMAT,
        "title": "" if run_scenario is None else run_scenario.title,
        "ok": int(trajectory.ok),
        "status": Status(int(trajectory.status)).name,
        "message": trajectory.message,
        "reached": float(trajectory.reached),
        "steps": int(trajectory.steps),
        "rejected": int(trajectory.rejected),
        "scenario": text,
    }
    run |= history_attributes(trajectory.history)
    run |= {f"{prefix_of_event(name)}_count": int(seen.count) for name, seen in trajectory.events.items()}
    if always_rolls(trajectory) and trajectory.interpolant is not None:
        from ...simulation.extremes import contact_extremes  # with the solvers, which a run that is drawn does without

        extremes = contact_extremes(trajectory)
        names = [field.name for field in dataclasses.fields(extremes) if field.name != "constant"]
        run |= {name: float(getattr(extremes, name)) for name in names}
    if _units(trajectory, scenario) is not None:
        run["Conventions"] = CONVENTIONS
    return run | {f"{name}_version": importlib.metadata.version(name) for name in PACKAGES}


def _units(trajectory: Trajectory[Any, Any], scenario: Scenario | None) -> Units | None:
    """Returns the units that the scenario of a run states."""
    run_scenario = trajectory.scenario if scenario is None else scenario
    return None if run_scenario is None else run_scenario.units


def notes_in(units: Units | None, variable: Variable) -> dict[str, Any]:
    """Returns the attributes of a variable, with its unit in place of its dimension where units are stated."""
    notes = variable.notes
    if units is None or not variable.units:
        return notes
    unit = units.of(variable.units)
    if unit:
        return notes | {"units": unit}
    del notes["units"]
    return notes | {"comment": variable.units}  # two dimensions, of which an attribute can state one


def _text(scenario: Scenario | None) -> str:
    """Returns the text of a scenario; empty where a file cannot hold it."""
    if scenario is None:
        return ""
    try:
        text = write_scenario(scenario)
        # Read back, because a file holds a scenario only if it can be read again.
        read_scenario(text)
    except ScenarioError:
        return ""
    return text


def _scenario_of(trajectory: Trajectory[Any, Any], sensors: Mapping[str, AbstractSensor]) -> Scenario | None:
    """Makes a scenario of the system, the initial state and the times; None where the state has no position."""
    state = jax.tree.map(lambda leaf: leaf[0], trajectory.state)
    state = state.in_space() if isinstance(state, RotationState) else state
    if isinstance(state, ReducedState):
        return None
    contact, law = trajectory.contact, None
    if contact is not None:
        law = contact.law
        rolls = not isinstance(trajectory.start, ReleasedState)
        state = state if rolls else ReleasedState(state, contact.V[0], contact.height[0])
    return Scenario("", trajectory.system, state, np.asarray(trajectory.times), contact=law, sensors=sensors)


def to_dataset(
    trajectory: Trajectory[Any, Any],
    scenario: Scenario | None = None,
    sensors: Mapping[str, AbstractSensor] | None = None,
) -> "xarray.Dataset":
    # Imported here, because it takes longer than all of jaxball's own modules.
    import xarray

    scenario, sensors = _with_sensors(trajectory, scenario, sensors)
    variables, sizes, units = {}, {}, _units(trajectory, scenario)
    over_time, of_switches = ("time", _over_time(trajectory, sensors)), ("switch", _of_switches(trajectory))
    for leading, saved in (over_time, of_switches, *event_values(trajectory.events).items()):
        for name, (variable, array) in saved.items():
            variables[name] = ((leading, *variable.dimensions), array, notes_in(units, variable))
            sizes |= zip((leading, *variable.dimensions), array.shape, strict=True)
    # The times themselves are its coordinate.
    sizes.pop("time")
    times = ("time", np.asarray(trajectory.times), notes_in(units, TIME))
    coordinates = {"time": times, **labels(trajectory.system, sizes), **feedback_labels(trajectory.history)}
    if "own_state" in sizes and trajectory.system.own_states.units is not None:
        own_units = trajectory.system.own_states.units_in(str if units is None else units.of)
        coordinates["own_unit"] = ("own_state", list(own_units))
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

      - ``.nc``: netCDF, see :meth:`jaxball.Trajectory.to_dataset`; ``xarray.open_dataset(path)`` reads it.
      - ``.npz``: the same arrays, and the attributes as texts and numbers.
      - ``.csv``: one row for each time and one column for each number, named like ``Omega[1]`` or
        ``mass_positions_body[0][2]`` (mass 0, the third axis); the column ``status`` is 0 for a solve
        that reached its end, and the number of its :class:`~jaxball.Status` for one that failed. The switches of a run
        and the times of events are left out.
      - ``.mcap``: a recording with messages in JSON, in Foxglove's schemas where there are any: the frames of the body
        and of its masses, their shapes, the contact force, the joints, and the variables over time, at the times that
        the solve reached. Its clock starts at 0, and a unit of time is a second. It needs jaxball's extra ``mcap``.
    - ``scenario``: the scenario whose text is saved with it, as in :meth:`jaxball.Trajectory.to_dataset`.
    - ``sensors``: as in :meth:`jaxball.Trajectory.to_dataset`.

    A failed solve is saved too, with its status, and NaN after the time that it reached. The write is atomic, so a
    failure never damages an existing file. A symbolic link is followed.

    **Returns:** ``path``.

    **Raises:** :class:`OutputError` when the suffix is another one, the file cannot be written, or ``mcap`` is missing
    for a ``.mcap``, ``ValueError`` for a batch of trajectories, for the scenario of another system, and where the body
    lacks the part that a sensor is on.

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
    check_format(path)
    with replacing(path) as temporary:
        WRITERS[path.suffix](trajectory, temporary, *_with_sensors(trajectory, scenario, sensors))
    return path


Sensors = Mapping[str, AbstractSensor]


def _with_sensors(
    trajectory: Trajectory[Any, Any], scenario: Scenario | None, sensors: Sensors | None
) -> tuple[Scenario | None, Sensors]:
    """Returns the scenario with the given sensors, or its own where none are given, and these sensors."""
    require("trajectory", trajectory, Trajectory, "a trajectory, as simulate(...) returns it")
    require("scenario", scenario, (Scenario, type(None)), "a scenario, as load_scenario(...) returns it, or None")
    if scenario is not None and scenario.feedback is None:  # else the inputs that acted are a part of the run's system
        _require_system_of(trajectory, scenario)
    run_scenario = trajectory.scenario if scenario is None else scenario
    scenario_sensors = {} if run_scenario is None else run_scenario.sensors
    if sensors is None or sensors is scenario_sensors:
        return scenario, scenario_sensors
    return None if run_scenario is None else dataclasses.replace(run_scenario, sensors=sensors), sensors


def _require_system_of(trajectory: Trajectory[Any, Any], scenario: Scenario) -> None:
    """Raises a ``ValueError`` unless a scenario is of the system of a run, which is read from it again."""
    other, system = scenario.system, trajectory.system
    must, remedy = "Argument `scenario` must be that of the run", "make one of it, or leave it out"
    if type(other) is not type(system):
        raise ValueError(f"{must}, which is of {a(type(system).__name__)}, but it is of {a(type(other).__name__)}.")
    numbers = dict(system.numbers())
    for name, value in other.numbers():
        if not np.array_equal(value, numbers.get(name, np.nan), equal_nan=True):
            raise ValueError(f"{must}, but `{name}` is another one in it; {remedy}.")


def _over_time(trajectory: Trajectory[Any, Any], sensors: Sensors) -> Variables:
    """Returns every variable over time, with its array."""
    variables = values(trajectory) | history_values(trajectory.history, trajectory.state)
    return with_units_of_own(variables, trajectory.system) | sensor_values(trajectory, sensors)


def _of_switches(trajectory: Trajectory[Any, Any]) -> Variables:
    """Returns every variable of the switches between modes, with its array."""
    variables = switch_values(trajectory.history.of_body, describe_fields(trajectory.state))
    return with_units_of_own(variables, trajectory.system)


def _write_netcdf(trajectory: Trajectory[Any, Any], path: Path, scenario: Scenario | None, sensors: Sensors) -> None:
    write_netcdf(to_dataset(trajectory, scenario, sensors).assign_attrs({CHECKSUM: AT_THE_END}), path)
    add_checksum(path)


def write_netcdf(dataset: "xarray.Dataset", path: Path) -> None:
    """Writes a data set as netCDF.

    **Raises:** ``OSError`` where the disk is full.
    """
    # Made in memory, because HDF5 ends the process where it cannot write the rest of a file that it has open.
    path.write_bytes(cast("memoryview", dataset.to_netcdf(engine="h5netcdf")))


def _write_npz(trajectory: Trajectory[Any, Any], path: Path, scenario: Scenario | None, sensors: Sensors) -> None:
    arrays: dict[str, Any] = {"time": np.asarray(trajectory.times)}
    parts = _over_time(trajectory, sensors), _of_switches(trajectory), *event_values(trajectory.events).values()
    arrays |= {name: array for part in parts for name, (_, array) in part.items()}
    about = {**attributes(trajectory, scenario, sensors), CHECKSUM: AT_THE_END}
    arrays |= {name: np.asarray(value) for name, value in about.items()}
    np.savez_compressed(path, **arrays)
    add_checksum(path)


def _write_csv(trajectory: Trajectory[Any, Any], path: Path, scenario: Scenario | None, sensors: Sensors) -> None:
    columns = {"time": np.asarray(trajectory.times)}
    for name, (_, array) in _over_time(trajectory, sensors).items():
        for entry, index in entries(name, array.shape[1:]).items():
            columns[entry] = array[(slice(None), *index)]
    columns["status"] = np.full(columns["time"].shape, int(trajectory.status))
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, fmt="%.17g", delimiter=",", header=",".join(columns), comments="")


def _write_mcap(trajectory: Trajectory[Any, Any], path: Path, scenario: Scenario | None, sensors: Sensors) -> None:
    write_mcap(trajectory, path, _over_time(trajectory, sensors), attributes(trajectory, scenario, sensors))


WRITERS: dict[str, Callable[[Trajectory[Any, Any], Path, Scenario | None, Sensors], None]] = {
    ".nc": _write_netcdf,
    ".npz": _write_npz,
    ".csv": _write_csv,
    ".mcap": _write_mcap,
}
