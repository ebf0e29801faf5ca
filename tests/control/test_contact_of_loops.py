"""The contact force between the samples of a closed loop, against the equations of a disk with a pendulum, by SciPy."""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxball
from jaxball.control import Push, tvlqr
from tests.control import robots

H = 0.4
PUSH, FROM, UNTIL = 0.6, 1.25, 1.5  # between two samples
START = {"phi": 0.3, "thetadot": -0.2}


@pytest.fixture(scope="module")
def track():
    """A disk that its pendulum holds at rest; the samples are so long that the forces are extreme between them."""
    run = jaxball.simulate(robots.with_pendulum(jaxball.Motor(0.0, limit=0.3)), [0.0, 4.0])
    return tvlqr(run, Q={"phi": 1.0, "theta": 1.0}, R=0.01, sample=H)


@pytest.fixture(scope="module")
def loop(track):
    return track.closed_loop(START, push=Push((PUSH, 0.0, 0.0), start=FROM, duration=UNTIL - FROM))


def accelerations(x, u, push):
    """φ̈ and β̈ of (φ, φ̇, β, β̇), with the pendulum's lean β = θ − φ, where z = −r φ and its weight is at
    −(r φ + l sin β), −l cos β.

    T = ½ (m0 r² + d) φ̇² + ½ m [(r φ̇ + l cos β β̇)² + (l sin β β̇)²], V = −m g l cos β; the torque u has the power
    u (φ̇ + β̇), and the push the power −r φ̇ push.
    """
    m, l, r = robots.WEIGHT, robots.LENGTH, robots.RADIUS
    beta, rate = x[2], x[3]
    inertia = np.array(
        [
            [robots.MASS * r**2 + robots.INERTIA + m * r**2, m * r * l * np.cos(beta)],
            [m * r * l * np.cos(beta), m * l**2],
        ]
    )
    forces = [u - r * push + m * r * l * np.sin(beta) * rate**2, u - m * robots.GRAVITY * l * np.sin(beta)]
    return np.linalg.solve(inertia, forces)


def contact(x, u, push):
    """N and |f| by the acceleration of the centre of mass."""
    m, l, r = robots.WEIGHT, robots.LENGTH, robots.RADIUS
    beta, rate = x[2], x[3]
    phi_rate, beta_rate = accelerations(x, u, push)
    along = -(robots.MASS + m) * r * phi_rate - m * l * (np.cos(beta) * beta_rate - np.sin(beta) * rate**2)
    up = m * l * (np.sin(beta) * beta_rate + np.cos(beta) * rate**2)
    return up + (robots.MASS + m) * robots.GRAVITY, abs(along - push)


def extremes_by_scipy(loop):
    """The least N, the largest |f| / N and the largest |f|, each with its time, at 400 times of each smooth piece."""
    times, u = np.asarray(loop.times), np.asarray(loop.u)[:, 0]
    theta, thetadot = (np.asarray(leaf)[:, 0] for leaf in (loop.states.theta, loop.states.thetadot))
    phi, phidot = np.asarray(loop.states.phi), np.asarray(loop.states.phidot)
    rows = []
    for k in range(len(u)):
        x = np.array([phi[k], phidot[k], theta[k] - phi[k], thetadot[k] - phidot[k]])
        ends = [times[k], *(t for t in (FROM, UNTIL) if times[k] < t < times[k + 1]), times[k + 1]]
        for first, last in itertools.pairwise(ends):
            push = PUSH if FROM <= first < UNTIL else 0.0

            def rates(_, x, u=u[k], push=push):
                phi_rate, beta_rate = accelerations(x, u, push)
                return [x[1], phi_rate, x[3], beta_rate]

            instants = np.linspace(first, last, 400)
            solved = solve_ivp(rates, (first, last), x, "DOP853", instants, rtol=1e-12, atol=1e-12)
            rows += [(t, *contact(state, u[k], push)) for t, state in zip(instants, solved.y.T, strict=True)]
            x = solved.y[:, -1]
    t, N, f = np.array(rows).T
    return [(of[k], t[k]) for of, k in ((N, np.argmin(N)), (f / N, np.argmax(f / N)), (f, np.argmax(f)))]


@pytest.mark.long
def test_extremes_are_those_of_the_own_equations(loop):
    """Steps of 1e-3 of the duration miss a maximum by (1e-3)² of its curvature, which is of size 10."""
    found = jaxball.contact_extremes(loop.run)
    expected = extremes_by_scipy(loop)
    pairs = [
        (found.least_normal_force, found.least_normal_force_time),
        (found.friction_needed, found.friction_needed_time),
        (found.largest_friction, found.largest_friction_time),
    ]
    for (value, time), (wanted, when) in zip(pairs, expected, strict=True):
        assert float(value) == pytest.approx(wanted, abs=3e-6)
        assert float(time) == pytest.approx(when, abs=3e-3)
    assert not np.asarray(found.constant).any()
    # What the samples alone would say is less than what happens between them.
    seen = loop.run.observables
    assert float(found.friction_needed) > 1.01 * float(jnp.max(seen.friction_ratio))
    assert float(found.least_normal_force) < float(jnp.min(seen.normal_force)) - 1e-3
    assert float(loop.run.friction_needed) == float(jnp.max(seen.friction_ratio))


@pytest.mark.long
def test_a_saved_loop_has_the_same_extremes(loop, tmp_path):
    read = jaxball.load_run(loop.run.save(tmp_path / "held.nc"), loop.run.system)
    for ours, theirs in zip(*(jax.tree.leaves(jaxball.contact_extremes(run)) for run in (loop.run, read)), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12)


@pytest.mark.long
def test_a_body_at_rest_has_constant_forces(track):
    found = jaxball.contact_extremes(track.closed_loop().run)
    assert np.asarray(found.constant).all()
    assert float(found.margin) == pytest.approx(1.0, abs=1e-12)
    assert float(found.friction_needed) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.long
def test_what_was_not_reached_does_not_count(loop):
    """A loop that fails in its fifth sample has the extremes of four; one that fails at once has none."""

    def fail_at(k):
        broken = jax.tree.map(lambda leaf: leaf.at[k:].set(jnp.nan), (loop.xi, loop.states))
        return eqx.tree_at(lambda whole: (whole.xi, whole.states), loop, broken).run

    found, none = (jaxball.contact_extremes(fail_at(k)) for k in (5, 1))
    assert 0 < float(found.friction_needed) < float("inf")
    assert float(found.least_normal_force_time) <= float(loop.times[4])
    assert np.isnan(float(none.least_normal_force))


@pytest.mark.slow
@pytest.mark.parametrize("derivative", [jax.grad, jax.jacfwd])
def test_derivatives_are_those_of_differences(track, derivative):
    """Central differences with a step of 1e-4 have errors of 1e-8 of a derivative of size 1."""

    def needed(phi):
        loop = track.closed_loop({"phi": phi, "thetadot": -0.2}, samples=5, limits=1e3)
        return jaxball.contact_extremes(loop.run).friction_needed

    found = jaxball.jit(derivative(needed))(jnp.asarray(0.3))
    compiled = jaxball.jit(needed)
    expected = (compiled(jnp.asarray(0.3001)) - compiled(jnp.asarray(0.2999))) / 2e-4
    np.testing.assert_allclose(found, expected, rtol=1e-6)
