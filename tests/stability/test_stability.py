"""Steady motions and their stability against closed forms, and against runs."""

import numpy as np
import pytest

import jaxball
from jaxball.analysis.stability import permanent_rotations, steady_motion, steady_rolling
from tests.support.sentences import refuses, said

D, M, R, G, LOW = np.array([0.5, 0.65, 0.7]), 1.3, 1.2, 9.8, 0.3


def ball(height, d=D):
    return jaxball.Ball(mass=M, inertia=d, radius=R, gravity=G, offset=(0.0, 0.0, height))


def test_rest_below_rocks_at_its_frequencies():
    """ω² = M g a / (d_j + M (r − a)²) about both axes, and a zero for the spin about the vertical."""
    omega = np.sqrt(M * G * LOW / (D[:2] + M * (R - LOW) ** 2))
    found = steady_motion(ball(-LOW), jaxball.BallState())
    assert found.ok
    assert found.stable
    assert found.kind == "centre"
    np.testing.assert_allclose(np.sort(found.eigenvalues.imag), np.sort([*omega, 0, *-omega]), atol=1e-12)
    np.testing.assert_allclose(found.eigenvalues.real, 0, atol=1e-12)
    said(found.message)


def test_rest_above_falls():
    rate = np.sqrt(M * G * LOW / (D[:2] + M * (R + LOW) ** 2))
    found = steady_motion(ball(LOW), jaxball.BallState())
    np.testing.assert_allclose(np.sort(found.eigenvalues.real), np.sort([*rate, 0, *-rate]), atol=1e-12)
    assert found.kind == "saddle"
    assert not found.stable
    assert found.growth == pytest.approx(max(rate), rel=1e-12)
    said(found.message)


def test_a_state_that_is_not_steady_says_so():
    found = steady_motion(ball(-LOW), jaxball.physics.ReducedState(Omega=[0.0, 0.0, 0.0], Gamma=[0.6, 0.0, 0.8]))
    assert not found.ok
    assert "not steady" in found.message


@pytest.mark.parametrize(("ratio", "stable"), [(0.999, False), (1.001, True)])
def test_vertical_spin_is_stable_above_its_threshold(ratio, stable):
    """|Ω3| > 2 √( [d1 + M (r + ℓ)²] M g ℓ ) / ( d3 + M r (r + ℓ) )."""
    d1, d3 = 0.5, 0.7
    threshold = 2 * np.sqrt((d1 + M * (R + LOW) ** 2) * M * G * LOW) / (d3 + M * R * (R + LOW))
    spin = jaxball.physics.ReducedState(Omega=[0.0, 0.0, ratio * threshold], Gamma=[0.0, 0.0, 1.0])
    found = steady_motion(ball(LOW, (d1, d1, d3)), spin)
    assert found.ok
    assert found.stable == stable


@pytest.fixture(scope="module")
def lopsided():
    """Three unequal moments and a centre of mass on no axis."""
    return jaxball.Ball(mass=1.0, inertia=(0.3, 0.45, 0.6), offset=(0.12, 0.2, 0.1))


@pytest.mark.thorough
def test_equilibria_are_two_and_known(lopsided):
    """Γ = ∓χ/|χ|: a stable one below and an unstable one above."""
    below, above = permanent_rotations(lopsided)
    up = np.array([0.12, 0.2, 0.1]) / np.linalg.norm([0.12, 0.2, 0.1])
    np.testing.assert_allclose(below.state.Gamma, -up, atol=1e-10)
    np.testing.assert_allclose(above.state.Gamma, up, atol=1e-10)
    assert (below.kind, above.kind) == ("centre", "saddle")


@pytest.mark.parametrize("rate", [1.0, 4.0])
def test_permanent_rotations_obey_their_equation(lopsided, rate):
    """ω² JΓ − (g + r ω²) p is along Γ, with J about the geometric centre.

    These are the critical points of a function on the sphere, so that their number is even.
    """
    found = permanent_rotations(lopsided, rate)
    chi = np.asarray(lopsided.offset)
    J = np.diag(lopsided.inertia) + np.eye(3) * (chi @ chi) - np.outer(chi, chi)
    for motion in found:
        Gamma = np.asarray(motion.state.Gamma)
        load = rate**2 * J @ Gamma - (1.0 + rate**2) * chi
        np.testing.assert_allclose(np.cross(load, Gamma), 0, atol=1e-8)
    assert len(found) >= 2
    assert len(found) % 2 == 0


def routh():
    masses = [jaxball.PointMass(m, jaxball.Fixed([0.0, 0.0, h])) for m, h in ((0.5, 0.6), (0.3, -0.2))]
    return jaxball.Ball(mass=1.0, inertia=(0.5, 0.5, 0.7), offset=(0.0, 0.0, -0.15), gravity=2.0, masses=masses)


@pytest.mark.thorough
@pytest.mark.parametrize(("inclination", "precession"), [(0.4, 1.3), (2.2, -0.8), (1.2, 0.3)])
def test_routh_spheres_roll_steadily(inclination, precession):
    """The state is steady in the equations of motion, which know nothing of the balance that gave the spin."""
    found = steady_rolling(routh(), inclination, precession)
    assert found.ok, found.message
    assert found.residual < 1e-13
    assert abs(found.turning) > 0.01


@pytest.mark.thorough
def test_a_routh_sphere_rolls_in_a_circle():
    """A run keeps the inclination, and the geometric centre stays on a circle of radius r |σ sin ϑ / P|."""
    inclination, precession = 0.4, 1.3
    found = steady_rolling(routh(), inclination, precession)
    half = inclination / 2
    start = jaxball.BallState(q=[np.cos(half), 0.0, -np.sin(half), 0.0], Omega=found.state.Omega)
    np.testing.assert_allclose(start.Gamma, found.state.Gamma, atol=1e-15)
    run = jaxball.simulate(routh(), np.linspace(0.0, 2 * np.pi / precession, 41), start, rtol=1e-11, atol=1e-11)
    z = np.asarray(run.state.z)
    circle = z[:-1] - z[:-1].mean(axis=0)
    radius = abs(found.turning * np.sin(inclination) / precession)
    assert found.stable
    np.testing.assert_allclose(np.linalg.norm(circle, axis=1), radius, atol=1e-8)
    np.testing.assert_allclose(z[-1], z[0], atol=1e-8)


def test_a_disk_rocks():
    disk = jaxball.Disk(mass=M, inertia=D[1], radius=R, gravity=G, offset=(0.0, 0.0, -LOW))
    found = steady_motion(disk, jaxball.DiskState())
    omega = np.sqrt(M * G * LOW / (D[1] + M * (R - LOW) ** 2))
    np.testing.assert_allclose(np.sort(found.eigenvalues.imag), [-omega, 0, omega], atol=1e-12)
    assert found.kind == "centre"


def test_wrong_arguments(lopsided):
    force = jaxball.physics.HarmonicForce(np.zeros(3), np.ones((1, 3)), [1.0], [0.0])
    pushed = jaxball.Ball(mass=1.0, inertia=D, force=force)
    with refuses(ValueError, "system"):
        steady_motion(pushed, jaxball.physics.ReducedState())
    with refuses(ValueError, "ball"):
        permanent_rotations(pushed)
    with refuses(ValueError, "ball"):
        steady_rolling(lopsided, 0.3, 1.0)
    with refuses(ValueError, "precession"):
        steady_rolling(routh(), 0.3, 0.0)
    with refuses(ValueError, "guess"):
        permanent_rotations(lopsided, guess=[1.0, 0.0])
    with refuses(TypeError, "state"):
        steady_motion(lopsided, jaxball.DiskState())
