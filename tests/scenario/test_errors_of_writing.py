"""What a scenario file cannot hold is one sentence that names the key."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import (
    Ball,
    BallState,
    Circle,
    ConstantRate,
    Driven,
    Free,
    FunctionForce,
    FunctionLaw,
    FunctionRail,
    FunctionSchedule,
    OnRail,
    PointMass,
    ReducedState,
)
from jaxball.scenario import Scenario, ScenarioError, write_scenario
from jaxball.scenario.initial import write_initial


def on_circle(motion):
    return [PointMass(1.0, motion)]


def nowhere(*_):
    return jnp.zeros(3)


def still(*_):
    return jnp.zeros(())


def coasting(*_):
    return jnp.zeros(1)


SCRIPT = "; keep a scenario that has Python functions as a Python script."
FUNCTIONS = {
    "rail": (
        {"masses": on_circle(OnRail(FunctionRail(nowhere), ConstantRate(0.0)))},
        "Key `masses[0].rail` must be one of Circle, Ellipse, GeronoEight, BernoulliEight, Tube, "
        "FourierRail, "
        "SplineRail to be written to a file, but it is a FunctionRail" + SCRIPT,
    ),
    "schedule": (
        {"masses": on_circle(OnRail(Circle(0.5), FunctionSchedule(still)))},
        "Key `masses[0].schedule` must be one of Pulse, ConstantRate, Sinusoids, PiecewiseAcceleration, "
        "Waypoints, RecordedSchedule to be written to a file, but it is a FunctionSchedule" + SCRIPT,
    ),
    "motion": (
        {"masses": on_circle(Free(nowhere))},
        "Key `masses[0]` must be on a rail, at a position or oscillating to be written to a file, "
        "but its motion "
        "is a Free" + SCRIPT,
    ),
    "law": (
        {"masses": on_circle(Driven(Circle(0.5))), "law": FunctionLaw(coasting)},
        "Key `actuation` must be a FollowSchedules, a Servo or a LinearLaw to be written to a file, but the "
        "law is a FunctionLaw" + SCRIPT,
    ),
    "force": (
        {"force": FunctionForce(nowhere)},
        "Key `force` must be one of HarmonicForce, FunctionWrench to be written to a file, but it is a FunctionForce"
        + SCRIPT,
    ),
}


@pytest.mark.parametrize(("parts", "sentence"), FUNCTIONS.values(), ids=FUNCTIONS.keys())
def test_python_function_has_no_place_in_a_file(parts, sentence):
    system = Ball(mass=1.0, inertia=(1.0, 1.0, 1.0), **parts)
    with pytest.raises(ScenarioError) as caught:
        write_scenario(Scenario("", system, BallState(), np.array([0.0, 1.0])))
    assert str(caught.value) == sentence


def test_reduced_state_has_no_place_in_a_file():
    system = Ball(mass=1.0, inertia=(1.0, 1.0, 1.0))
    with pytest.raises(ScenarioError, match=r"^Key `initial` must be a BallState or a DiskState .* a ReducedState\.$"):
        write_initial(system, ReducedState())
