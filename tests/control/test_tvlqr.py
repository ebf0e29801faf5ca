"""Regulators against SciPy's stationary solution, the matrix exponential, closed forms, and other recursions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

import jaxball
from jaxball.control import tvlqr
from tests.control import robots
from tests.support.differences import jacobian
from tests.support.sentences import refuses

H = 0.02
TOLERANCE = 1e-10  # of the solve of a sample


@pytest.fixture(scope="module")
def hanging():
    """A disk at rest with its pendulum down, over a time that is long for its motions."""
    return jaxball.simulate(robots.with_pendulum(), [0.0, 30.0])


@pytest.mark.long
def test_small_oscillations_have_the_flow_of_the_matrix_exponential(hanging):
    """At rest the linear flow is that of small oscillations, up to the tolerance of the solve."""
    track = tvlqr(hanging, Q=1.0, R=1.0, sample=H)
    A, B = robots.held(*robots.small_oscillations(), H)
    np.testing.assert_allclose(track.linear.A[0], A, rtol=0, atol=10 * TOLERANCE)
    np.testing.assert_allclose(track.linear.B[0], B, rtol=0, atol=10 * TOLERANCE)
    np.testing.assert_allclose(track.linear.c, 0, atol=10 * TOLERANCE)


@pytest.mark.long
def test_a_long_horizon_has_the_stationary_gain(hanging):
    """z, which follows φ, has weight 0, and so SciPy's equation is that of the other four.

    What is left of the end decays as the closed loop does, which takes less than two units of time for a factor e.
    """
    weights = {"phi": 1.0, "phidot": 0.1, "theta": 0.5, "thetadot": 0.2}
    track = tvlqr(hanging, Q=weights, R=0.7, sample=H)
    A, B = robots.held(*robots.small_oscillations(), H)
    own = [0, 1, 3, 4]
    A, B, Q, R = A[np.ix_(own, own)], B[own], H * np.diag([*weights.values()]), H * 0.7 * np.eye(1)
    P = solve_discrete_are(A, B, Q, R)
    gain = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    np.testing.assert_allclose(track.gains[0][:, own], gain, rtol=1e-6)
    np.testing.assert_allclose(track.gains[:, 0, 2], 0, atol=1e-12)
    assert track.uncontrollable == ("phi + z",)


@pytest.mark.long
def test_a_double_integrator_has_the_least_energy_in_closed_form():
    """φ̈ = a u and θ̈ = b u exactly. With all weight at the end, the cost is the least energy to reach it.

    Over N samples of held u, the Gramian of (φ, φ̇) is a² h / R times [[h² N (4 N² − 1) / 12, h N² / 2],
    [h N² / 2, N]], by the sums of j + ½ and of its square. The weight at the end, 1e10, changes it by 1e-10 of R.
    """
    samples, R, large = 50, 0.3, 1e10
    track = tvlqr(jaxball.simulate(robots.with_wheel(), [0.0, H * samples]), Q=0.0, R=R, Qf=_at(large, large), sample=H)
    a = float(track.linear.B[0, 1, 0]) / H
    wheel = robots.WHEEL * robots.WHEEL_RADIUS**2
    disk = (robots.MASS + robots.WHEEL) * robots.RADIUS**2 + robots.INERTIA
    assert a == pytest.approx(1 / disk, rel=1e-9)
    assert float(track.linear.B[0, 4, 0]) / H == pytest.approx(1 / disk + 1 / wheel, rel=1e-9)
    N, h = samples, H
    gramian = a**2 * h / R * np.array([[h**2 * N * (4 * N**2 - 1) / 12, h * N**2 / 2], [h * N**2 / 2, N]])
    onward = np.array([[1.0, N * h], [0.0, 1.0]])
    expected = onward.T @ np.linalg.solve(gramian + np.eye(2) / large, onward)
    np.testing.assert_allclose(track.regulator.P[0, :2, :2], expected, rtol=1e-6)


def _at(phi, phidot):
    return {"phi": phi, "phidot": phidot}


@pytest.fixture(scope="module")
def moving():
    """A ball that its pendulum drives around a bend, with a schedule for each hinge."""
    times = np.linspace(0.0, 1.2, 5)
    drives = (jaxball.Waypoints(times, [0.0, 0.3, -0.2, 0.1, 0.0]), jaxball.Waypoints(times, [0.0, 0.1, 0.2, 0.1, 0.0]))
    return jaxball.simulate(robots.ball_with_pendulum(drives), [0.0, 0.6], jaxball.BallState(Omega=(0.2, 1.0, 0.1)))


WEIGHTS = {"z": 2.0, "attitude": 0.1, "Omega": 0.3, "theta": 1.0}


@pytest.mark.long
def test_the_flow_has_the_derivatives_of_differences(moving):
    """Central differences with steps of 1e-4 of numbers of size 1: errors of 1e-8, and 1e-10 / 1e-4 of the solve."""
    track = tvlqr(moving, Q=WEIGHTS, R=0.1, sample=0.05)
    k = 4
    state, after, u = track.nominal.state(k), track.nominal.state(k + 1), track.nominal.input(k)
    n, m = len(track.directions), len(track.inputs)

    @jax.jit
    def flow(v):
        return after.difference(track.sampled.flow(track.times[k], state.retract(v[:n]), u + v[n:]))

    found = np.concatenate([track.linear.A[k], track.linear.B[k]], axis=1)
    np.testing.assert_allclose(found, jacobian(flow, jnp.zeros(n + m), 1e-4, points=2), rtol=0, atol=1e-5)


@pytest.mark.long
def test_the_gains_are_those_of_the_recursion_for_p(moving):
    """P = Q + Aᵀ P A − …, in NumPy, with cross terms and what the motion misses; the weights are of size 1."""
    n, m = 12, 2
    cross = 0.02 * np.random.default_rng(0).normal(size=(n, m))
    track = tvlqr(moving, Q=1.0, R=0.5, Qf=3.0, cross=cross, sample=0.05)
    h = 0.05
    Q, R, N = h * np.eye(n), h * 0.5 * np.eye(m), h * cross
    P, p = 3.0 * np.eye(n), np.zeros(n)
    for k in reversed(range(track.nominal.samples)):
        A, B, c = (np.asarray(part[k]) for part in track.linear)
        F, G, g = R + B.T @ P @ B, N.T + B.T @ P @ A, B.T @ (P @ c + p)
        K, offset = np.linalg.solve(F, G), np.linalg.solve(F, g)
        np.testing.assert_allclose(track.gains[k], K, rtol=0, atol=1e-10)
        np.testing.assert_allclose(track.regulator.k[k], offset, rtol=0, atol=1e-10)
        P, p = Q + A.T @ P @ A - G.T @ K, A.T @ (P @ c + p) - G.T @ offset


@pytest.mark.slow
def test_the_nominal_inputs_give_the_motion(moving):
    """Held means of efforts miss each next state by the third order in the sample, so halving it divides that by 8."""
    misses = []
    for h in (0.06, 0.03):
        track = tvlqr(moving, Q=WEIGHTS, R=0.1, sample=h)
        misses.append(float(jnp.max(jnp.abs(track.linear.c))))
    assert misses[0] < 1e-2
    assert misses[0] / misses[1] == pytest.approx(8, rel=0.4)


@pytest.mark.thorough
def test_the_cost_of_a_small_deviation_is_the_cost_to_go(hanging):
    """In the limit of small deviations the closed loop costs what the regulator says; the rest is of higher order."""
    track = tvlqr(hanging, Q={"phi": 1.0, "theta": 1.0}, R=1.0, sample=H)
    xi = jnp.asarray([1e-4, 0.0, 0.0, -1e-4, 2e-4])
    loop = track.closed_loop(xi)
    start = jnp.append(xi, 1.0)
    assert float(track.cost(loop.xi, loop.du)) == pytest.approx(float(start @ track.regulator.P[0] @ start), rel=1e-6)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"sample": 40.0}, "sample"),
        ({"sample": 0.0}, "sample"),
        ({"inputs": ["mechanisms[0].joint[0]"]}, "inputs[0]"),
        ({"inputs": []}, "inputs"),
        ({"R": 0.0}, "R"),
        ({"Q": {"Phi": 1.0}}, "Q"),
        ({"Q": [1.0, 2.0]}, "Q"),
        ({"Q": -1.0}, "Q"),
        ({"cross": np.ones((5, 2))}, "cross"),
    ],
)
def test_bad_input_gets_a_sentence(hanging, changes, named):
    with refuses(ValueError, named):
        tvlqr(hanging, **{"Q": 1.0, "R": 1.0} | changes)


def test_a_motion_without_inputs_is_refused():
    still = jaxball.simulate(jaxball.Disk(mass=1.0, inertia=0.5), [0.0, 1.0])
    with refuses(ValueError, "system"):
        tvlqr(still, Q=1.0, R=1.0)
