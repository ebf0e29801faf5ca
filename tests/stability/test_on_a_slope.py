"""Equilibria on a slope, of a body whose centre of mass is not its geometric centre, and of a pendulum in it."""

import numpy as np
import pytest

import jaxball
from jaxball.analysis.stability import steady_motion

ANGLE, EXCENTRIC, INERTIA = 0.1, 0.4, 0.5


def rest_angle():
    """The turn ψ, downhill, at which c sin(ψ + a) = r sin a, so that the centre of mass is plumb over the contact."""
    return np.arcsin(np.sin(ANGLE) / EXCENTRIC) - ANGLE


def squared_frequency():
    """V″/J with V = −M g (r ψ sin a + c cos(ψ + a)) and J about the contact point."""
    psi = rest_angle()
    J = INERTIA + EXCENTRIC**2 + 1 - 2 * EXCENTRIC * np.cos(psi)
    return EXCENTRIC * np.cos(psi + ANGLE) / J


def test_a_disk_rocks_about_its_rest():
    disk = jaxball.Disk(mass=1.0, inertia=INERTIA, offset=(0.0, 0.0, -EXCENTRIC), ground=jaxball.Ground(ANGLE))
    motion = steady_motion(disk, jaxball.DiskState(phi=-rest_angle()))
    assert motion.ok
    assert motion.kind == "centre"
    np.testing.assert_allclose(np.max(motion.eigenvalues.imag) ** 2, squared_frequency(), rtol=1e-12)


@pytest.mark.thorough
@pytest.mark.parametrize("resistance", [None, jaxball.Resistance(rolling=0.1, spinning=0.1)], ids=["free", "slowed"])
def test_a_ball_rocks_about_its_rest(resistance):
    shell = {"mass": 1.0, "inertia": (0.6, INERTIA, 0.7), "offset": (0.0, 0.0, -EXCENTRIC), "resistance": resistance}
    ball = jaxball.Ball(**shell, ground=jaxball.Ground(ANGLE))
    half = rest_angle() / 2
    motion = steady_motion(ball, jaxball.BallState(q=(np.cos(half), 0.0, np.sin(half), 0.0)))
    assert motion.ok
    assert motion.stable
    # λ² + c_r λ / J + ω² = 0, whose product is ω² with and without resistance.
    sizes = np.abs(motion.eigenvalues) ** 2
    assert np.min(np.abs(sizes - squared_frequency())) < 1e-10
    assert (resistance is None) == (motion.kind == "centre")
