"""The built-in scenarios on curved and moving grounds do what is known of them in closed form."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipj, ellipk

from jaxball import Detachment, load_scenario
from jaxball.physics import SwitchCause
from tests.support.on_surfaces import time_of_landing

from .runs import rolling_run

G = 9.81


@pytest.mark.thorough
def test_a_ball_swings_in_a_bowl_as_a_pendulum():
    """sin(φ/2) = k cd(ω t), k = sin(φ₀/2), ω² = 5g / (7 (R − r)). The next term of the period is 11/3072 φ₀⁴."""
    trajectory, times, seen = rolling_run("ball-in-a-bowl")
    phi0, w = 0.5, np.sqrt(5 * G / (7 * 0.9))
    k2 = np.sin(phi0 / 2) ** 2
    _, cn, dn, _ = ellipj(w * times, k2)
    phi = 2 * np.arcsin(np.sin(phi0 / 2) * cn / dn)
    np.testing.assert_allclose(seen.geometric_centre[:, 0], 0.9 * np.sin(phi), atol=1e-8)
    np.testing.assert_allclose(seen.geometric_centre[:, 2], 1 - 0.9 * np.cos(phi), atol=1e-8)
    z = np.asarray(trajectory.state.z)
    crossings = [
        times[i] - z[i, 0] * (times[i + 1] - times[i]) / (z[i + 1, 0] - z[i, 0])
        for i in np.flatnonzero(z[1:, 0] * z[:-1, 0] < 0)
    ]
    period = 2 * np.diff(crossings)[0]
    small = 2 * np.pi * np.sqrt(7 * 0.9 / (5 * G))
    assert period / small - 1 == pytest.approx(phi0**2 / 16, abs=3e-4)
    assert period == pytest.approx(4 * ellipk(k2) / w, rel=1e-4)  # by straight lines between saves


@pytest.mark.thorough
def test_a_golf_ball_comes_out_of_the_hole():
    """φ = w t, and the height is −5g/(2 w²) (1 − cos √(2/7) w t)."""
    trajectory, times, seen = rolling_run("golfers-dilemma")
    w = 25.0
    height = -5 * G / (2 * w**2) * (1 - np.cos(np.sqrt(2 / 7) * w * times))
    centre = np.asarray(seen.geometric_centre)
    np.testing.assert_allclose(centre[:, 2], height, atol=1e-9)
    np.testing.assert_allclose(trajectory.state.z[:, 1], 0.054 * w * times, atol=1e-9)
    around = 0.0324 * np.exp(1j * w * times)
    np.testing.assert_allclose(centre[:, 0] + 1j * centre[:, 1], around, atol=1e-9)
    assert np.min(height) == pytest.approx(-0.0785, abs=1e-4)
    assert np.sum(np.diff(np.sign(np.diff(height))) != 0) >= 3  # down, up, and down again
    np.testing.assert_allclose(seen.normal_force, 0.046 * 0.0324 * w**2, rtol=1e-7)
    assert 0.4 < np.max(seen.friction_ratio) < 1.0


@pytest.mark.thorough
def test_a_ball_leaves_a_sphere_where_nothing_presses_it():
    """7/10 v² = g (R + r) (cos φ₀ − cos φ), and N = m (g cos φ − v² / (R + r)), which is 0 at 10/17 cos φ₀."""
    scenario = load_scenario("ball-off-a-sphere")
    longer = dataclasses.replace(scenario, times=np.append(scenario.times, 3.0))
    run = longer.simulate(events={"off": Detachment()})
    cosine = (np.asarray(run.observables.geometric_centre)[:-1, 2] + 1) / 1.1
    normal = G * (17 * cosine - 10 * np.cos(0.1)) / 7
    np.testing.assert_allclose(run.observables.normal_force[:-1], normal, atol=1e-7)
    assert 0 < normal[-1] < 0.01 * normal[0]
    off = run.events["off"]
    last = 2 * np.arctan(np.linalg.norm(off.state.z[0]) / 2)
    # Deviations of 1e-10 grow as φ does, about tenfold.
    assert np.cos(last) == pytest.approx(10 / 17 * np.cos(0.1), abs=1e-8)


@pytest.mark.thorough
def test_a_ball_goes_round_on_a_tilting_plate():
    """In first order of the tilt a = 0.05. Relative to it, what is left out is of the order of a², and adds up."""
    _, times, seen = rolling_run("tilting-plate")
    rho, n = 5 * G * 0.05 / (7 * 2.0**2), 2.0
    centre = np.asarray(seen.geometric_centre)
    expected = rho * np.stack([-np.sin(n * times), np.cos(n * times)], axis=1)
    assert np.all(np.linalg.norm(centre[:, :2] - expected, axis=1) < 0.05**2 * (2 + n * times) * rho)
    assert np.ptp(centre[:, 2]) < 0.05 * 0.05 * rho  # always where the plate is highest


@pytest.mark.thorough
def test_a_plate_brings_a_ball_to_its_middle():
    """α = −(8/c) x t² (1 − 2t/3) exp(−2t) in first order of it; what is left out is relatively of the order of α²."""
    trajectory, times, seen = rolling_run("ball-and-plate")
    c = 5 * G / 7
    shape = -8 / c * times**2 * (1 - 2 * times / 3) * np.exp(-2 * times)
    expected = np.stack([0.1 * shape, 0.15 * shape], axis=1)  # of y = −0.1, about the other axis the other way
    tilt = np.max(np.abs(expected))
    np.testing.assert_allclose(trajectory.state.theta, expected, atol=10 * tilt**2 * tilt)
    np.testing.assert_allclose(trajectory.state.z[-1], 0.0, atol=1e-3)
    np.testing.assert_allclose(seen.normal_force[-1], 0.5 * G, rtol=1e-4)


@pytest.mark.thorough
def test_a_ball_on_a_washboard_is_pressed_into_its_troughs():
    """Its energy, and N where the waves are level, from the curvature of the curve on which its centre is."""
    trajectory, _, seen = rolling_run("washboard")
    centre = np.asarray(seen.geometric_centre)
    speed2 = 0.9**2 + 2 * 5 / 7 * G * (centre[0, 2] - centre[:, 2])
    omega2 = np.sum(np.asarray(trajectory.state.Omega) ** 2, axis=1)
    np.testing.assert_allclose(0.1**2 * omega2, speed2, rtol=1e-8)
    phase = 2 * np.pi * np.asarray(trajectory.state.z)[:, 0] / 0.8
    k, N = 0.03 * (2 * np.pi / 0.8) ** 2, np.asarray(seen.normal_force)
    crest, trough = G - 0.9**2 * k / (1 + 0.1 * k), G + (0.9**2 + 10 / 7 * G * 0.06) * k / (1 - 0.1 * k)
    assert N[0] == pytest.approx(crest, rel=1e-9)
    i = np.argmin(np.abs(np.cos(phase) + 1))
    assert N[i] == pytest.approx(trough, rel=2e-2)  # one save may be 0.02 from the lowest point
    assert np.min(N) > 0
    assert phase[-1] > 8 * np.pi
    np.testing.assert_allclose(trajectory.state.z[:, 1], 0.0, atol=1e-12)


@pytest.mark.thorough
def test_a_wheel_swings_in_a_half_pipe():
    """sin(ψ/2) = k cd(ω t), k = sin(ψ₀/2), ω² = g / (1.5 (R − r)); N = m g cos ψ + m (R − r) ψ̇²."""
    trajectory, times, seen = rolling_run("wheel-in-a-half-pipe")
    psi0, w = 1.2, np.sqrt(G / (1.5 * 1.7))
    _, cn, dn, _ = ellipj(w * times, np.sin(psi0 / 2) ** 2)
    psi = 2 * np.arcsin(np.sin(psi0 / 2) * cn / dn)
    np.testing.assert_allclose(trajectory.state.z, 2 * psi, atol=1e-8)
    square = 2 * w**2 * (np.cos(psi) - np.cos(psi0))
    np.testing.assert_allclose(seen.normal_force, 2 * (G * np.cos(psi) + 1.7 * square), rtol=1e-7)
    np.testing.assert_allclose(seen.friction[:, 0], 2 / 3 * G * np.sin(psi), atol=1e-7)


@pytest.mark.thorough
def test_a_ball_jumps_over_a_wave():
    """It rolls up with 7/10 v² + g z constant, N = 0 where v² k/(1 + r k) = g cos a, and flies on a parabola.

    Just before, friction gives way, which changes v little; where it does is where 2/7 mg sin a is 0.4 N.
    """
    trajectory = load_scenario("jumping-ball").simulate(throw=True)
    times, seen = np.asarray(trajectory.times), trajectory.observables
    r, A, k = 0.02, 0.04, 2 * np.pi / 0.8
    switches = trajectory.contact.switches
    assert [int(x) for x in switches.cause[:3]] == [SwitchCause.GIVES_WAY, SwitchCause.LIFTS, SwitchCause.LANDS]

    def wave(x):
        return -A * np.cos(k * x)

    def rolling(x):
        """v², the curvature of the centre's path, downwards, and sine and cosine of the slope."""
        slope, bend = A * k * np.sin(k * x), A * k**2 * np.cos(k * x)
        cosine = 1 / np.hypot(slope, 1.0)
        kappa = -bend * cosine**3
        height = wave(x) + r * cosine - (r - A)
        return 3.0**2 - 10 / 7 * G * height, kappa / (1 + r * kappa), slope * cosine, cosine

    def spare(x):
        v2, bend, sine, cosine = rolling(x)
        return 0.4 * (G * cosine - v2 * bend) - 2 / 7 * G * sine

    slips, lifts = np.asarray(switches.before.body.z)[:2, 0]
    assert slips == pytest.approx(brentq(spare, 0.1, 0.35), abs=1e-8)
    t, V = (np.asarray(x)[1] for x in (switches.times, switches.after.V))
    _, bend, sine, cosine = rolling(lifts)
    assert V @ V * bend == pytest.approx(G * cosine, rel=1e-7)
    c = np.array([lifts - r * sine, 0.0, wave(lifts) + r * cosine])
    lands = time_of_landing(wave, c, V, r, G)
    assert float(switches.times[2]) - t == pytest.approx(lands, abs=1e-8)
    s = times[(times > t) & (times < t + lands)][:, None] - t
    path = c + V * s + 0.5 * s**2 * np.array([0.0, 0.0, -G])
    np.testing.assert_allclose(np.asarray(seen.geometric_centre)[(times > t) & (times < t + lands)], path, atol=1e-9)
    total = np.asarray(seen.energy + trajectory.contact.friction_loss + trajectory.contact.impact_loss)
    np.testing.assert_allclose(total, total[0], rtol=1e-8)
