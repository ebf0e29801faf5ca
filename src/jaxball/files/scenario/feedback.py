"""Feedback and estimators in a scenario file: what holds the motion of the scenario, and what it knows of the state."""

import abc
import contextlib
import functools
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Array

from ...interface.status import PENALTY
from ...numerics.declare import FINITE, NOT_NEGATIVE, PER_TIME, POSITIVE, Rule
from ...physics.body import System
from ...physics.forces.force import Push
from ...physics.sensors import AbstractSensor
from .errors import ScenarioError, describe, each_of, key_error
from .own import module_of
from .paths import check_number, with_numbers
from .solve import SaveTimes
from .table import Family, Key, Module, join, keys_of, read_list, write_family
from .values import Integer, Names, Nested, Numbers, WholeNumber, is_traced_document, unread

if TYPE_CHECKING:
    from ...control.feedback import AbstractFeedback
    from ...control.sampled import SampledSystem
    from ...simulation.trajectory import Trajectory

Number = float | Array  # an array where it is traced
Named = Mapping[str, Number]
SOLVER = "dopri8"  # of the samples of a closed loop
RELEASED = ("velocity", "height")  # keys of [initial] of a body that starts otherwise than it rolls
OF_MODEL = ("body", "force", "ground", "resistance", "masses", "mechanisms", "actuation")


@dataclass(frozen=True, eq=False, kw_only=True)
class AbstractFeedbackSettings(abc.ABC):
    """What holds the motion of a scenario, which is its run without feedback; the samples are the save times.

    A kind of feedback implements ``along``.

    - ``inputs``: the inputs, joints and masses such as ``"mechanisms[0].joints[0]"``; all that a schedule, a law or a
      motor moves if not given.
    - ``limits``: the largest magnitude of each input, in its unit; those of the motors if not given.
    - ``delay``: how many samples pass before what feedback adds takes effect.
    - ``start``: by how much the run starts beside the motion, in local coordinates, such as
      ``{ z = 0.1, "Omega[1]" = 0.3 }``.
    - ``pushes``: further forces on the robot for some time, each under [[feedback.pushes]]. Each a
      :class:`~jaxball.control.Push`.
    - ``model``: what the motion and the feedback take for numbers of the scenario, by their paths, such as
      ``{ "body.mass" = 0.9 }``; the robot itself has those of the scenario.
    """

    inputs: tuple[str, ...] | None = None
    limits: Number | Named | None = None
    delay: Any = 0
    start: Named = field(default_factory=dict)
    pushes: tuple[Push, ...] = ()
    model: Named = field(default_factory=dict)

    @abc.abstractmethod
    def along(self, run: "Trajectory[Any, Any]", sample: float, rtol: float, atol: float) -> "AbstractFeedback":
        """Returns the feedback along a run of the model."""

    def check(self, sampled: "SampledSystem") -> None:
        """Raises a ``ValueError`` for names and sizes that do not fit the robot."""
        each_of(*(functools.partial(_in_keys, check) for check in self._checks(sampled)))

    def _checks(self, sampled: "SampledSystem") -> list[Callable[[], object]]:
        """Returns functions that raise, which are independent, so that all that is wrong is named at once."""
        from ...control.loop import limits_of
        from ...control.weights import by_name

        return [
            lambda: by_name("start", self.start, sampled.directions),
            lambda: self.limits is None or limits_of(sampled, self.limits),
        ]


@dataclass(frozen=True, eq=False, kw_only=True)
class FeedforwardSettings(AbstractFeedbackSettings):
    """The inputs of the motion alone, without feedback."""

    def along(self, run, sample, rtol, atol):
        from ...control.feedback import Feedforward, nominal_of, samples_in
        from ...control.sampled import SampledSystem

        sampled = SampledSystem.of(run.system, sample, self.inputs, rtol, atol)
        return Feedforward(sampled, nominal_of(run, sampled, samples_in(run.times, sample)))


@dataclass(frozen=True, eq=False, kw_only=True)
class RegulatorSettings(AbstractFeedbackSettings):
    """The linear quadratic regulator along the motion of a scenario.

    It is that of :func:`jaxball.control.tvlqr`.

    - ``Q``: the weights of local coordinates, per deviation² and time.
    - ``R``: the weights of inputs, positive, per input² and time.
    - ``Qf``: the weights of local coordinates at the end, per deviation²; the cost-to-go of holding the last state if
      not given.
    - The others: as for :class:`AbstractFeedbackSettings`.
    """

    Q: Any
    R: Any
    Qf: Any = None

    def along(self, run: Any, sample: float, rtol: float, atol: float) -> "AbstractFeedback":
        from ...control.track import tvlqr

        return tvlqr(run, self.Q, self.R, self.Qf, sample=sample, inputs=self.inputs, rtol=rtol, atol=atol)

    def _checks(self, sampled):
        from ...control.weights import require_positive, weight_matrix

        return [
            *super()._checks(sampled),
            lambda: weight_matrix("Q", self.Q, sampled.directions),
            lambda: require_positive("R", weight_matrix("R", self.R, sampled.inputs), strictly=True),
            lambda: self.Qf is None or weight_matrix("Qf", self.Qf, sampled.directions),
        ]


@dataclass(frozen=True, eq=False, kw_only=True)
class PredictiveSettings(RegulatorSettings):
    """Predictive control along the motion of a scenario.

    It is that of :meth:`jaxball.control.track.Track.mpc`.

    - ``horizon``: the number of samples that it looks ahead.
    - ``friction``: the coefficient μ of |f| ≤ μN that it keeps to; any if not given.
    - ``penalty``: the cost of exceeding a limit by its own size, 1/time.
    - ``Q``, ``R``, ``Qf``: as for :class:`RegulatorSettings`.
    - The others: as for :class:`AbstractFeedbackSettings`.
    """

    horizon: int
    friction: Number | None = None
    penalty: Number = PENALTY

    def along(self, run, sample, rtol, atol):
        from ...control.track import Track

        track = super().along(run, sample, rtol, atol)
        assert isinstance(track, Track)
        return track.mpc(self.horizon, limits=self.limits, friction=self.friction, penalty=self.penalty)


@dataclass(frozen=True, eq=False, kw_only=True)
class EstimatorSettings:
    """The error-state filter of a closed loop: the feedback acts on what sensors of the scenario read.

    - ``spread``: the standard deviations of local coordinates at the start; 0 for others.
    - ``process``: how much the motion differs from that of the model, in units of the coordinates over √time. See
      :class:`jaxball.control.estimation.ErrorStateFilter`.
    - ``biases``: the standard deviations of biases of sensors at the start, by the sensors' names.
    - ``sensors``: the names of the sensors that are read; all if not given.
    """

    spread: Named
    process: Named = field(default_factory=dict)
    biases: Named = field(default_factory=dict)
    sensors: tuple[str, ...] | None = None

    def choose(self, sensors: Mapping[str, AbstractSensor]) -> dict[str, AbstractSensor]:
        """Chooses the sensors that are read, of those of the scenario."""
        return {name: sensors[name] for name in (sensors if self.sensors is None else self.sensors)}


@dataclass(frozen=True)
class _ByName:
    """Numbers by name in a table; or a number, or lists of numbers of some of the ``shapes``."""

    rule: Rule = FINITE
    shapes: tuple[tuple[None, ...], ...] = ()

    @property
    def words(self) -> str:
        table = f"a table of {Numbers(rule=self.rule).words.removeprefix('a ')}s by name"
        return " or ".join([*(Numbers(shape, self.rule).words for shape in self.shapes), table])

    def read(self, value: Any, path: str) -> Any:
        if isinstance(value, dict):
            number = Numbers(rule=self.rule)
            return {name: number.read(item, join(path, name)) for name, item in value.items()}
        for shape in self.shapes:
            if _depth(value) == len(shape):
                return Numbers(shape, self.rule).read(value, path)
        raise key_error(path, self.words, describe(value))

    def write(self, value: Any, path: str) -> Any:
        if isinstance(value, Mapping):
            return {name: float(item) for name, item in value.items()} or None
        return np.asarray(value, dtype=float).tolist()


def _depth(value: Any) -> int:
    """Returns how deeply the lists of a value are nested; NumPy refuses rows of different lengths."""
    return 1 + _depth(value[0]) if isinstance(value, list) and value else np.ndim(value)


_PUSH = module_of(Push)


def _read_pushes(values: Any, path: str) -> tuple[Push, ...]:
    return tuple(read_list(values, path, _PUSH.read, empty=True))


def _write_pushes(pushes: tuple[Push, ...], path: str) -> list[dict[str, Any]] | None:
    return [_PUSH.write(push, f"{path}[{k}]") for k, push in enumerate(pushes)] or None


_NAMED = Key(_ByName(), None)
_SIZES = Key(_ByName(NOT_NEGATIVE), None)
_WEIGHTS = _ByName(shapes=((), (None,), (None, None)))
_FEEDFORWARD = {
    "inputs": Key(Names(), None),
    "limits": Key(_ByName(NOT_NEGATIVE, shapes=((),)), None),
    "delay": Key(WholeNumber(0, 10**6), 0),
    "start": _NAMED,
    "pushes": Key(Nested(_read_pushes, _write_pushes, "a list of tables", {"": _PUSH.keys}, forms=("list",)), ()),
    "model": _NAMED,
}
_REGULATOR = {"Q": Key(_WEIGHTS), "R": Key(_WEIGHTS), "Qf": Key(_WEIGHTS, None), **_FEEDFORWARD}
_PREDICTIVE = {
    **_REGULATOR,
    "horizon": Key(Integer(1, 10**6)),
    "friction": Key(Numbers(rule=POSITIVE), None),
    "penalty": Key(Numbers(rule=POSITIVE, dimension=PER_TIME), PENALTY),
}
FEEDBACK: Family = {
    "feedforward": Module(FeedforwardSettings, _FEEDFORWARD),
    "tvlqr": Module(RegulatorSettings, _REGULATOR),
    "mpc": Module(PredictiveSettings, _PREDICTIVE),
}
ESTIMATOR = Module(
    EstimatorSettings,
    {"spread": Key(_ByName(NOT_NEGATIVE)), "process": _SIZES, "biases": _SIZES, "sensors": Key(Names(), None)},
)
KEYS = {
    "feedback": Key(unread(tables=keys_of(FEEDBACK)), None, says="feedback that holds the motion, at the save times"),
    "estimator": Key(
        unread(tables={"": ESTIMATOR.keys}),
        None,
        says="the filter by which feedback knows the state; if not given, it knows it exactly",
    ),
}


def write_settings(
    feedback: AbstractFeedbackSettings | None, estimator: EstimatorSettings | None
) -> dict[str, dict[str, Any]]:
    """Returns the tables [feedback] and [estimator], where there are such."""
    tables = {} if feedback is None else {"feedback": write_family(feedback, "feedback", FEEDBACK)}
    return tables if estimator is None else tables | {"estimator": ESTIMATOR.write(estimator, "estimator")}


def check_feedback(
    feedback: AbstractFeedbackSettings | None,
    estimator: EstimatorSettings | None,
    sensors: Mapping[str, AbstractSensor],
    system: System,
    times: SaveTimes,
    solve: Mapping[str, Any],
    document: Mapping[str, Any],
    read: Callable[[dict[str, Any]], object],
) -> None:
    """Raises where feedback or an estimator does not fit the rest of the scenario; ``read`` reads a document."""
    if feedback is None:
        if estimator is not None:
            raise ScenarioError(
                "Key `estimator` needs a table [feedback], whose samples it reads; give one, such as `feedback = { "
                'kind = "feedforward" }` for a motion without feedback.'
            )
        return
    # A study has read the document with known numbers before, where a model and weights can be judged.
    if is_traced_document():
        return
    each_of(
        lambda: _check_solve(document, solve),
        lambda: sample_of(times.array(times.count)),
        lambda: check_model(feedback.model, document, read),
        lambda: _check_fit(feedback, estimator, system, times, sensors),
    )


def _check_solve(document: Mapping[str, Any], solve: Mapping[str, Any]) -> None:
    if document.get("events"):
        raise ScenarioError(
            "Key `events` must be left out with `feedback`, whose samples are solved one by one; the saved states say "
            "where the body was at each of them."
        )
    released = next((name for name in RELEASED if name in document.get("initial", {})), None)
    if released is not None:
        raise ScenarioError(
            f"Key `initial.{released}` must be left out with `feedback`, because the motion that it holds rolls from "
            "the start."
        )
    check_solver(solve["solver"])
    for name in ("dae", "project"):
        if solve[name]:
            raise key_error(f"solve.{name}", "false with `feedback`", "true")


def check_solver(solver: str) -> None:
    """Raises for another solver than that of the samples of a closed loop."""
    if solver != SOLVER:
        raise key_error("solve.solver", f'"{SOLVER}" with `feedback`, whose samples it solves', describe(solver))


def sample_of(times: np.ndarray) -> float:
    """Returns the time between samples: the save times of a scenario with feedback, which must be equally spaced."""
    even = np.linspace(times[0], times[-1], times.size)
    # Written decimals of a step are rounded.
    if np.any(np.abs(times - even) > 1e-9 * (times[-1] - times[0])):
        raise ScenarioError(
            "Key `time.at` must have equally spaced times with `feedback`, because they are its samples, but it has "
            "not; give `start`, `end` and `step`."
        )
    return float(times[-1] - times[0]) / (times.size - 1)


def check_model(model: Named, document: Mapping[str, Any], read: Callable[[dict[str, Any]], object]) -> None:
    """Raises for a path of a model that is none of a number of the robot, and for numbers that no robot can have.

    A model is a robot of its own: it is checked as the document of the scenario is, by the function that reads both.
    """
    for path in model:
        if re.split(r"[.\[]", path)[0] not in OF_MODEL:
            raise ScenarioError(
                f"Key `feedback.model` must have paths of numbers of the robot as keys, in {', '.join(OF_MODEL)}, but "
                f"one is {describe(path)}."
            )
        try:
            check_number(document, path)
        except ScenarioError as error:
            raise ScenarioError(f"Key `feedback.model` has a wrong path: {error}") from None
    if model:
        try:
            read(document_of_model(model, document))
        except ScenarioError as error:
            raise ScenarioError(f"Key `feedback.model` makes an impossible robot: {error}") from None


def document_of_model(model: Named, document: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the document of the robot that feedback knows, with the numbers of the model and without feedback."""
    # Without feedback, or the model would have a model; and it rolls.
    others = {name: table for name, table in document.items() if name not in (*KEYS, "contact")}
    return with_numbers(others, model)


def _check_fit(
    feedback: AbstractFeedbackSettings,
    estimator: EstimatorSettings | None,
    system: System,
    times: SaveTimes,
    sensors: Mapping[str, AbstractSensor],
) -> None:
    from ...control.sampled import SampledSystem

    sample = (times.end - times.start) / (times.count - 1)
    sampled = _in_keys(SampledSystem.of, system, sample, feedback.inputs)
    each_of(
        lambda: feedback.check(sampled),
        lambda: estimator is None or _check_estimator(estimator, sampled, sensors),
    )


def _check_estimator(
    estimator: EstimatorSettings, sampled: "SampledSystem", sensors: Mapping[str, AbstractSensor]
) -> None:
    from ...control.estimation import ErrorStateFilter
    from ...control.estimation.filter import samples_late

    for name in estimator.sensors or ():
        if name not in sensors:
            reference = f"they are {', '.join(sensors)}" if sensors else "there are none"
            raise key_error("estimator.sensors", f"names of sensors of the scenario; {reference}", describe(name))
    chosen = estimator.choose(sensors)
    with in_keys("estimator"):
        reference = ErrorStateFilter.for_sampled_system(sampled, chosen, estimator.process, estimator.biases)
        reference.deviations(estimator.spread)
        for name, sensor in chosen.items():
            samples_late(name, sensor, sampled)


@contextlib.contextmanager
def in_keys(path: str = "feedback") -> Iterator[None]:
    """Turns errors of arguments within this block into those of the keys of the table at ``path``."""
    try:
        yield
    except (ValueError, TypeError) as error:
        if isinstance(error, ScenarioError):
            raise
        raise ScenarioError(_sentence(str(error), path)) from None


def _in_keys(function: Any, *arguments: Any) -> Any:
    with in_keys():
        return function(*arguments)


def _sentence(text: str, path: str) -> str:
    text = re.sub(r"Argument `sensors\['(\w+)'\](\.?[\w.]*)`", r"Key `sensors.\1\2`", text)
    text = text.replace("Argument `sensors`", "Key `sensors`")
    text = text.replace("Argument `system` must have inputs", "Key `feedback` is for a robot with inputs")
    return re.sub(r"Argument `([^`]+)`", rf"Key `{path}.\1`", text)
