"""Builds the closed loop of a scenario with feedback: the model's motion, the loop along it, the robot of a saved run.

The numbers of a loop that a study may change from row to row are all arrays.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...control.estimation import ErrorStateFilter, OutputFeedback
from ...control.estimation.filter import samples_late, wanders
from ...control.feedback import AbstractFeedback, Feedforward, nominal_from
from ...control.inputs import replay_inputs
from ...control.loop import ClosedLoop, limits_of, plant_of
from ...control.prediction import inputs_with_limits, predictive
from ...control.sampled import SampledSystem
from ...control.track import build_track, factors_of
from ...control.weights import by_name, weight_matrix
from ...interface.compat import is_traced
from ...numerics.arrays import to_array
from ...physics.body import System
from ...physics.contact.law import Contact
from ...physics.forces.force import Push, Wrenches
from ...physics.sensors import AbstractSensor
from ...physics.sensors.base import Measurement
from ...physics.state import PlacedState
from ...simulation.trajectory import Trajectory
from .errors import ScenarioError
from .feedback import (
    AbstractFeedbackSettings,
    EstimatorSettings,
    PredictiveSettings,
    RegulatorSettings,
    check_solver,
    document_of_model,
    in_keys,
    sample_of,
)
from .files import Contents, document_with_defaults, read_contents, read_document
from .paths import with_numbers
from .scenario import Scenario
from .values import require


def model_of(scenario: Scenario) -> Scenario:
    """Returns the scenario as its feedback knows it: with the numbers of the model, and without feedback.

    **Raises:** :class:`ScenarioError` where a file cannot hold the scenario, or a path of the model leads nowhere in
    what is written.
    """
    settings = settings_of(scenario)
    # Sensors and feedback of the file belong to the real robot, and its model is simulated without them.
    # It rolls, as the motion that it holds does.
    alone = dataclasses.replace(scenario, feedback=None, estimator=None, sensors={}, contact=None)
    if not settings.model:
        return alone
    document = document_with_defaults(alone)
    try:
        return read_document(with_numbers(document, settings.model))
    except (LookupError, TypeError):
        raise ScenarioError(
            f"Key `feedback.model` must have paths of numbers that a written scenario has, but one of "
            f"{', '.join(settings.model)} is not there; write the scenario with `jaxball.write_scenario` to see them."
        ) from None


def nominal_run(scenario: Scenario) -> Trajectory[Any, Any]:
    """Simulates the motion that is held: the run of the model, which may have failed."""
    return model_of(scenario).simulate()


def feedback_along(scenario: Scenario, run: Trajectory[Any, Any]) -> AbstractFeedback:
    """Returns the feedback of a scenario along a run of its model, from its state."""
    with in_keys():
        return settings_of(scenario).along(run, sample_of(scenario.times), scenario.rtol, scenario.atol)


def with_estimator(scenario: Scenario, feedback: AbstractFeedback) -> AbstractFeedback:
    """Returns the same feedback, but from the readings of the scenario's sensors if it has an estimator."""
    estimator = scenario.estimator
    if estimator is None:
        return feedback
    with in_keys("estimator"):
        return OutputFeedback.of(
            feedback,
            estimator.choose(scenario.sensors),
            spread=estimator.spread,
            process=estimator.process,
            biases=estimator.biases,
            system=robot_of(scenario),
        )


def robot_of(scenario: Scenario) -> System:
    """Returns the body of a scenario with the pushes on it."""
    return with_pushes(scenario.system, settings_of(scenario).pushes)


def build_sampled_system(scenario: Scenario) -> SampledSystem:
    """Builds the robot that is simulated, with its inputs."""
    return SampledSystem.of(robot_of(scenario), sample_of(scenario.times), settings_of(scenario).inputs)


def with_pushes(system: Any, pushes: Sequence[Push]) -> System:
    """Returns a body with pushes on it, besides its own external force."""
    assert isinstance(system, System)  # which alone has feedback
    if not pushes:
        return system
    forces = [*([] if system.force is None else [system.force]), *pushes]
    whole = Wrenches(tuple(forces)) if len(forces) > 1 else forces[0]
    return eqx.tree_at(lambda s: s.force, system, whole, is_leaf=lambda x: x is None)


def build_loop(scenario: Scenario) -> ClosedLoop:
    """Builds the closed loop of :meth:`Scenario.closed_loop`."""
    feedback = feedback_along(scenario, nominal_run(scenario).raise_if_failed())
    return loop_along(scenario, with_estimator(scenario, feedback))


def simulate_loop(scenario: Scenario, asks_for_more: bool) -> Trajectory[Any, Any]:
    """Simulates the closed loop, or returns the run of the motion where that fails.

    **Raises:** :class:`ScenarioError` for a solver that feedback does not support, and if the caller
    ``asks_for_more``: for dense output or events.
    """
    check_solver(scenario.solver)
    if asks_for_more:
        raise ScenarioError(
            "A scenario with `feedback` has no dense output and no events, because its samples are solved one by one; "
            "simulate without them."
        )
    run = nominal_run(scenario)
    if not run.ok:
        # Its message says why there is no motion to hold.
        return run.set_scenario(scenario)
    feedback = feedback_along(scenario, run)
    return loop_along(scenario, with_estimator(scenario, feedback)).run.set_scenario(scenario)


def loop_along(scenario: Scenario, feedback: AbstractFeedback) -> ClosedLoop:
    """Builds the closed loop of a scenario, from its own start."""
    settings = settings_of(scenario)
    with in_keys():
        return feedback.closed_loop(
            settings.start,
            system=robot_of(scenario),
            limits=settings.limits,
            delay=settings.delay,
            contact=scenario.contact,
        )


def system_of_run(scenario: Scenario, u: Float[np.ndarray, "T m"]) -> System:
    """Returns the robot of a saved run with the inputs that acted, each from its save time on."""
    settings, times = settings_of(scenario), jnp.asarray(scenario.times)
    sampled = build_sampled_system(scenario)
    limits = sampled.limits if settings.limits is None else limits_of(sampled, settings.limits)
    return replay_inputs(sampled.system, sampled.places, limits, times, jnp.asarray(u[:-1]))


def settings_of(scenario: Scenario) -> AbstractFeedbackSettings:
    """Returns the settings of a scenario's feedback.

    **Raises:** :class:`ScenarioError` where it has none.
    """
    if scenario.feedback is None:
        raise ScenarioError(
            "The scenario must have a table [feedback], but it has none; give one, such as `feedback = { kind = "
            '"tvlqr", Q = 1.0, R = 1.0 }`.'
        )
    return scenario.feedback


class EstimatorNumbers(eqx.Module):
    """The numbers of an estimator.

    - ``sensors``: those that are read, by name.
    - ``spread``, ``process``: of the local coordinates.
    - ``biases``: the standard deviations of biases that are estimated, by the names of sensors.
    - ``late``: by how many samples each sensor is late, with its name.
    """

    sensors: dict[str, AbstractSensor]
    spread: Float[Array, " n"]
    process: Float[Array, " n"]
    biases: dict[str, Float[Array, ""]]
    late: tuple[tuple[str, int], ...] = eqx.field(static=True)

    def around(self, feedback: AbstractFeedback, plant: SampledSystem) -> OutputFeedback:
        """Builds the feedback from the readings of a robot's sensors; traceable."""
        # As JAX orders dictionaries, and as the errors of readings are ordered.
        sensors = Measurement(dict(sorted(self.sensors.items())))
        estimator = ErrorStateFilter(feedback.sampled, sensors, self.process, dict(sorted(self.biases.items())))
        return OutputFeedback.of_parts(feedback, estimator, plant, self.spread, dict(self.late))


class LoopNumbers(eqx.Module):
    """The numbers that determine a closed loop, besides its times.

    - ``robot``: the robot that is simulated, with the pushes on it.
    - ``contact``: the law by which it may slip and fly, or None.
    - ``model``, ``state``: the robot that feedback knows, and the start of its motion.
    - ``rtol``, ``atol``: tolerances.
    - ``limits``: the largest magnitudes of inputs; None for those of the motors.
    - ``start``: by how much the run starts beside the motion, in local coordinates.
    - ``delay``: in samples.
    - ``W``, ``S``: factors of the weights of a sample and at the end, of :func:`jaxball.control.tvlqr`; W is None
      without feedback, and S without weights at the end.
    - ``friction``, ``penalty``: of predictive control, or None.
    - ``estimator``: its numbers, or None for feedback of the state.
    - ``inputs``: their names, None for all.
    - ``horizon``: of predictive control, or None.
    - ``limited``: the inputs that predictive control bounds.
    """

    robot: System
    contact: Contact | None
    model: System
    state: Any
    rtol: Any
    atol: Any
    limits: Float[Array, " m"] | None
    start: Float[Array, " n"]
    delay: Int[Array, ""]
    W: Float[Array, "rows n_plus_m"] | None
    S: Float[Array, "rows_at_end n_plus_one"] | None
    friction: Float[Array, ""] | None
    penalty: Float[Array, ""] | None
    estimator: EstimatorNumbers | None
    inputs: tuple[str, ...] | None = eqx.field(static=True)
    horizon: int | None = eqx.field(static=True)
    limited: tuple[int, ...] = eqx.field(static=True)

    @property
    def of_feedback(self) -> tuple[Any, ...]:
        """The numbers on which the motion, and the feedback from its state, depend."""
        # A regulator is clipped by the robot itself; only a predictive one depends on limits.
        of_limits = None if self.horizon is None else self.limits
        return self.model, self.state, self.rtol, self.atol, of_limits, self.W, self.S, self.friction, self.penalty

    def feedback(self, sample: Any, t0: Any, samples: int) -> AbstractFeedback:
        """Builds the feedback from the state along the motion; traceable."""
        sampled = SampledSystem.of(self.model, sample, self.inputs, self.rtol, self.atol)
        nominal = nominal_from(self.model, t0, self.state, sampled, samples)
        if self.W is None:
            return Feedforward(sampled, nominal)
        track = build_track(sampled, nominal, self.W, self.S)
        if self.horizon is None or self.penalty is None:
            return track
        most = sampled.limits if self.limits is None else self.limits
        return predictive(track, self.horizon, most, self.friction, self.penalty, self.limited)

    def around(self, feedback: AbstractFeedback) -> tuple[AbstractFeedback, SampledSystem, PlacedState]:
        """Returns the feedback, from sensors if there is an estimator, the robot and its start; traceable."""
        first = feedback.sampled.displace(feedback.nominal.state(0), self.start)
        plant = plant_of(feedback, self.robot, self.limits, contact=self.contact)
        if self.estimator is None:
            return feedback, plant, first
        return self.estimator.around(feedback, plant), plant, first


def loop_numbers(contents: Contents, document: Mapping[str, Any], sample: float) -> LoopNumbers:
    """Returns the numbers of a file with feedback, which may be traced.

    **Raises:** :class:`~jaxball.ScenarioError` as where the file is read.
    """
    feedback, system, solve = contents.feedback, contents.system, contents.solve
    assert feedback is not None
    model_contents = contents
    if feedback.model:
        # The whole document is read again, because angles in balance and the like follow from the model's numbers.
        model_contents = read_contents(document_of_model(feedback.model, document))
    model: Any = model_contents.system
    sampled = SampledSystem.of(model, sample, feedback.inputs)
    limits = None if feedback.limits is None else limits_of(sampled, feedback.limits)
    W, S = _weights(feedback, sampled, sample)
    predictive_control = isinstance(feedback, PredictiveSettings)
    return LoopNumbers(
        robot=with_pushes(system, feedback.pushes),
        contact=contents.contact,
        model=model,
        state=model_contents.state,
        rtol=jnp.asarray(solve["rtol"]),
        atol=jnp.asarray(solve["atol"]),
        limits=limits,
        start=to_array(by_name("start", feedback.start, sampled.directions)),
        delay=jnp.asarray(feedback.delay, int),
        W=W,
        S=S,
        friction=to_array(feedback.friction) if predictive_control and feedback.friction is not None else None,
        penalty=to_array(feedback.penalty) if predictive_control else None,
        estimator=None if contents.estimator is None else _of_estimator(contents.estimator, contents.sensors, sampled),
        inputs=feedback.inputs,
        horizon=feedback.horizon if predictive_control else None,
        # Which inputs have limits decides how many rows the program has, and cannot change from row to row.
        limited=inputs_with_limits(sampled.limits if limits is None else limits) if predictive_control else (),
    )


def _weights(feedback: AbstractFeedbackSettings, sampled: SampledSystem, sample: float) -> tuple[Any, Any]:
    """Reads factors of the weights; conditions on those that are traced are kept."""
    if not isinstance(feedback, RegulatorSettings):
        return None, None
    of_state, of_inputs = sampled.directions, sampled.inputs
    for name, weight, names, holds in (
        ("Q", feedback.Q, of_state, lambda least: least >= 0),
        ("R", feedback.R, of_inputs, lambda least: least > 0),
        ("Qf", feedback.Qf, of_state, lambda least: least >= 0),
    ):
        matrix = None if weight is None else weight_matrix(name, weight, names)
        if is_traced(matrix):
            # The least eigenvalue stands for all, as for known weights.
            least = jnp.linalg.eigvalsh(matrix)[0]
            require(holds(least), f"feedback.{name}", "weights that are not negative", lambda: "")
    return factors_of(sample, sampled, feedback.Q, feedback.R, feedback.Qf)


def _of_estimator(
    estimator: EstimatorSettings, sensors: Mapping[str, AbstractSensor], sampled: SampledSystem
) -> EstimatorNumbers:
    def of(name: str, values: Any) -> Float[Array, " n"]:
        return to_array(by_name(name, values, sampled.directions))

    chosen = estimator.choose(sensors)
    for name, sensor in chosen.items():
        if sensor.errors is not None and is_traced(sensor.errors.noise):
            require(sensor.errors.noise > 0, f"sensors.{name}.errors.noise", "a positive number", lambda: "")
    spreads = {name: 0.0 for name, sensor in chosen.items() if wanders(sensor)} | dict(estimator.biases)
    biases = {name: to_array(value) for name, value in spreads.items()}
    late = tuple((name, samples_late(name, sensor, sampled)) for name, sensor in chosen.items())
    return EstimatorNumbers(chosen, of("spread", estimator.spread), of("process", estimator.process), biases, late)
