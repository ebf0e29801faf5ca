"""One rule for all functions of users: they are passed ``parameters`` if they take them."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import (
    Ball,
    BallState,
    FunctionForce,
    FunctionLaw,
    FunctionRail,
    FunctionSchedule,
    FunctionWrench,
    HeightField,
)
from jaxball.interface.arguments import takes_parameters
from jaxball.physics import FunctionJointForce, ParametricSurface, SignedDistance
from jaxball.physics.classical import LagrangianState, LagrangianSystem
from tests.support.sentences import refuses

T = jnp.array(0.5)
X = jnp.array([0.2, 0.3, 0.4])


def circle(theta):
    return jnp.stack([jnp.cos(theta), jnp.sin(theta), 0.0 * theta])


def fall(t, q, qdot):
    return 0.5 * jnp.sum(qdot**2) - 2.0 * q[0]


# Each: a maker, a function of an own number of arguments without parameters, and what the part gives.
PARTS = {
    "rail": (FunctionRail, circle, lambda rail: rail(T)),
    "schedule": (FunctionSchedule, lambda t: jnp.sin(t), lambda schedule: schedule(T)),
    "force": (FunctionForce, lambda t: jnp.stack([t, t, t]), lambda force: force(T)),
    "height field": (HeightField, lambda t, x, y: 0.1 * x * y, lambda ground: ground.point(T, X[0], X[1])),
    "surface": (
        ParametricSurface,
        lambda t, u1, u2: jnp.stack([u1, u2, 0.1 * u1 * u2]),
        lambda ground: ground.point(T, X[0], X[1]),
    ),
}


def with_parameters(function, count):
    def scaled(*arguments):
        return arguments[-1] * function(*arguments[:-1])

    return {
        1: lambda a, parameters: scaled(a, parameters),
        3: lambda a, b, c, parameters: scaled(a, b, c, parameters),
    }[count]


@pytest.mark.parametrize("name", PARTS)
def test_a_function_without_parameters_is_one_with_parameters_of_no_effect(name):
    make, function, value = PARTS[name]
    count = function.__code__.co_argcount
    np.testing.assert_array_equal(value(make(function)), value(make(with_parameters(function, count), 1.0)))


@pytest.mark.parametrize("name", PARTS)
def test_parameters_without_an_effect_are_refused(name):
    make, function, _ = PARTS[name]
    with refuses(TypeError, "function"):
        make(function, 2.0)


def test_others_take_such_functions_too():
    state = BallState()
    FunctionWrench(lambda t, motion: jnp.zeros(3))
    SignedDistance(lambda t, x, y, z: z)
    assert FunctionJointForce(lambda t, theta, thetadot, state: -theta)(T, T, T, state) == -T
    np.testing.assert_array_equal(FunctionLaw(lambda t, state: jnp.ones(1)).function(T, state), [1.0])


def test_a_run_on_a_ground_without_parameters():
    """On the level plane z = 0 as a height field, a ball rolls at its own speed."""
    level = HeightField(lambda t, x, y: 0.0 * x)
    ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), ground=level)
    run = jaxball.simulate(ball, [0.0, 1.0], BallState(Omega=(0.0, 1.0, 0.0)), throw=True)
    np.testing.assert_allclose(run.state.z[-1], [1.0, 0.0], atol=1e-9)  # of a solve to 1e-10


@pytest.mark.parametrize(
    ("lagrangian", "parameters"),
    [
        (fall, None),
        (lambda t, q, qdot, parameters: fall(t, q, qdot), None),
        (lambda t, q, qdot, parameters: parameters * fall(t, q, qdot), 3.0),
        (lambda t, q, qdot, scale=2.0: scale * fall(t, q, qdot), None),
    ],
)
def test_a_lagrangian_takes_them_or_not(lagrangian, parameters):
    system = LagrangianSystem(lagrangian, ("x",), parameters=parameters)
    np.testing.assert_allclose(system.accelerations(T, LagrangianState([1.0])), [-2.0], rtol=1e-15)


def test_some_functions_of_a_system_may_take_them():
    system = LagrangianSystem(fall, ("x",), forces=lambda t, q, qdot, drag: -drag * qdot, parameters=0.5)
    np.testing.assert_allclose(system.accelerations(T, LagrangianState([1.0], [4.0])), [-4.0], rtol=1e-15)
    with refuses(TypeError, "lagrangian"):
        LagrangianSystem(fall, ("x",), parameters=0.5)


def test_a_default_is_not_replaced_by_nothing():
    assert not takes_parameters(lambda t, scale=2.0: scale, 1, None)
    assert takes_parameters(lambda t, scale=2.0: scale, 1, 3.0)
    assert takes_parameters(lambda t, *others: others, 1, 3.0)
    assert not takes_parameters(lambda t, *others: others, 1, None)
    assert takes_parameters(lambda t, parameters: t, 1, None)
