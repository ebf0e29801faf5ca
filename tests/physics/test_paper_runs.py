"""Both runs of the paper at every saved time against reference solutions of 30 digits.

The bounds are what the tolerances of the paper allow: 1e-11 for the disk at 1e-12, and 1e-8 for the
ball at 1e-10, because sensitivities to the initial state reach about 30.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from tests.conftest import SECONDS
from tests.support.paper import BALL_ANGLES, paper_ball, paper_disk, reference

GRID = np.linspace(0.0, 20.0, 4001)


def packed(state):
    """θ, θ̇ (where they are in the state), then the rest, as the columns of the reference."""
    if isinstance(state, jaxball.DiskState):
        columns = [state.theta, state.thetadot, state.phi[:, None], state.phidot[:, None]]
    else:
        columns = [state.theta, state.thetadot, state.q, state.Omega, state.z]
    return np.concatenate(columns, axis=1)


@pytest.fixture(scope="module")
def dense_ball():
    return jaxball.simulate(paper_ball(), GRID, rtol=1e-11, atol=1e-11).raise_if_failed()


@pytest.fixture(scope="module")
def dense_disk():
    return jaxball.simulate(paper_disk(), GRID, rtol=1e-11, atol=1e-11).raise_if_failed()


def peak(values):
    """The largest of ``values`` and its time, from the parabola through three points of the grid."""
    k = int(np.argmax(values))
    a, b, c = values[k - 1 : k + 2]
    shift = 0.5 * (a - c) / (a - 2 * b + c)
    return b - 0.25 * (a - c) * shift, GRID[k] + shift * (GRID[1] - GRID[0])


def test_the_ball_is_the_papers_ball(ball_trajectory):
    expected, _ = reference("paper_ball")
    found = packed(ball_trajectory.state)
    assert np.max(np.abs(found - expected[:, 6:])) <= 1e-8


@pytest.mark.thorough
def test_the_disk_is_the_papers_disk(disk_trajectory):
    expected, _ = reference("paper_disk")
    found = packed(disk_trajectory.state)
    assert np.max(np.abs(found - expected[:, 8:])) <= 1e-11
    np.testing.assert_allclose(disk_trajectory.state.z, -expected[:, 8], atol=1e-11)


@pytest.mark.long
def test_integrated_angles_give_the_same_run():
    """The paper's own form of the ball, in which θ and θ̇ belong to the state."""
    system, angles = paper_ball().with_integrated_angles()
    start = jaxball.BallState(**angles)
    trajectory = jaxball.simulate(system, SECONDS, start, rtol=1e-10, atol=1e-10, step_to_times=True)
    expected, names = reference("paper_ball")
    assert names[: system.n_masses] == [f"theta[{i}]" for i in range(system.n_masses)]
    assert np.max(np.abs(packed(trajectory.state) - expected)) <= 1e-8


@pytest.mark.parametrize("name", ["paper_ball", "paper_disk"])
def test_prescribed_angles_are_the_references(name):
    expected, _ = reference(name)
    system = {"paper_ball": paper_ball, "paper_disk": paper_disk}[name]()
    n = system.n_masses
    rates = jax.jit(jax.vmap(lambda t: [item.motion.schedule.derivatives(t) for item in system.point_masses]))
    for k, (theta, thetadot, _) in enumerate(rates(jnp.asarray(SECONDS))):
        np.testing.assert_allclose(theta, expected[:, k], rtol=1e-14, atol=1e-14)
        np.testing.assert_allclose(thetadot, expected[:, n + k], rtol=1e-13, atol=1e-15)


def test_the_ball_starts_with_its_centre_of_mass_above_its_centre(ball_trajectory):
    """The orientation of the rails, which the paper does not write out, is right if this holds."""
    seen = ball_trajectory.observables
    np.testing.assert_allclose(4 * seen.centre_of_mass_body[0], (2.6e-5, -7.9e-6, 0.683213), atol=5e-7)
    assert BALL_ANGLES[1:] == (2.0369, 0.7044)


def test_contact_force_and_energy_of_the_ball(dense_ball):
    """The extrema are known to about 1e-6."""
    seen = dense_ball.observables
    N, friction = np.asarray(seen.normal_force), np.hypot(*np.asarray(seen.friction).T)
    ratio = np.asarray(seen.friction_ratio)
    np.testing.assert_allclose([-peak(-N)[0], peak(N)[0]], [3.517427, 6.167842], atol=2e-6)
    np.testing.assert_allclose(peak(friction)[0], 0.673844, atol=2e-6)
    np.testing.assert_allclose(peak(ratio)[0], 0.190594, atol=2e-6)
    np.testing.assert_allclose(peak(ratio)[1], 6.438, atol=1e-3)
    np.testing.assert_allclose(dense_ball.friction_needed, ratio.max(), rtol=1e-12)
    E = np.asarray(seen.energy)
    np.testing.assert_allclose(E[[0, 40, 4000]], [0.68321332, 0.71561008, 0.25880087], atol=1e-8)


def test_contact_force_of_the_disk(dense_disk):
    seen = dense_disk.observables
    N, ratio = np.asarray(seen.normal_force), np.asarray(seen.friction_ratio)
    np.testing.assert_allclose([-peak(-N)[0], peak(N)[0]], [4.40228, 5.86713], atol=1e-5)
    np.testing.assert_allclose(peak(ratio)[0], 0.295097, atol=2e-6)
    np.testing.assert_allclose(peak(ratio)[1], 19.397, atol=1e-3)


@pytest.mark.parametrize("name", ["dense_ball", "dense_disk"])
def test_the_energy_gained_is_the_work_done(name, request):
    """Simpson's rule over the power, piece by piece between the kinks; its error is about h⁴ = 6e-10."""
    seen = request.getfixturevalue(name).observables
    power, energy = np.asarray(seen.power), np.asarray(seen.energy)
    for first, last in ((0, 20), (20, 40), (40, 4000)):
        # At a kink the power is that of the later side, so each piece's own ends are left out.
        piece = slice(first + 2, last - 1) if last < 4000 else slice(first + 2, last + 1)
        p, E = power[piece], energy[piece]
        n = (len(p) - 1) // 2 * 2
        weights = np.ones(n + 1)
        weights[1:-1:2], weights[2:-1:2] = 4, 2
        work = weights @ p[: n + 1] * 0.005 / 3
        np.testing.assert_allclose(work, E[n] - E[0], atol=1e-8)


def test_the_versor_keeps_its_length(ball_trajectory):
    q = np.asarray(ball_trajectory.state.q)
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1, atol=1e-9)


def test_the_disks_path_follows_its_angle(disk_trajectory):
    """``eq_disk_GC``: z = −r φ from rest at the origin."""
    np.testing.assert_allclose(disk_trajectory.state.z, -disk_trajectory.state.phi, atol=1e-14)
