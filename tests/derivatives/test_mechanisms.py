"""Derivatives of where a robot with mechanisms comes to, against differences of tightly converged runs.

One robot has a pendulum whose motor and spring drive it, a prescribed slider and a rotor; it rolls on a tilted ground
with resistance. Torques jump at times of their own, and so does the prescribed acceleration. A difference over four
points with step h errs by h⁴ times a fifth derivative and by rounding over h: some 1e-10 at h = 1e-3.
"""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

import jaxball

TIMES = np.array([0.0, 2.0])
H = 1e-3
BOUND = 1e-8

PARAMETERS = {
    "mass": 0.5,
    "length": 0.6,
    "pivot": (0.1, 0.05, 0.1),
    "stiffness": 0.7,
    "damping": 0.1,
    "torque": (0.3, -0.4),
    "torque_times": (0.3, 0.9, 1.6),
    "spin_up": (0.2,),
    "spin_up_times": (0.5, 1.2),
    "acceleration": ((0.8,), (-1.0,), (0.5,)),
    "acceleration_times": (0.2, 0.7, 1.1, 1.5),
    "rolling": 0.1,
    "angle": 0.2,
    "theta": 0.4,
    "thetadot": -0.5,
    "Omega": (0.3, -0.2, 0.5),
}
NUMBERS, unpack = ravel_pytree({name: jnp.asarray(values, float) for name, values in PARAMETERS.items()})


def end(x, tolerance, adjoint, dry=None):
    """The state at the end, as one vector."""
    p = unpack(x)
    drive = jaxball.Motor(jaxball.PiecewiseSignal(p["torque_times"], p["torque"]))
    pendulum = jaxball.planar_pendulum(
        p["mass"],
        p["length"],
        pivot=p["pivot"],
        drive=drive + jaxball.Spring(p["stiffness"], rest=0.1) + jaxball.Damper(p["damping"]),
    )
    moved = jaxball.PiecewiseAcceleration(0.1, p["acceleration_times"], p["acceleration"])
    slider = jaxball.mass_in_tube(0.4, (1.0, 0.5, 0.2), centre=(0.0, 0.1, 0.2), drive=moved)
    motor = jaxball.Motor(jaxball.PiecewiseSignal(p["spin_up_times"], p["spin_up"]))
    rotor = jaxball.ring_rotor(0.3, 0.4, axis=(0.0, 0.3, 1.0), drive=motor)
    ball = jaxball.Ball(
        mass=1.3,
        inertia=(0.5, 0.6, 0.7),
        offset=(0.1, -0.05, 0.15),
        gravity=2.0,
        mechanisms=[pendulum, slider, rotor],
        ground=jaxball.Ground(angle=p["angle"], heading=0.3),
        resistance=jaxball.Resistance(rolling=p["rolling"], dry=dry, smoothing=0.3),
    )
    state = jaxball.BallState(
        Omega=p["Omega"],
        theta=jnp.stack([p["theta"], jnp.zeros(())]),
        thetadot=jnp.stack([p["thetadot"], jnp.ones(())]),
    )
    solved = jaxball.simulate(ball, TIMES, state, rtol=tolerance, atol=tolerance, adjoint=adjoint)
    return ravel_pytree(jax.tree.map(lambda leaf: leaf[-1], solved.state))[0]


WEIGHTS = jnp.asarray(np.random.default_rng(61).normal(size=13))


@eqx.filter_jit
def forward(x, dry):
    return jax.jacfwd(lambda x: end(x, 1e-12, diffrax.ForwardMode(), dry))(x)


@eqx.filter_jit
def reverse(x, dry):
    return jax.grad(lambda x: jnp.dot(WEIGHTS, end(x, 1e-12, None, dry)))(x)


@eqx.filter_jit
def differences(x, dry):
    """The Jacobian by the five-point formula, all runs in one batch."""
    shifted = x[None, None] + jnp.asarray([-2.0, -1.0, 1.0, 2.0])[:, None, None] * H * jnp.eye(x.size)[None]
    runs = jax.vmap(jax.vmap(lambda x: end(x, 1e-13, diffrax.ForwardMode(), dry)))(shifted)
    return jnp.tensordot(jnp.asarray([1.0, -8.0, 8.0, -1.0]) / (12 * H), runs, axes=1).T


def worst(found, expected):
    """The largest difference for each named parameter, over the largest derivative with respect to it."""
    found, expected = np.atleast_2d(np.asarray(found)), np.atleast_2d(np.asarray(expected))
    sizes = unpack(jnp.asarray(np.max(np.abs(expected), axis=0)))
    errors = unpack(jnp.asarray(np.max(np.abs(found - expected), axis=0)))
    return {name: float(jnp.max(errors[name]) / jnp.max(sizes[name])) for name in errors}


@pytest.fixture(scope="module", params=[None, pytest.param(0.1, marks=pytest.mark.slow)], ids=["viscous", "dry"])
def truth(request):
    """The coefficient of dry friction, and the Jacobian by differences."""
    dry = None if request.param is None else jnp.asarray(request.param)
    return dry, np.asarray(differences(NUMBERS, dry))


def test_forward_mode(truth):
    dry, expected = truth
    errors = worst(forward(NUMBERS, dry), expected)
    assert max(errors.values()) < BOUND, errors


def test_reverse_mode(truth):
    dry, expected = truth
    errors = worst(reverse(NUMBERS, dry), np.asarray(WEIGHTS) @ expected)
    assert max(errors.values()) < BOUND, errors


def test_every_number_matters(truth):
    """A derivative of zero would pass unseen if the truth were zero."""
    sizes = unpack(jnp.asarray(np.max(np.abs(truth[1]), axis=0)))
    assert min(float(jnp.min(size)) for size in sizes.values()) > 0.001, sizes
