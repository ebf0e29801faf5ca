"""Lyapunov exponents of own systems with constraints, of which only the directions that these admit are counted."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.analysis.chaos import lyapunov_spectrum
from jaxball.physics.classical import LagrangianState, LagrangianSystem
from tests.support.sentences import refuses

M, I, AHEAD, SPEED = 1.3, 0.4, 0.5, 0.8
G, L = 9.81, 1.7


def sleigh():
    """Chaplygin's, with its blade at (x, y) along θ, and its centre of mass ahead of it."""

    def lagrangian(t, q, qdot):
        forward = jnp.stack([jnp.cos(q[2]), jnp.sin(q[2])])
        across = jnp.stack([-jnp.sin(q[2]), jnp.cos(q[2])])
        centre = jnp.sum(qdot[:2] * forward) * forward + (jnp.sum(qdot[:2] * across) + AHEAD * qdot[2]) * across
        return 0.5 * M * jnp.sum(centre**2) + 0.5 * I * qdot[2] ** 2

    def blade(t, q, qdot):
        return qdot[1] * jnp.cos(q[2]) - qdot[0] * jnp.sin(q[2])

    return LagrangianSystem(lagrangian, ("x", "y", "theta"), constraints=blade)


@pytest.mark.thorough
def test_chaplygins_sleigh_that_goes_straight():
    """ω decays at κ = m a V/(I + m a²); x, y, θ and the speed are neutral, y growing with θ as a power of time."""
    heading = 0.3
    straight = SPEED * np.array([np.cos(heading), np.sin(heading), 0.0])
    state = LagrangianState(q=(0.0, 0.0, heading), qdot=straight)
    spectrum = lyapunov_spectrum(sleigh(), (0.0, 120.0), state, transient=60.0)
    kappa = M * AHEAD * SPEED / (I + M * AHEAD**2)
    assert spectrum.exponents.shape == (5,)
    np.testing.assert_allclose(spectrum.exponents[-1], -kappa, atol=2e-4)
    np.testing.assert_allclose(jnp.sum(spectrum.exponents), -kappa, atol=2e-4)
    np.testing.assert_allclose(spectrum.exponents[:4], 0.0, atol=0.05)
    with refuses(ValueError, "exponents"):
        lyapunov_spectrum(sleigh(), (0.0, 1.0), state, exponents=6)


@pytest.mark.thorough
def test_a_pendulum_in_cartesian_coordinates_stands_on_its_head():
    """Of four directions, a holonomic constraint leaves two, at ±√(g/L)."""

    def lagrangian(t, q, qdot):
        return 0.5 * M * jnp.sum(qdot**2) - M * G * q[1]

    def rod(t, q):
        return q[0] ** 2 + q[1] ** 2 - L**2

    pendulum = LagrangianSystem(lagrangian, ("x", "y"), holonomic=rod)
    spectrum = lyapunov_spectrum(pendulum, (0.0, 6.0), LagrangianState(q=(0.0, L)), transient=3.0, interval=0.5)
    rate = np.sqrt(G / L)
    np.testing.assert_allclose(spectrum.exponents, [rate, -rate], rtol=1e-4)
