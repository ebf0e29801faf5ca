"""The results that a study keeps for each row, and how its rows lie along its axes."""

import dataclasses
from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...files.results.variables import describe_fields, labels, with_units_of_own
from ...files.scenario import read_document
from ...files.scenario.scenario import Scenario
from ...files.scenario.units import dimension_of
from ...files.scenario.values import kinds_of_numbers
from ...interface.status import Status
from ...numerics.arrays import arrays_of
from ...physics.contact.body_on_plane import BodyOnPlane
from ...physics.contact.history import ContactHistory
from ...physics.contact.modes import Mode
from ...physics.contact.released import ReleasedState
from ...physics.hybrid import AbstractHistory
from ...physics.sensors.base import Measurement
from ...physics.system import AbstractSystem
from ...simulation.variables import (
    EXTREMES,
    FINDS,
    HISTORY,
    LEFT_PLANE,
    OF_SLIDE,
    RUN,
    RUN_SWITCHES,
    Variable,
    variables_of_event,
)
from .axes import Axis, Designed, FromFile, Ranged, Zipped
from .files import StudyError
from .study import Find, Study

AXES = "axes"  # the group of a store that holds the points of each axis
NAMES = "names"  # the attribute that has the labels along a dimension, if they are not numbers
OWN_UNITS = "own_units"  # that which has the units of states of one's own
OF_RUN, AT_SAMPLES = "of the run", "at the samples"
LEAST_FORCE, LEFT = "least_normal_force", "left_plane"
_LOGARITHMIC = ("log-uniform", "lognormal")


def layout_of(study: Study) -> dict[str, list[Any]]:
    """Returns for each path its axis and whether its values are spaced logarithmically; for each axis, whether its
    points are scattered; and the names of the quantities that the study finds.

    Lists of numbers and strings, which every file format can hold.
    """
    finds = {"finds": [find.name for find in study.finds]} if study.finds else {}
    return finds | {
        "path_axis": [k for k, axis in enumerate(study.axes) for _ in axis.paths],
        "path_logarithmic": [int(item) for axis in study.axes for item in _logarithmic(axis)],
        "axis_scattered": [int(_is_scattered(axis)) for axis in study.axes],
    }


def dimensions(paths: Sequence[str], path_axis: Sequence[int]) -> list[str]:
    """Returns the name of each axis as a dimension: the path of its one number, or else its index in the study,
    ``axes[0]``.
    """
    numbers = Counter(path_axis)
    alone = {axis: path for path, axis in zip(paths, path_axis, strict=True) if numbers[axis] == 1}
    return [alone.get(axis, f"{AXES}[{axis}]") for axis in sorted(numbers)]


def _logarithmic(axis: Axis) -> list[bool]:
    if isinstance(axis, Zipped):
        return [item for member in axis.members for item in _logarithmic(member)]
    if isinstance(axis, Designed):
        return [item.kind in _LOGARITHMIC for item in axis.distributions]
    return [isinstance(axis, Ranged) and axis.logarithmic] * len(axis.paths)


def _is_scattered(axis: Axis) -> bool:
    if isinstance(axis, Zipped):
        return any(_is_scattered(member) for member in axis.members)
    return isinstance(axis, Designed | FromFile)


NOT_COMPUTED = -1  # the status of a row that is not computed yet


class Output(NamedTuple):
    """A variable of a store: its dimensions and its shape after ``row``, type, units and meaning."""

    dimensions: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: np.dtype
    units: str
    meaning: str
    coordinate: bool = False
    own_units: tuple[str, ...] = ()  # of each entry, of states of one's own that state them

    @property
    def fill(self) -> Any:
        """The fill value for rows that are not computed."""
        # A status of −1 is none of a run, and NaN none of its numbers.
        return np.nan if self.dtype.kind == "f" else NOT_COMPUTED

    def empty(self, rows: int) -> np.ndarray:
        """Makes an array of fill values with ``rows`` rows."""
        return np.full((rows, *self.shape), self.fill, dtype=self.dtype)


def outputs_of(study: Study, template: Scenario) -> dict[str, Output]:
    """Returns every variable of a study's store by name: the row, the numbers that change, and the results."""
    outputs = {"row": Output((), (), np.dtype(np.int64), "", "row of the study", True)}
    dimensions_of_paths = _dimensions_of_paths(study, template)
    for path in study.paths:
        outputs[path] = _number(dimensions_of_paths[path], f"the number {path} of the scenario", coordinate=True)
    outputs |= {name: _output(variable) for name, variable in RUN.items()}
    saves = (template.times.size,) if study.save == "times" else ()
    dimensions = ("save",) * len(saves)
    # At the end of the run there is no axis of times.
    if saves:
        outputs["time"] = Output(dimensions, saves, np.dtype(np.float64), "time", "save time", True)
    for name, (variable, shape) in state_variables(template).items():
        outputs[name] = _output(variable._replace(dimensions=(*dimensions, *variable.dimensions)), (*saves, *shape))
    _, of_run = history_variables(template.system_to_solve)
    outputs |= {name: _output(variable) for name, variable in of_run.items()}
    if study.readings:
        outputs |= _of_readings(study, template)
    if template.feedback is not None:
        from .closed_loops import loop_variables  # which other studies do without

        outputs |= {name: _output(variable) for name, variable in loop_variables(template).items()}
    if study.contact:
        outputs |= {name: _output(variable) for name, variable in EXTREMES.items()}
    if finds_least_normal_force(study, template):
        outputs |= {name: _output(variable) for name, variable in LEFT_PLANE.items()}
    for event in template.events:
        for name, variable in variables_of_event(event).items():
            if name in outputs:
                raise StudyError(
                    f"Key `scenario.events` must have names whose variables are not in the store yet, but `{name}` is "
                    "taken; give that event another name."
                )
            outputs[name] = _output(variable)
    for find in study.finds:
        for name, end in ((find.name + end, end) for end in find.reduction().ends):
            # Results of jaxball's own names are meant to have them; a user's must not hide another variable.
            if find.kind and (name in outputs or name == AXES):
                raise StudyError(f"Key `find` must give names that are not in the store yet, but `{name}` is taken.")
            dimension = "time" if end == "_time" else "" if find.kind else (EXTREMES | FINDS)[name].units
            outputs[name] = _number(dimension, f"{name.replace('_', ' ')} {OF_RUN}")
    return {name: _as_stated(output, template) for name, output in outputs.items()}


def _as_stated(output: Output, template: Scenario) -> Output:
    """Returns a variable in the units that the scenario states; with feedback it says where it was looked at."""
    unit_of, states = str if template.units is None else template.units.of, getattr(template.system, "own_states", None)
    own_units = () if states is None or states.units is None else states.units_in(unit_of)
    # With feedback, inputs jump at the samples, between which nothing is looked for.
    meaning = output.meaning if template.feedback is None else output.meaning.replace(OF_RUN, AT_SAMPLES)
    if "own_state" not in output.dimensions:
        own_units = ()
    return output._replace(units=unit_of(output.units), own_units=own_units, meaning=meaning)


def _dimensions_of_paths(study: Study, template: Scenario) -> dict[str, str]:
    """Returns the dimension of each number that changes, in words; empty if the scenario states no units."""
    if template.units is None:
        return dict.fromkeys(study.paths, "")
    with kinds_of_numbers() as kinds:
        read_document(study.document)
    return {path: dimension_of(path, kinds, study.document) for path in study.paths}


def state_variables(template: Scenario) -> dict[str, tuple[Variable, tuple[int, ...]]]:
    """Returns the variables of the state at a time, with shapes: of the body and, where it has modes, of its
    history.
    """
    state = template.state
    body = state.body if isinstance(state, ReleasedState) else state
    # With feedback the state has θ of every input, also of those that the scenario moves by schedules.
    if template.feedback is not None:
        none = np.zeros(len(_system_of_rows(template).coordinates))
        body = dataclasses.replace(body, theta=none, thetadot=none)
    shapes = {name: np.shape(leaf) for name, leaf in arrays_of(body).items() if np.size(leaf)}
    # As of states along a leading axis.
    described = describe_fields(jax.tree.map(lambda leaf: np.asarray(leaf)[None], body))
    variables = {name: (described[name], shape) for name, shape in shapes.items()}
    over_time, _ = history_variables(template.system_to_solve)
    sizes = {"axis": 3, "direction": 2}
    return with_units_of_own(variables, template.system) | {
        name: (variable, tuple(sizes[axis] for axis in variable.dimensions)) for name, variable in over_time.items()
    }


def history_variables(system: AbstractSystem) -> tuple[dict[str, Variable], dict[str, Variable]]:
    """Returns the variables of the history of the system that is solved, by name: at a time, and of a run as
    a whole.
    """
    if not isinstance(system, BodyOnPlane) or system.contact is None:
        return {}, {}
    return HISTORY if system.pivot is None else HISTORY | OF_SLIDE, RUN_SWITCHES


def history_results(contact: AbstractHistory) -> dict[str, Array]:
    """Returns the variables of a history, of one run or of many, by name; with a law of contact, the contact's
    variables.
    """
    if not isinstance(contact, ContactHistory):
        return {}
    switches = contact.switches
    # Modes at saved times too, because there may have been more switches than there was room for.
    seen = jnp.concatenate([contact.mode, switches.source, switches.target], axis=-1)
    modes = sum(jnp.any(seen == int(mode), axis=-1).astype(int) << int(mode) for mode in Mode)
    of_switches = {"switches": switches.count, "first_switch": switches.times[..., 0], "modes": modes}
    return {name: getattr(contact, name) for name in HISTORY} | of_switches


def labels_of(outputs: dict[str, Output], template: Scenario) -> dict[str, np.ndarray]:
    """Returns the labels along each dimension except ``row``."""
    sizes = {name: n for item in outputs.values() for name, n in zip(item.dimensions, item.shape, strict=True)}
    return labels(_system_of_rows(template), sizes)


def _system_of_rows(template: Scenario) -> Any:
    """Returns the system of the states of rows: with feedback every input is in the state."""
    if template.feedback is None:
        return template.system
    from ...files.scenario.closed_loop import build_sampled_system  # as above

    return build_sampled_system(template).system


def finds_least_normal_force(study: Study, template: Scenario) -> bool:
    """Returns whether the study finds the least normal force of runs that are valid only as long as it is positive."""
    return not template.may_slip and (study.contact or any(find == Find(LEAST_FORCE) for find in study.finds))


def flag_departures(status: Int[np.ndarray, " rows"], least: Float[np.ndarray, " rows"]) -> Int[np.ndarray, " rows"]:
    """Flags with 1 a row whose least normal force was not positive, else 0; ``NOT_COMPUTED`` where that is NaN.

    A row that ended where it detached has left the plane, whatever the sign of a force that is zero but for rounding.
    """
    left = (least <= 0) | (status == Status.DETACHED)
    return np.where(np.isnan(least) & ~left, NOT_COMPUTED, left).astype(np.int8)


def went_on(status: Int[np.ndarray, " rows"], left: Int[np.ndarray, " rows"]) -> int:
    """Counts the rows that left the plane but did not end there."""
    return int(np.sum((left == 1) & (status != Status.DETACHED)))


EXTREME = {"least": np.nanmin, "largest": np.nanmax}


def with_extremes(results: dict[str, np.ndarray], template: Scenario | None) -> dict[str, np.ndarray]:
    """Returns the results with the extremes over time of the readings of a scenario's sensors; NaN without any."""
    extremes = {}
    for name in () if template is None else template.sensors:
        read = results[f"measured_{name}"]
        missing = np.all(np.isnan(read), axis=1)
        for word, extreme in EXTREME.items():
            # NumPy warns of rows without a number; they get 0 here and NaN below.
            readings = np.where(missing[:, None], 0.0, read)
            extremes[f"measured_{name}_{word}"] = np.where(missing, np.nan, extreme(readings, axis=1))
    return results | extremes


def _of_readings(study: Study, template: Scenario) -> dict[str, Output]:
    """Returns the variables of sensors' readings: their extremes over the save times, and the readings where they are
    kept.
    """
    system: Any = template.system
    state: Any = template.state.body if isinstance(template.state, ReleasedState) else template.state
    measurement = Measurement(dict(template.sensors))
    shapes = jax.eval_shape(lambda t: measurement.parts(system, t, state), jnp.zeros(()))
    outputs = {}
    for name, sensor in template.sensors.items():
        shape = shapes[name].shape
        axes = ("axis",) if shape == (3,) else tuple(f"measured_{name}_{k}" for k in range(len(shape)))
        variable = Variable(axes, sensor.units, sensor.meaning)
        if study.save == "times":
            outputs[f"measured_{name}"] = _output(
                variable._replace(dimensions=("save", *axes)), (template.times.size, *shape)
            )
        for word in EXTREME:
            outputs[f"measured_{name}_{word}"] = _output(variable._replace(meaning=f"{word} {variable.meaning}"), shape)
    return outputs


def _output(variable: Variable, shape: tuple[int, ...] = ()) -> Output:
    return Output(variable.dimensions, shape, np.dtype(variable.dtype), variable.units, variable.meaning)


def _number(units: str, meaning: str, coordinate: bool = False) -> Output:
    return Output((), (), np.dtype(np.float64), units, meaning, coordinate)
