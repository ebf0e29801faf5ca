"""The built-in scenarios that slide, slip, bounce and stop do what their comments say, by closed forms."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from jaxball import load_scenario
from jaxball.physics import Mode


def run(name):
    trajectory = load_scenario(name).simulate(throw=True)
    return trajectory, np.asarray(trajectory.times), trajectory.history.switches


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


@pytest.mark.long
def test_the_tippe_top_keeps_jelletts_integral_and_spins_on_upside_down():
    """(J ω)·c with c from the lowest point to the centre of mass; J n (R + a) of it in the end, up to 1 − cos θ."""
    trajectory, _, switches = run("tippe-top")
    assert int(switches.count) == 0
    R, a, moments, n = 0.02, 0.006, np.array([3.0e-6, 3.0e-6, 3.2e-6]), 150.0
    up, Omega = np.asarray(trajectory.observables.vertical_body), np.asarray(trajectory.state.Omega)
    jellett = np.sum(moments * Omega * (R * up - [0.0, 0.0, a]), axis=1)
    np.testing.assert_allclose(jellett, jellett[0], rtol=1e-8)
    height = R - a * up[:, 2]  # of the centre of mass
    assert height[0] < R - 0.99 * a
    assert height[-1] > R + 0.99 * a
    spin = np.sum(Omega * up, axis=1)[-1]
    np.testing.assert_allclose(spin, n * (R - a) / (R + a), rtol=0.01)
    assert Omega[-1, 2] < 0 < Omega[0, 2]  # about its own axis it spins the other way
    energy = trajectory.observables.energy + trajectory.contact.friction_loss
    np.testing.assert_allclose(energy, energy[0], rtol=1e-8)


def rolling_hoop():
    """Of the hoop: its rate, N and f by the angle of the mass from the top, by energy and Newton's law.

    (M + I/R² + 2 m (1 + cos θ)) R² θ̇² / 2 + m g R cos θ is constant, and the centre rolls along R θ.
    """
    M, m, R, g = 0.1, 0.9, 1.0, 9.81

    def inertia(theta):
        return (2 * M + 2 * m * (1 + np.cos(theta))) * R**2

    energy = inertia(0.0) * 3.0**2 / 2 + m * g * R

    def rate(theta):
        return np.sqrt(2 * (energy - m * g * R * np.cos(theta)) / inertia(theta))

    def forces(theta):
        w2 = rate(theta) ** 2
        acceleration = m * R * np.sin(theta) * (g + R * w2) / inertia(theta)
        N = (M + m) * g - m * R * (np.sin(theta) * acceleration + np.cos(theta) * w2)
        f = (M + m) * R * acceleration + m * R * (np.cos(theta) * acceleration - np.sin(theta) * w2)
        return N, f

    return rate, forces


@pytest.mark.long
def test_the_hoop_slips_before_it_would_hop():
    """At |f| = N instead of N = 0: roots in θ of the energy's integral, and t = ∫ dθ/θ̇ by quadrature."""
    rate, forces = rolling_hoop()

    def time_at(margin):
        theta = brentq(lambda theta: margin(*forces(theta)), 0.3, 1.2, xtol=1e-15)
        return quad(lambda theta: 1 / rate(theta), 0.0, theta, epsabs=1e-14, epsrel=1e-14)[0]

    slips, hops = time_at(lambda N, f: N - abs(f)), time_at(lambda N, f: N)
    np.testing.assert_allclose([slips, hops], [0.20011981826556, 0.21729178165490], rtol=0, atol=1e-13)
    _, _, switches = run("hopping-hoop")
    modes = [Mode.ROLLING, Mode.SLIDING, Mode.ROLLING, Mode.SLIDING, Mode.FLIGHT]
    assert switches.source[:4].tolist() == modes[:4]
    assert switches.target[:4].tolist() == modes[1:]
    np.testing.assert_allclose(switches.times[0], slips, rtol=0, atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("name", ["draw-shot", "masse-shot"])
def test_a_shot_slides_along_a_parabola_and_rolls_straight_on(name):
    """The slip u of a solid ball falls by 7/2 μ g, and takes 2/7 u from its velocity. Both have the times of the masse
    shot, and one program."""
    times = load_scenario("masse-shot").times
    trajectory = dataclasses.replace(load_scenario(name), times=times).simulate(throw=True)
    switches = trajectory.history.switches
    V = np.array(trajectory.contact.V[0, :2])
    Omega = np.array(trajectory.state.Omega[0])
    slip = V + 0.028575 * np.array([-Omega[1], Omega[0]])
    friction, speed = 0.2 * 9.81, np.linalg.norm(slip)
    end = 2 * speed / (7 * friction)
    np.testing.assert_allclose(switches.times[: int(switches.count)], [end], rtol=1e-9)
    slides = np.minimum(times, end)[:, None]
    path = V * slides - friction * slip / speed * slides**2 / 2 + (V - 2 / 7 * slip) * (times[:, None] - slides)
    np.testing.assert_allclose(trajectory.state.z, path, atol=1e-8)
    rolls = times > end
    np.testing.assert_allclose(trajectory.contact.V[rolls, :2], np.tile(V - 2 / 7 * slip, (rolls.sum(), 1)), atol=1e-8)
    assert path[-1, 0] < np.max(path[:, 0])  # it comes back


@pytest.mark.long
def test_the_ball_stops_at_the_end_of_a_parabola():
    """c N r slows a solid ball down by 5/7 c g, and b N r its spin by 5/2 b g/r; then it rests exactly."""
    trajectory, times, switches = run("stopping-ball")
    r, g, c, b, spin = 0.028575, 9.81, 0.01, 0.02, 60.0
    v = 35.0 * r
    stops, still = 7 * v / (5 * c * g), 2 * r * spin / (5 * b * g)
    np.testing.assert_allclose(np.sort(switches.times[: int(switches.count)]), [still, stops], rtol=1e-9)
    rolls = np.minimum(times, stops)
    np.testing.assert_allclose(trajectory.state.z[:, 0], v * rolls - 5 / 14 * c * g * rolls**2, atol=1e-9)
    np.testing.assert_allclose(trajectory.state.z[-1], [7 * v**2 / (10 * c * g), 0.0], atol=1e-9)
    np.testing.assert_array_equal(trajectory.state.Omega[times > stops], 0.0)
