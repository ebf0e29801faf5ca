"""The end of a slip that turns, with its first and second derivatives, against a closed form and a model in SciPy.

A solid ball on a slope slips with v̇_s = g′ − c σ, where g′ = g sin α goes downhill and c = 7/2 μ g cos α. So
v_s·(c σ + g′) falls at the rate c² − g′², and the slip ends at (c |v_s| + g′·v_s) / (c² − g′²).

The model of an eccentric ball follows Newton and Euler in space axes, in the time τ with dt = |v_s| dτ, in which
nothing is singular: its slip is given by its logarithm and its direction. Its derivatives are differences of the eighth
order.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import jaxball
from jaxball import Ball, BallState, Contact, Ground
from jaxball.physics import ReleasedState

INERTIA, OFFSET, SOLID = (0.4, 0.45, 0.5), (0.1, 0.05, -0.2), (0.4,) * 3
CENTRED = (0.0,) * 3
# The velocity of the centre along both axes, the coefficient, g, and the rotation.
START = np.array([1.0, 0.7, 0.25, 9.81, 0.5, -0.4, 0.8])
ONE, OTHER = np.array([1.0, -0.6, 0.2, -1.1, 0.3, 0.5, -1.0]), np.array([0.4, 1.0, -0.15, 0.7, -0.7, 0.4, 1.2])
E3 = np.array([0.0, 0.0, 1.0])
FALLEN = -32.0  # the logarithm of the speed at which the model counts as stopped
STEP = 4e-3
# The weights of differences of the eighth order, for the first and the second derivative, of both sides.
SLOPE, BEND = (0, 4 / 5, -1 / 5, 4 / 105, -1 / 280), (-205 / 144, 8 / 5, -1 / 5, 8 / 315, -1 / 560)


def stop_by_model(p, alpha):
    """When a slip ends, and where the ball is then, and how it turns, in body axes."""
    mu, g, Omega = p[2], p[3], p[4:]
    gravity = g * np.array([np.sin(alpha), 0.0, -np.cos(alpha)])

    def field(_, y):
        q, omega, phi, speed = y[:4], y[4:7], y[9], np.exp(y[10])
        turn = Rotation.from_quat(q, scalar_first=True).as_matrix()
        arm, inertia = turn @ OFFSET, turn @ np.diag(INERTIA) @ turn.T
        sigma, across = np.array([np.cos(phi), np.sin(phi)]), np.array([-np.sin(phi), np.cos(phi)])
        # Accelerations without the ground's force, and by N = 1 with its friction.
        force = np.array([*(-mu * sigma), 1.0])
        free, by_force = (
            np.linalg.solve(inertia, torque)
            for torque in (-np.cross(omega, inertia @ omega), np.cross(-E3 - arm, force))
        )
        falls = gravity - np.cross(free, arm) - np.cross(omega, np.cross(omega, arm))
        pushed = force - np.cross(by_force, arm)
        normal = -falls[2] / pushed[2]
        turned, moved = free + normal * by_force, falls + normal * pushed
        slips = moved[:2] + np.array([-turned[1], turned[0]])
        centre = speed * sigma + np.array([omega[1], -omega[0]])
        rate = 0.5 * np.array([-omega @ q[1:], *(q[0] * omega + np.cross(omega, q[1:]))])
        return np.concatenate([speed * np.concatenate([rate, turned, centre]), [slips @ across, slips @ sigma, speed]])

    slip = np.array([p[0] - Omega[1], p[1] + Omega[0]])
    y = [1.0, 0.0, 0.0, 0.0, *Omega, 0.0, 0.0, np.arctan2(slip[1], slip[0]), 0.5 * np.log(slip @ slip), 0.0]

    def fallen(_, y):
        return y[10] - FALLEN

    fallen.terminal = True  # pyright: ignore[reportFunctionMemberAccess]
    y = solve_ivp(field, [0.0, 200.0], y, method="DOP853", rtol=1e-13, atol=1e-15, events=fallen).y[:, -1]
    # From here on it slows down uniformly.
    time = y[11] - np.exp(y[10]) / field(0.0, y)[10]
    return np.array([time, *y[7:9], *Rotation.from_quat(y[:4], scalar_first=True).inv().apply(y[4:7])])


def derivatives_by_model(alpha):
    """Its results, and their derivatives along ``ONE``, and along ``ONE`` and ``OTHER``."""

    def along(direction, weights, sign):
        sides = ([stop_by_model(START + side * k * STEP * direction, alpha) for k in range(5)] for side in (1, -1))
        return sum(weight * (above + sign * below) for weight, above, below in zip(weights, *sides, strict=True))

    slope = along(ONE, SLOPE, -1) / STEP
    bends = [along(ONE + sign * OTHER, BEND, 1) / STEP**2 for sign in (1, -1)]
    return np.stack([stop_by_model(START, alpha), slope, (bends[0] - bends[1]) / 4])


def stop_in_closed_form(p, alpha):
    """When the slip of a solid ball ends."""
    down, braking = p[3] * jnp.sin(alpha), 3.5 * p[2] * p[3] * jnp.cos(alpha)
    slip = jnp.stack([p[0] - p[5], p[1] + p[4]])
    return (braking * jnp.sqrt(jnp.sum(slip**2)) + down * slip[0]) / (braking**2 - down**2)


def both_derivatives(function):
    """The value of a function at ``START``, and its derivatives along ``ONE``, and along ``ONE`` and ``OTHER``."""
    start, one, other = map(jnp.asarray, (START, ONE, OTHER))
    both, (_, second) = jax.jvp(lambda p: jax.jvp(function, (p,), (one,)), (start,), (other,))
    return jnp.stack([*both, second])


@jaxball.jit
def stop(inertia, offset, alpha, tolerance):
    """The results of jaxball, those of the model, with the same derivatives."""

    def run(p):
        ball = Ball(mass=1.0, inertia=inertia, offset=offset, gravity=p[3], ground=Ground(alpha))
        start = ReleasedState(BallState(Omega=p[4:]), jnp.stack([p[0], p[1], 0 * p[0]]))
        contact = Contact(p[2])
        history = jaxball.simulate(ball, [0.0, 1.0], start, contact=contact, rtol=tolerance, atol=tolerance).contact
        assert history is not None
        switches, body = history.switches, history.switches.after.body
        return jnp.concatenate([switches.times[:1], body.z[0], body.Omega[0]])

    return both_derivatives(run)


# On the first, the slip turns slowly until its very end, which is the harder for second derivatives.
SLOPES = (0.02, 0.15)
# Errors of the values, of first and of second derivatives, of up to 1.5.
TOLERANCES = {1e-7: (1e-9, 1e-8, 1e-4), 1e-10: (1e-11, 1e-10, 3e-7), 1e-12: (2e-12, 2e-11, 3e-7)}


@pytest.mark.slow
@pytest.mark.parametrize("alpha", SLOPES)
def test_an_eccentric_ball_stops_as_the_model_does(alpha):
    expected = derivatives_by_model(alpha)
    for tolerance, bounds in TOLERANCES.items():
        found = stop(*map(jnp.asarray, (INERTIA, OFFSET, alpha, tolerance)))
        assert np.all(np.max(np.abs(found - expected), axis=1) < bounds)


@pytest.mark.slow
@pytest.mark.parametrize("alpha", SLOPES)
def test_a_solid_ball_stops_as_the_closed_form_says(alpha):
    expected = both_derivatives(lambda p: stop_in_closed_form(p, alpha))
    for tolerance, bounds in TOLERANCES.items():
        found = stop(*map(jnp.asarray, (SOLID, CENTRED, alpha, tolerance)))[:, 0]
        assert np.all(np.abs(found - expected) < bounds)
