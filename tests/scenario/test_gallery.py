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


@pytest.mark.thorough
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


@pytest.mark.thorough
def test_an_axisymmetric_pendulum_goes_round_steadily():
    """w is that of the document, and the radius of the centre's circle is m l sin a / (m + mc).

    By Newton and Euler in the axes of the common centre of mass, in which the pivot is a sled of mass mc = m0 + d / r².
    """
    trajectory, times, seen = run("axisymmetric-pendulum")
    m, l, a, s, mc, C, i = 0.6, 0.5, 0.6, 4.0, 1.0 + 0.4, 0.6 * 0.3**2, 0.6 * 0.3**2 / 2
    A, B = (i + m * l**2 * mc / (m + mc)) * np.cos(a), C * s
    turn = np.exp(1j * (-B + np.sqrt(B**2 + 4 * A * m * l)) / (2 * A) * times)
    ring = np.mean(np.asarray(seen.mass_positions_space), axis=1)
    np.testing.assert_allclose(ring[:, 2], -l * np.cos(a), atol=1e-7)
    np.testing.assert_allclose(ring[:, 0] + 1j * ring[:, 1], l * np.sin(a) * turn, atol=1e-7)
    z = np.asarray(trajectory.state.z)
    np.testing.assert_allclose(z[:, 0] + 1j * z[:, 1], m * l * np.sin(a) / (m + mc) * (1 - turn), atol=1e-7)


@pytest.mark.thorough
def test_an_axisymmetric_pendulum_drives_a_ball_up_a_slope():
    """z = −½ A t², with the rod at the angle b uphill from the normal, by Newton and Euler.

    On the ball as a sled of mass mc = m0 + d / r² pull the pendulum's weight and the motor's Q / r. In the axes of the
    sled gravity is (g sin a + A, 0, −g cos a), whose torque on the pendulum is Q, so that nothing turns the spin.
    """
    trajectory, times, seen = run("axisymmetric-pendulum-on-a-slope")
    m, l, a, A = 0.6, 0.5, 0.1, 0.02
    Q = (m + 1.4) * A + (m + 1.0) * np.sin(a)
    tilt = np.arctan2(np.sin(a) + A, np.cos(a))
    b = np.arcsin(Q / (m * l * np.hypot(np.sin(a) + A, np.cos(a)))) - tilt
    np.testing.assert_allclose(trajectory.state.z, np.outer(-A / 2 * times**2, [1, 0]), atol=1e-7)
    ring = np.mean(np.asarray(seen.mass_positions_space), axis=1)
    np.testing.assert_allclose(ring - l * np.array([-np.sin(b), 0, -np.cos(b)]), 0, atol=1e-7)
    np.testing.assert_allclose(seen.joint_rates[:, 2], 4.0, atol=1e-7)
    np.testing.assert_allclose(seen.joint_efforts[:, 0], Q, atol=1e-12)
    assert trajectory.state.z[-1, 0] < -3.9


@pytest.mark.thorough
def test_the_spin_of_a_gyroscopic_pendulum_is_the_impulse_of_its_motor():
    """C (n·ω) = ∫Q, with the rod n and ω = Ω + θ̇₁ E₂ + θ̇₂ w₂ + θ̇₃ n of the ring, all in body axes."""
    trajectory, times, seen = run("gyroscopic-pendulum")
    (t1, t2, _), rates = np.asarray(seen.joint_angles).T, np.asarray(seen.joint_rates)
    second = np.stack([np.cos(t1), 0 * t1, -np.sin(t1)], axis=1)
    rod = -np.stack([np.sin(t1) * np.cos(t2), -np.sin(t2), np.cos(t1) * np.cos(t2)], axis=1)
    omega = trajectory.state.Omega + rates[:, :1] * [0, 1, 0] + rates[:, 1:2] * second + rates[:, 2:] * rod
    impulse = np.interp(times, [0, 5, 10], [0, 1.0, 0.75])
    np.testing.assert_allclose(0.8 * 0.4**2 * np.sum(omega * rod, axis=1), impulse, atol=1e-7)
    ring = np.mean(np.asarray(seen.mass_positions_body), axis=1)
    np.testing.assert_allclose(ring, 0.4 * rod, atol=1e-12)
    assert np.linalg.norm(trajectory.state.z[-1]) > 0.2


def test_moball_rests_where_the_sum_of_its_forces_points_down():
    """At rest κ θ_j = Q_j − m g Γ·n_j, and Σ m θ_j n_j points down. With Σ n_j n_j = 2·1, so does Σ Q_j n_j.

    The ball is damped almost as much as makes it rest soonest, and its swing dies at a rate of about 0.4.
    """
    trajectory, _, seen = run("moball")
    f = np.array([4.0, 2.0, -3.0])
    G = np.asarray(seen.vertical_body)[-1]
    np.testing.assert_allclose(G, -f / np.linalg.norm(f), atol=1e-3)
    along = np.stack([f, -f], axis=1).ravel() / 2
    weight = 0.3 * 10 * np.stack([G, -G], axis=1).ravel()
    np.testing.assert_allclose(seen.joint_angles[-1], (along - weight) / 20, atol=1e-3)
    assert np.linalg.norm(trajectory.state.Omega[-1]) < 1e-3


@pytest.mark.thorough
def test_roboball_rolls_at_the_speed_at_which_motor_weight_and_resistance_balance():
    """3 (1 − v/4) = v + 0.02 M g r, and the pendulum stays where its weight has this torque; M g r = 18.

    The ball nears this at a rate of about (1 + 3/4) / (0.6 + 1.8), so e^−14 of it is missing; the smoothing of the dry
    friction leaves out 1e-6 / (2 v²) of it.
    """
    trajectory, _, seen = run("roboball")
    v = (3 - 0.02 * 18) / (1 + 3 / 4)
    torque = 3 * (1 - v / 4)
    np.testing.assert_allclose(trajectory.state.Omega[-1], [0, v, 0], atol=1e-5)
    np.testing.assert_allclose(seen.mass_positions_space[-1, 0, 0], torque / (0.8 * 10), atol=1e-5)
    np.testing.assert_allclose(seen.joint_efforts[-1], [-torque], atol=1e-5)


@pytest.mark.thorough
def test_roboball_2_swings_until_friction_holds_both_joints():
    """While both stick it is a rigid ball that rolls, so its energy stays, and neither effort passes 0.7 N m."""
    trajectory, times, seen = run("roboball-2")
    stuck = np.all(np.asarray(trajectory.history.sticks), axis=1)
    assert stuck[-1]
    assert times[stuck][0] < 5.0
    assert np.all(stuck[times > 5.0])
    energy = np.asarray(seen.kinetic_energy + seen.potential_energy)
    np.testing.assert_allclose(energy[stuck], energy[-1], rtol=1e-9)
    assert energy[0] - energy[-1] > 1.0
    assert np.abs(seen.joint_efforts[stuck]).max() < 0.7


def test_spokes_keep_the_momentum_of_a_balanced_ball():
    """(J + M r²) ω_h and J ω₃ stay, with J = 0.4 + 4/3 θ² of the four masses of 0.5 at θ from the centre."""
    trajectory, times, seen = run("spokes")
    theta = 0.5 + 0.4 * np.sin(times)
    J, omega = 0.4 + 4 / 3 * theta[:, None] ** 2, np.asarray(seen.angular_velocity_space)
    momentum = (J + np.array([3.0, 3.0, 0.0])) * omega
    at_start = (0.4 + 1 / 3 + np.array([3.0, 3.0, 0.0])) * [0.2, 0.5, 0.3]
    np.testing.assert_allclose(momentum - at_start, 0.0, atol=1e-8)
    np.testing.assert_allclose(np.asarray(trajectory.state.z) @ np.array([0.2, 0.5]), 0.0, atol=1e-8)


def test_a_pendulum_held_to_the_side_leads_the_ball_round_a_circle():
    """Of radius ρ, with the pendulum at s < 0 outward of the centre and h below it, and no spin about the vertical.

    The yoke's axis is along e3 + (ρ / r) e_ρ, and the torques about the tangent are in balance where
    s m g = W² ((m h − m r)(ρ + s) − (d / r + m0 r) ρ).
    """
    trajectory, times, seen = run("pendulum-and-yoke")
    s, h, rho, m = -0.5 * np.sin(0.3), 0.5 * np.cos(0.3), 2.0, 0.8
    W = np.sqrt(s * m * 10 / ((m * h - m) * (rho + s) - (0.4 + 1) * rho))
    turn = 1j * np.exp(1j * W * times)
    z, place = np.asarray(trajectory.state.z), np.asarray(seen.mass_positions_space)[:, 0]
    np.testing.assert_allclose(z[:, 0] + 1j * z[:, 1], rho * (turn - 1j), atol=1e-7)
    np.testing.assert_allclose(place[:, 0] + 1j * place[:, 1], s * turn, atol=1e-7)
    np.testing.assert_allclose(place[:, 2], -h, atol=1e-7)
    np.testing.assert_allclose(seen.angular_velocity_space[:, 2], 0.0, atol=1e-7)
    assert W * times[-1] > 2 * np.pi
