"""A ball that leaves, flies over and lands on grounds that are where a function is zero."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq, minimize

from jaxball import Ball, BallState, Bowl, Contact, Status, simulate
from jaxball.physics import Mode, ReleasedState, SignedDistance
from tests.support.signed_distances import inside_ellipsoid, inside_sphere, outside_sphere

G, R = 9.81, 0.1
SOLID = {"mass": 1.0, "radius": R, "inertia": (0.004, 0.004, 0.004), "gravity": G}
FINE = {"rtol": 1e-12, "atol": 1e-12}
PHI = 0.3  # from the top of a sphere of radius 1, where balls are released from rest


@pytest.mark.thorough
@pytest.mark.parametrize("centre", [(0.0, 0.0, -1.0), None])
def test_a_ball_rolls_off_a_sphere(centre):
    """With great friction at cos φ = (10/17) cos φ₀, by rays and by lines from above; then it flies as a point does.

    Seen from above, the piece that is nearest to it is hidden once its centre is lower than that of the sphere.
    """
    ground = SignedDistance(outside_sphere, 1.0, centre=centre, guess=0.0 if centre is None else 1.0)
    start = BallState(z=(np.sin(PHI) if centre is None else 2 * np.tan(PHI / 2), 0.0))
    times, law = np.linspace(0.0, 1.2, 25), Contact(1.0, static_friction=1e9)
    run = simulate(Ball(**SOLID, ground=ground), times, start, contact=law, **FINE)
    switches = run.contact.switches
    last = int(switches.count) - 1
    assert switches.target[last] == Mode.FLIGHT
    u, t = float(switches.before.body.z[last, 0]), float(switches.times[last])
    phi = np.arcsin(u) if centre is None else 2 * np.arctan(u / 2)
    np.testing.assert_allclose(np.cos(phi), 10 / 17 * np.cos(PHI), atol=1e-7)
    c, V = 1.1 * np.array([np.sin(phi), 0.0, np.cos(phi)]) - [0.0, 0.0, 1.0], np.asarray(switches.after.V[last])
    if centre is None:
        hidden = t + np.max(np.roots([-0.5 * G, V[2], c[2] + 1.0]))
        assert run.status == Status.NOT_FINITE
        np.testing.assert_allclose(run.reached, hidden, atol=1e-6)
    else:
        assert run.ok
    flies = (times > t) & (times < run.reached)
    assert flies.sum() > 1
    s = (times - t)[flies][:, None]
    path = c + V * s + 0.5 * s**2 * np.array([0.0, 0.0, -G])
    np.testing.assert_allclose(np.asarray(run.observables.geometric_centre)[flies], path, atol=1e-9)
    height = np.linalg.norm(path - [0.0, 0.0, -1.0], axis=1) - 1.1
    np.testing.assert_allclose(np.asarray(run.contact.height)[flies], height, atol=1e-9)


@pytest.mark.thorough
def test_bounces_in_a_bowl_are_those_in_a_closed_form():
    thrown = ReleasedState(BallState(z=(0.3, 0.1), Omega=(1.0, 2.0, 3.0)), V=(0.2, 0.5, 0.0), height=0.3)
    signed = SignedDistance(inside_sphere, 1.0, centre=(0.0, 0.0, 1.0), guess=1.0)
    ours, theirs = (
        simulate(
            Ball(**SOLID, ground=ground),
            np.linspace(0.0, 1.5, 16),
            thrown,
            contact=Contact(0.3, restitution=0.7),
            **FINE,
        )
        for ground in (signed, Bowl(1.0))
    )
    count = int(theirs.contact.switches.count)
    assert count > 3
    np.testing.assert_array_equal(ours.contact.switches.target, theirs.contact.switches.target)
    np.testing.assert_allclose(ours.contact.switches.times[:count], theirs.contact.switches.times[:count], atol=1e-9)
    np.testing.assert_allclose(ours.observables.geometric_centre, theirs.observables.geometric_centre, atol=1e-9)


@pytest.mark.thorough
def test_a_ball_lands_on_an_ellipsoid():
    """When its centre, which flies as a point does, is as near as its radius, by minimising over the ellipsoid."""
    axes = np.array([1.0, 1.4, 0.6])
    ground = SignedDistance(lambda *given: -inside_ellipsoid(*given), axes, centre=(0.0, 0.0, 0.0), guess=1.0)
    u = np.array([0.3, -0.2])
    p = np.asarray(ground.point(jnp.array(0.0), *map(jnp.asarray, u)))
    n = p / axes**2 / np.linalg.norm(p / axes**2)
    V, height = np.array([0.9, 1.1, 1.0]), 0.2
    c = p + (R + height) * n

    def gap(t):
        x = c + V * t - [0.0, 0.0, 0.5 * G * t**2]

        def square(angles):
            (a, b) = angles
            e = axes * [np.cos(a) * np.sin(b), np.sin(a) * np.sin(b), np.cos(b)]
            return (x - e) @ (x - e)

        y = x / axes
        first = [np.arctan2(y[1], y[0]), np.arccos(y[2] / np.linalg.norm(y))]
        return np.sqrt(minimize(square, first, method="BFGS", options={"gtol": 1e-12}).fun) - R

    np.testing.assert_allclose(gap(0.0), height, atol=1e-9)
    later = np.linspace(0.05, 1.0, 96)
    first = next(s for s in later if gap(s) < 0)
    lands = brentq(gap, first - 0.01, first, xtol=1e-12)
    run = simulate(
        Ball(**SOLID, ground=ground),
        np.array([0.0, lands / 2, lands + 1e-3]),
        ReleasedState(BallState(z=u), V=V, height=height),
        contact=Contact(0.2, restitution=0.5),
        **FINE,
    )
    assert run.contact.switches.source[0] == Mode.FLIGHT
    np.testing.assert_allclose(run.contact.switches.times[0], lands, atol=1e-8)
    np.testing.assert_allclose(run.contact.height[1], gap(lands / 2), atol=1e-8)


@pytest.mark.thorough
def test_a_smooth_ball_leaves_a_sphere_at_two_thirds():
    ground = SignedDistance(outside_sphere, 1.0, centre=(0.0, 0.0, -1.0), guess=1.0)
    start, times = BallState(z=(2 * np.tan(PHI / 2), 0.0)), np.linspace(0.0, 1.0, 25)
    run = simulate(Ball(**SOLID, ground=ground), times, start, contact=Contact(0.0), **FINE)
    end = 2 * np.arctan(float(run.contact.switches.before.body.z[0, 0]) / 2)
    np.testing.assert_allclose(np.cos(end), 2 / 3 * np.cos(PHI), atol=1e-9)
