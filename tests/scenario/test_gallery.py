"""Published rolling robots among the built-in scenarios do what is known of them in closed form.

Runs are solved to 1e-10 at least. States at the save times are interpolated between steps, which costs a factor of a
hundred or so.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxball.scenario import load_scenario


def run(name):
    trajectory = load_scenario(name).simulate(throw=True)
    return trajectory, np.asarray(trajectory.times), trajectory.observables


def test_three_rotors_roll_the_ball_from_rest_to_rest():
    """Ω = −(K + M r² Γ(Γ·K) / (D − C)) / (D − C + M r²), with K_a the impulse of motor a so far.

    The whole inertia is D = 0.4 + 2 C, with C = 0.05 of each ring, and M = 1.6.
    """
    trajectory, times, seen = run("three-rotors")
    K = np.stack(
        [
            np.interp(times, [0, 2, 6, 8], [0, -0.2, -0.2, 0]),
            np.interp(times, [1, 4, 7], [0, 0.45, 0]),
            np.interp(times, [3, 5, 9], [0, -0.2, 0]),
        ],
        axis=1,
    )
    G, rest, Mr2 = np.asarray(seen.vertical_body), 0.4 + 0.05, 1.6
    Omega = -(K + Mr2 / rest * G * np.sum(G * K, axis=1, keepdims=True)) / (rest + Mr2)
    np.testing.assert_allclose(trajectory.state.Omega, Omega, atol=1e-8)
    assert np.linalg.norm(trajectory.state.z[-1]) > 0.5
    np.testing.assert_allclose(seen.normal_force, 1.6, atol=1e-8)


def test_a_ball_on_a_turntable_goes_round_at_two_sevenths_of_its_rate():
    """ż turns at 2/7 W from ż(0) = r Ω × e3 + W e3 × (z − c), and Ω₃ stays."""
    trajectory, times, seen = run("turntable")
    rate = 2.0 * 2 / 7
    turn = np.exp(1j * rate * times)
    z, zdot = np.asarray(trajectory.state.z), (1.5 - 0.5j) + 2j * (0 - 1)
    np.testing.assert_allclose(z[:, 0] + 1j * z[:, 1], zdot / (1j * rate) * (turn - 1), atol=1e-8)
    np.testing.assert_allclose(seen.angular_velocity_space[:, 2], 0.7, atol=1e-8)
    assert times[-1] * rate > 2 * np.pi


def rocking(t, y):
    """φ̈ = −m a (g + Ẍ) / (d + m (r − a)²) φ, for angle, rate and a fundamental pair of solutions."""
    w2 = 0.2 * (9.8 - 2.8**2 * np.sin(2.8 * t)) / (0.36 + 0.8**2)
    return np.concatenate([y[2:], -w2 * y[:2]])


def test_a_shaken_ball_rocks_up_as_mathieus_equation_says():
    """While it rocks by less than 0.1, the equation is good to φ², 1e-2 of what it says.

    Growth by exp(h ω₀ t / 4), with h = 0.8 of g and ω₀ = 1.4, is the first order in h.
    """
    _, times, seen = run("vibrating-plane")
    period = 2 * np.pi / 2.8
    linear = solve_ivp(rocking, (0, 20), [1, 0, 0, 1], rtol=1e-10, atol=1e-12, dense_output=True).sol
    angle = np.arctan2(seen.vertical_body[:, 0], seen.vertical_body[:, 2])
    angle *= np.sign(angle[0])
    np.testing.assert_allclose(angle, 1e-3 * linear(times)[0], atol=1e-2 * np.max(np.abs(angle)))
    monodromy = linear(period).reshape(2, 2)
    multiplier = np.max(np.abs(np.linalg.eigvals(monodromy)))
    assert multiplier == pytest.approx(np.exp(0.28 * period), rel=0.02)
    halves = times < 10
    assert np.max(np.abs(angle[~halves])) > 3 * np.max(np.abs(angle[halves]))
    assert np.max(np.abs(angle)) < 0.1
