"""Motions whose frequency, stability or speed is known in closed form."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import jaxball


@pytest.mark.thorough
@pytest.mark.parametrize("axis", [0, 1])
def test_a_ball_rocks_about_rest_at_its_frequency(axis):
    """ω² = M g a / (d_j + M (r − a)²), the centre of mass a below the centre, about axis j.

    At an amplitude of 1e-4 the frequency differs by less than 1e-8 of itself.
    """
    d, r, g, m0, m1, low = np.array([0.5, 0.65, 0.7]), 1.2, 9.8, 1.0, 0.6, 0.5
    ball = jaxball.Ball(
        mass=m0,
        inertia=d,
        radius=r,
        gravity=g,
        masses=[jaxball.PointMass(m1, jaxball.Fixed([0.0, 0.0, -low]))],
    )
    M, a = m0 + m1, m1 * low / (m0 + m1)
    moment = d[axis] + m0 * a**2 + m1 * (low - a) ** 2
    omega = np.sqrt(M * g * a / (moment + M * (r - a) ** 2))
    Omega = np.zeros(3)
    Omega[axis] = 1e-4 * omega
    times = np.linspace(0.0, 10 * 2 * np.pi / omega, 1001)
    run = jaxball.simulate(ball, times, jaxball.BallState(Omega=Omega), rtol=1e-12, atol=1e-16)
    crossings = CubicSpline(times, run.state.Omega[:, axis]).roots(extrapolate=False)
    periods = np.diff(crossings)
    assert len(crossings) == 20
    np.testing.assert_allclose(np.pi / np.mean(periods), omega, rtol=1e-7)


@pytest.mark.parametrize(("ratio", "stable"), [(0.999, False), (1.001, True)])
def test_a_top_heavy_ball_stands_if_it_spins_fast_enough(ratio, stable):
    """|Ω3| > 2 √( [d1 + M (r + ℓ)²] M g ℓ ) / ( d3 + M r (r + ℓ) ), by the linearised reduced system.

    On the stable side every growth rate is zero up to rounding; on the other it is about the square
    root of the distance from the threshold.
    """
    d1, d3, M, r, g, l = 0.5, 0.7, 1.3, 1.2, 9.8, 0.3
    ball = jaxball.Ball(mass=M, inertia=(d1, d1, d3), radius=r, gravity=g, offset=(0.0, 0.0, l))
    threshold = 2 * np.sqrt((d1 + M * (r + l) ** 2) * M * g * l) / (d3 + M * r * (r + l))

    def field(x):
        rates = jaxball.physics.vector_field(ball, jnp.asarray(0.0), jaxball.physics.ReducedState(x[:3], x[3:]))
        return jnp.concatenate([rates.Omega, rates.Gamma])

    upright = jnp.asarray([0.0, 0.0, ratio * threshold, 0.0, 0.0, 1.0])
    growth = np.linalg.eigvals(jax.jit(jax.jacfwd(field))(upright)).real.max()
    assert growth < 1e-6 if stable else growth > 1e-2


@pytest.mark.thorough
def test_a_static_disk_trades_height_for_speed():
    """φ̇² = 2 (E − V)/J(φ)."""
    m0, m1, d2, r, g = 1.0, 0.5, 0.6, 1.1, 9.8
    chi0, chi1 = np.array([0.1, 0.0, -0.05]), np.array([-0.4, 0.0, 0.6])
    disk = jaxball.Disk(
        mass=m0,
        inertia=d2,
        radius=r,
        gravity=g,
        offset=chi0,
        masses=[jaxball.PointMass(m1, jaxball.Fixed(chi1))],
    )
    times = np.linspace(0.0, 5.0, 51)
    run = jaxball.simulate(disk, times, jaxball.DiskState(0.3, 0.8), rtol=1e-12, atol=1e-12)
    phi, phidot = np.asarray(run.state.phi), np.asarray(run.state.phidot)
    s, c = np.sin(phi), np.cos(phi)
    V = g * sum(m * (chi[0] * s + chi[2] * c) for m, chi in ((m0, chi0), (m1, chi1)))
    J = d2 + sum(m * ((r * s + chi[0]) ** 2 + (r * c + chi[2]) ** 2) for m, chi in ((m0, chi0), (m1, chi1)))
    E = 0.5 * J[0] * 0.8**2 + V[0]
    np.testing.assert_allclose(phidot**2, 2 * (E - V) / J, atol=1e-9)
    assert np.ptp(phi) > 1
    np.testing.assert_allclose(run.observables.energy, E, rtol=1e-9)
