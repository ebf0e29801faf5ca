"""Runs of scenarios with feedback: the motion of the model, the closed loop along it, and the robot of a saved run."""

import dataclasses
import tomllib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..control.inputs import recorded
from ..control.loop import ClosedLoop, closed_loop, limits_of
from ..control.sampled import SampledSystem
from ..estimation import OutputFeedback
from ..physics.body import System
from ..physics.force import Push, Wrenches
from ..simulation.trajectory import Trajectory
from .errors import ScenarioError
from .feedback import AbstractFeedbackSettings, in_keys, sample_of
from .files import read_document, write_scenario
from .paths import with_numbers
from .table import keeping_defaults

if TYPE_CHECKING:
    from ..control.feedback import AbstractFeedback
    from .scenario import Scenario


def model_of(scenario: "Scenario") -> "Scenario":
    """The scenario as its feedback knows it: with the numbers of the model, and without feedback.

    **Raises:** :class:`ScenarioError` where a file cannot hold the scenario, or a path of the model leads nowhere in
    what is written.
    """
    settings = settings_of(scenario)
    alone = dataclasses.replace(scenario, feedback=None, estimator=None, sensors={})
    if not settings.model:
        return alone
    with keeping_defaults():
        document = tomllib.loads(write_scenario(alone))
    try:
        return read_document(with_numbers(document, settings.model))
    except (LookupError, TypeError):
        raise ScenarioError(
            f"Key `feedback.model` must have paths of numbers that a written scenario has, but one of "
            f"{', '.join(settings.model)} is not there; write the scenario with `jaxball.write_scenario` to see them."
        ) from None


def nominal_run(scenario: "Scenario") -> Trajectory[Any, Any]:
    """The motion that is held: the run of the model, which may have failed."""
    return model_of(scenario).simulate()


def feedback_along(scenario: "Scenario", run: Trajectory[Any, Any]) -> "AbstractFeedback":
    """The feedback of a scenario along a run of its model, from its state."""
    with in_keys():
        return settings_of(scenario).along(run, sample_of(scenario.times), scenario.rtol, scenario.atol)


def with_estimator(scenario: "Scenario", feedback: "AbstractFeedback") -> "AbstractFeedback":
    """The same feedback from what the sensors of the scenario read, if it has an estimator."""
    estimator = scenario.estimator
    if estimator is None:
        return feedback
    with in_keys("estimator"):
        return OutputFeedback.of(
            feedback,
            estimator.chosen(scenario.sensors),
            spread=estimator.spread,
            process=estimator.process,
            biases=estimator.biases,
            system=robot_of(scenario),
        )


def robot_of(scenario: "Scenario") -> System:
    """The body of a scenario with the pushes on it."""
    return with_pushes(scenario.system, settings_of(scenario).pushes)


def sampled_of(scenario: "Scenario") -> SampledSystem:
    """The robot that is simulated, with its inputs."""
    return SampledSystem.of(robot_of(scenario), sample_of(scenario.times), settings_of(scenario).inputs)


def with_pushes(system: Any, pushes: Sequence[Push]) -> System:
    """A body with pushes on it, besides its own external force."""
    assert isinstance(system, System)  # which alone has feedback
    if not pushes:
        return system
    forces = [*([] if system.force is None else [system.force]), *pushes]
    whole = Wrenches(tuple(forces)) if len(forces) > 1 else forces[0]
    return eqx.tree_at(lambda s: s.force, system, whole, is_leaf=lambda x: x is None)


def loop_along(scenario: "Scenario", feedback: "AbstractFeedback", start: Any = None) -> ClosedLoop:
    """The closed loop of a scenario, from ``start`` beside its motion or else from its own."""
    settings = settings_of(scenario)
    with in_keys():
        return closed_loop(
            feedback,
            settings.start if start is None else start,
            system=robot_of(scenario),
            limits=settings.limits,
            delay=settings.delay,
        )


def system_of_run(scenario: "Scenario", u: Float[np.ndarray, "T m"]) -> System:
    """The robot of a saved run with the inputs that acted, which are those from each save time on."""
    settings, times = settings_of(scenario), jnp.asarray(scenario.times)
    sampled = sampled_of(scenario)
    limits = sampled.limits if settings.limits is None else limits_of(sampled, settings.limits)
    return recorded(sampled.system, sampled.places, limits, times, jnp.asarray(u[:-1]))


def settings_of(scenario: "Scenario") -> AbstractFeedbackSettings:
    """The settings of its feedback.

    **Raises:** :class:`ScenarioError` where it has none.
    """
    if scenario.feedback is None:
        raise ScenarioError(
            "The scenario must have a table [feedback], but it has none; give one, such as `feedback = { kind = "
            '"tvlqr", Q = 1.0, R = 1.0 }`.'
        )
    return scenario.feedback
