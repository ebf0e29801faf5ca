"""Derivatives of where a robot with mechanisms comes to, against differences of tightly converged runs.

One robot has a pendulum on two hinges, with motors, a spring and a damper, which hangs from a prescribed slider. It
rolls on a tilted ground with resistance. At some times both torques and the prescribed acceleration jump together; with
dry friction, which feels all of them through the normal force, each jumps at times of its own. A
difference over four points with step h errs by h⁴ times a fifth derivative and by rounding over h: some 1e-9 at most
of the largest derivative, at h = 1e-3.
"""

import functools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

import jaxball
from tests.support.differences import jacobian

TIMES = np.array([0.0, 2.0])
H = 1e-3
BOUND = 1e-8

PARAMETERS = {
    "mass": 0.5,
    "length": 0.6,
    "pivot": (0.1, 0.05, 0.1),
    "stiffness": 0.7,
    "damping": 0.1,
    "inner_torque": (0.3, -0.4),
    "inner_times": (0.3, 0.7, 1.6),
    "outer_torque": (0.2,),
    "outer_times": (0.7, 1.1),
    "acceleration": ((0.8,), (-1.0,), (0.5,)),
    "acceleration_times": (0.2, 0.7, 1.1, 1.5),
    "rolling": 0.1,
    "angle": 0.2,
    "theta": (0.4, 0.2),
    "thetadot": (-0.5, 0.3),
    "Omega": (0.3, -0.2, 0.5),
}
APART = {"inner_times": (0.3, 0.9, 1.6), "outer_times": (0.5, 1.2)}
NUMBERS, unpack = ravel_pytree({name: jnp.asarray(values, float) for name, values in PARAMETERS.items()})


def numbers(dry):
    if dry is None:
        return NUMBERS
    return ravel_pytree({name: jnp.asarray(values, float) for name, values in (PARAMETERS | APART).items()})[0]


def end(x, tolerance, adjoint, dry=None):
    """The state at the end, as one vector."""
    p = unpack(x)
    moved = jaxball.PiecewiseAcceleration(0.1, p["acceleration_times"], p["acceleration"])
    motors = [
        jaxball.Motor(jaxball.PiecewiseSignal(p[f"{name}_times"], p[f"{name}_torque"])) for name in ("inner", "outer")
    ]
    bob = p["pivot"] - jnp.stack([jnp.zeros(()), jnp.zeros(()), p["length"]])
    robot = jaxball.Mechanism(
        [
            jaxball.Slider((1.0, 0.5, 0.2), moved),
            jaxball.Hinge((0.0, 1.0, 0.0), p["pivot"], motors[0] + jaxball.Spring(p["stiffness"], rest=0.1)),
            jaxball.Hinge((1.0, 0.0, 0.3), p["pivot"], motors[1] + jaxball.Damper(p["damping"])),
        ],
        [jaxball.CarriedMass(0.4, (0.0, 0.1, 0.2), 0), jaxball.CarriedMass(p["mass"], bob, 2)],
    )
    ball = jaxball.Ball(
        mass=1.3,
        inertia=(0.5, 0.6, 0.7),
        offset=(0.1, -0.05, 0.15),
        gravity=2.0,
        mechanisms=[robot],
        ground=jaxball.Ground(angle=p["angle"], heading=0.3),
        resistance=jaxball.Resistance(rolling=p["rolling"], dry=dry, smoothing=0.3),
    )
    state = jaxball.BallState(Omega=p["Omega"], theta=p["theta"], thetadot=p["thetadot"])
    solved = jaxball.simulate(ball, TIMES, state, rtol=tolerance, atol=tolerance, adjoint=adjoint)
    return ravel_pytree(jax.tree.map(lambda leaf: leaf[-1], solved.state))[0]


WEIGHTS = jnp.asarray(np.random.default_rng(61).normal(size=13))


@jaxball.jit
def alone(x, dry):
    return end(x, 1e-13, diffrax.ForwardMode(), dry)


@jaxball.jit
def tangent(x, direction, dry):
    return jax.jvp(lambda x: end(x, 1e-12, diffrax.ForwardMode(), dry), (x,), (direction,))[1]


@jaxball.jit
def reverse(x, dry):
    return jax.grad(lambda x: jnp.dot(WEIGHTS, end(x, 1e-12, None, dry)))(x)


@functools.cache
def differences(dry):
    """The Jacobian by the five-point formula."""

    return jacobian(lambda x: alone(x, dry), numbers(dry), H)


def worst(found, expected):
    """The largest difference for each named parameter, over the largest derivative with respect to it."""
    found, expected = np.atleast_2d(found), np.atleast_2d(expected)
    sizes = unpack(jnp.asarray(np.max(np.abs(expected), axis=0)))
    errors = unpack(jnp.asarray(np.max(np.abs(found - expected), axis=0)))
    return {name: float(jnp.max(errors[name]) / jnp.max(sizes[name])) for name in errors}


@pytest.mark.parametrize("dry", [None, pytest.param(0.1, marks=pytest.mark.slow)], ids=["viscous", "dry"])
class TestAgainstDifferences:
    """Of a robot that viscous friction slows, and of one that dry friction slows as well."""

    @pytest.mark.long
    def test_every_number_matters(self, dry):
        """A derivative of zero would pass unseen if the truth were zero."""
        sizes = unpack(jnp.asarray(np.max(np.abs(differences(dry)), axis=0)))
        assert min(float(jnp.min(size)) for size in sizes.values()) > 0.001, sizes

    @pytest.mark.long
    def test_forward_mode(self, dry):
        columns = [tangent(numbers(dry), direction, dry) for direction in jnp.eye(NUMBERS.size)]
        errors = worst(np.stack(columns, axis=1), differences(dry))
        assert max(errors.values()) < BOUND, errors

    @pytest.mark.long
    def test_reverse_mode(self, dry):
        errors = worst(reverse(numbers(dry), dry), np.asarray(WEIGHTS) @ differences(dry))
        assert max(errors.values()) < BOUND, errors
