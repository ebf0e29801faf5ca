"""Lyapunov exponents of disks with free joints: an equilibrium, the divergence of friction, chaos in symplectic pairs.

Both runs of one pendulum share a program, because their forces are of the same kinds.
"""

import numpy as np
import pytest

import jaxball
from jaxball.analysis.chaos import lyapunov_spectrum
from tests.chaos.test_exponents_of_rolling_bodies import spectrum

M0, D, M, L = 1.0, 0.5, 0.5, 0.6
I = D + (M0 + M)  # of the disk about the contact point, with the pendulum at its centre


def disk(direction, damping, torque):
    """A disk with a pendulum, whose damped hinge has a motor, at g = r = 1."""
    drive = jaxball.Motor(jaxball.Sinusoids(0.0, [torque], [1.3])) + jaxball.Damper(damping)
    pendulum = jaxball.planar_pendulum(M, L, direction=direction, drive=drive)
    return jaxball.Disk(mass=M0, inertia=D, mechanisms=[pendulum])


@pytest.mark.long
def test_a_pendulum_on_its_head_has_the_roots_of_its_equation():
    """λ² = g I / (l (I − m r²)); the rest are zeros, of which two belong to a steady roll: ±log(t₁/t₀) / (t₁ − t₀)."""
    found = spectrum(disk((0.0, 0.0, 1.0), 0.0, 0.0), 60.0, jaxball.DiskState(theta=[0.0], thetadot=[0.0]))
    rate, rolling = np.sqrt(I / (L * (I - M))), np.log(2.0) / 30.0
    np.testing.assert_allclose(found.exponents, [rate, rolling, 0.0, -rolling, -rate], atol=1e-3)
    assert found.exponents[0] == pytest.approx(rate, abs=1e-8)
    assert found.exponents[4] == pytest.approx(-rate, abs=1e-8)


@pytest.mark.long
def test_the_exponents_add_up_to_the_divergence_of_the_flow():
    """It is −tr(M⁻¹ C) = −c (I + m l² − 2 m l r cos ψ) / det M in canonical coordinates, ψ the angle of the pendulum.

    Those in which exponents are measured are others, by a factor of volume that stays within a power of det M.
    """
    c, length = 0.3, 80.0
    system, start = disk((0.0, 0.0, -1.0), c, 0.8), jaxball.DiskState(theta=[2.0], thetadot=[0.0])
    found = spectrum(system, length, start)
    times = np.linspace(length / 2, length, 1601)
    run = jaxball.simulate(system, np.concatenate([[0.0], times]), start, rtol=1e-8, atol=1e-8).raise_if_failed()
    cosine = -np.asarray(run.observables.mass_positions_space)[1:, 0, 2] / L
    divergence = -c * (I + M * L**2 - 2 * M * L * cosine) / (M * L**2 * (I - M * cosine**2))
    mean = np.trapezoid(divergence, times) / (length / 2)
    assert np.ptp(cosine) > 0.5
    assert mean < -1.0
    assert float(np.sum(found.exponents)) == pytest.approx(mean, abs=2 * np.log(I / (I - M)) / (length / 2))


@pytest.mark.slow
def test_a_disk_with_a_double_pendulum_is_chaotic_and_its_exponents_come_in_pairs():
    """Rolling disks are holonomic, so that the flow is Hamiltonian in φ and two joints; z adds a zero of its own."""
    double = jaxball.physics.double_pendulum((0.5, 0.4), (0.4, 0.4))
    start = jaxball.DiskState(theta=[2.5, 1.0], thetadot=[0.0, 0.0])
    system = jaxball.Disk(mass=4.0, inertia=2.0, mechanisms=[double])
    found = lyapunov_spectrum(system, (0.0, 300.0), start, transient=20.0).raise_if_failed()
    exponents, error = np.asarray(found.exponents), np.asarray(found.standard_error)
    assert found.least_normal_force > 0
    assert exponents[0] > 0.1
    assert exponents[0] > 5 * error[0]
    np.testing.assert_allclose(exponents + exponents[::-1], 0.0, atol=0.02)
    np.testing.assert_allclose(exponents[2:5], 0.0, atol=0.05)
