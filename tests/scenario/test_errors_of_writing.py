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
    Scenario,
    ScenarioError,
    write_scenario,
)
from jaxball.files.scenario.initial import write_initial
from jaxball.physics import ReducedState
from tests.support.sentences import refuses


def on_circle(motion):
    return [PointMass(1.0, motion)]


def nowhere(*_):
    return jnp.zeros(3)


def still(*_):
    return jnp.zeros(())


def coasting(*_):
    return jnp.zeros(1)


FUNCTIONS = {
    "masses[0].rail": {"masses": on_circle(OnRail(FunctionRail(nowhere), ConstantRate(0.0)))},
    "masses[0].schedule": {"masses": on_circle(OnRail(Circle(0.5), FunctionSchedule(still)))},
    "masses[0]": {"masses": on_circle(Free(nowhere))},
    "actuation": {"masses": on_circle(Driven(Circle(0.5))), "law": FunctionLaw(coasting)},
    "force": {"force": FunctionForce(nowhere)},
}


@pytest.mark.parametrize("key", FUNCTIONS)
def test_python_function_has_no_place_in_a_file(key):
    system = Ball(mass=1.0, inertia=(1.0, 1.0, 1.0), **FUNCTIONS[key])
    with refuses(ScenarioError, key):
        write_scenario(Scenario("", system, BallState(), np.array([0.0, 1.0])))


def test_reduced_state_has_no_place_in_a_file():
    system = Ball(mass=1.0, inertia=(1.0, 1.0, 1.0))
    with refuses(ScenarioError, "initial"):
        write_initial(system, ReducedState())
