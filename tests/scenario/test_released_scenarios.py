"""The built-in scenarios that slide, slip and bounce do what their comments say, by closed forms."""

import numpy as np
import pytest

from jaxball import Mode, load_scenario


def run(name):
    trajectory = load_scenario(name).simulate(throw=True)
    return trajectory, np.asarray(trajectory.times), trajectory.contact.switches


@pytest.mark.long
def test_the_hoop_comes_back():
    """v̇ = −μ g and r φ̈ = −μ g / k with k = 1, until the slip V + r φ̇ of 4 is used up at 4 / (2 μ g)."""
    trajectory, times, switches = run("hoop-with-backspin")
    np.testing.assert_allclose(switches.times[: int(switches.count)], [5.0], rtol=1e-9)
    slides = np.minimum(times, 5.0)
    np.testing.assert_allclose(trajectory.state.z, slides - 0.2 * slides**2 - (times - slides), atol=1e-8)
    loss = trajectory.contact.friction_loss[-1]
    np.testing.assert_allclose(loss, 0.5 * 4**2 / 2, atol=1e-8)  # of the reduced mass m / 2


@pytest.mark.slow
def test_the_bowling_ball_hooks_along_a_parabola():
    """A ball with J = 2/5 m r² slides with −μ g σ of constant direction, and the slip falls by 7/2 μ g."""
    trajectory, times, switches = run("bowling-ball")
    V, slip = np.array([8.0, -0.4]), np.array([8.0 - 0.108 * 20, -0.4 - 0.108 * 15])
    friction, speed = 0.12 * 9.81, np.linalg.norm(slip)
    end = 2 * speed / (7 * friction)
    np.testing.assert_allclose(switches.times[: int(switches.count)], [end], rtol=1e-9)
    slides = np.minimum(times, end)[:, None]
    path = V * slides - friction * slip / speed * slides**2 / 2 + (V - 2 / 7 * slip) * (times[:, None] - slides)
    np.testing.assert_allclose(trajectory.state.z, path, atol=1e-7)


@pytest.mark.slow
def test_the_ball_bounces_as_long_as_zeno_lets_it():
    """Impact k takes (1 + e) eᵏ v₀ of normal velocity, and μ times that of slip per 2/7, until it sticks at 2/7 r ω."""
    trajectory, _, switches = run("bouncing-ball")
    fall, e = np.sqrt(2.0), 0.7
    landed = fall * (1 + 2 * np.cumsum(np.concatenate([[0], e ** np.arange(1, 9)])))
    np.testing.assert_allclose(switches.times[:9], landed, rtol=1e-8)
    speed = np.minimum(0.2 * (1 + e) * np.sqrt(2.0) * np.cumsum(e ** np.arange(9)), 8 / 7)
    np.testing.assert_allclose(switches.after.V[:9, 0], speed, atol=1e-8)
    assert np.sum(speed < 8 / 7) == 3
    last = int(switches.count) - 1
    np.testing.assert_allclose(switches.times[last], fall * (1 + e) / (1 - e), atol=1e-5)
    assert int(switches.target[last]) == Mode.ROLLING
    np.testing.assert_allclose(trajectory.contact.impact_loss[-1], 4.2 - 0.7 * (8 / 7) ** 2, atol=1e-5)


@pytest.mark.slow
def test_the_paper_ball_slips_where_there_is_too_little_friction():
    """Friction is μ N while it slides and less while it rolls; what the motors do less the friction's part is E."""
    trajectory, times, switches = run("slipping-ball")
    kinds = [(Mode.ROLLING, Mode.SLIDING), (Mode.SLIDING, Mode.ROLLING)] * 2
    assert list(zip(switches.source[:4].tolist(), switches.target[:4].tolist(), strict=True)) == kinds
    seen, mode = trajectory.observables, np.asarray(trajectory.contact.mode)
    np.testing.assert_allclose(seen.friction_ratio[mode == Mode.SLIDING], 0.15, rtol=1e-12)
    assert np.all(seen.friction_ratio[mode == Mode.ROLLING] < 0.15)
    # Before it first slips it moves as on a plane with enough friction.
    rolling = load_scenario("ball").simulate(throw=True)
    before = times < float(switches.times[0])
    np.testing.assert_allclose(trajectory.state.z[before], rolling.state.z[before], atol=1e-8)
