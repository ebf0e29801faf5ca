"""Published rolling robots among the built-in scenarios do what is known of them in closed form.

Runs are solved to 1e-10 at least. States at the save times are interpolated between steps, which costs a factor of a
hundred or so.
"""

import tomllib

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxball import jit
from jaxball.files.scenario import read_document
from jaxball.files.scenario.sources import builtin_text
from jaxball.physics import vector_field

from .runs import rolling_run


@pytest.mark.long
def test_three_rotors_roll_the_ball_from_rest_to_rest():
    """Ω = −(K + M r² Γ(Γ·K) / (D − C)) / (D − C + M r²), with K_a the impulse of motor a so far.

    The whole inertia is D = 0.4 + 2 C, with C = 0.05 of each ring, and M = 1.6.
    """
    trajectory, times, seen = rolling_run("three-rotors")
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


@pytest.mark.thorough
def test_a_ball_on_a_turntable_goes_round_at_two_sevenths_of_its_rate():
    """ż turns at 2/7 W from ż(0) = r Ω × e3 + W e3 × (z − c), and Ω₃ stays."""
    trajectory, times, seen = rolling_run("turntable")
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


@pytest.mark.thorough
def test_a_shaken_ball_rocks_up_as_mathieus_equation_says():
    """While it rocks by less than 0.1, the equation is good to φ², 1e-2 of what it says.

    Growth by exp(h ω₀ t / 4), with h = 0.8 of g and ω₀ = 1.4, is the first order in h.
    """
    _, times, seen = rolling_run("vibrating-plane")
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


@pytest.mark.long
def test_an_axisymmetric_pendulum_goes_round_steadily():
    """w is that of the document, and the radius of the centre's circle is m l sin a / (m + mc).

    By Newton and Euler in the axes of the common centre of mass, in which the pivot is a sled of mass mc = m0 + d / r².
    """
    trajectory, times, seen = rolling_run("axisymmetric-pendulum")
    m, l, a, s, mc, C, i = 0.6, 0.5, 0.6, 4.0, 1.0 + 0.4, 0.6 * 0.3**2, 0.6 * 0.3**2 / 2
    A, B = (i + m * l**2 * mc / (m + mc)) * np.cos(a), C * s
    turn = np.exp(1j * (-B + np.sqrt(B**2 + 4 * A * m * l)) / (2 * A) * times)
    ring = np.mean(np.asarray(seen.mass_positions_space), axis=1)
    np.testing.assert_allclose(ring[:, 2], -l * np.cos(a), atol=1e-7)
    np.testing.assert_allclose(ring[:, 0] + 1j * ring[:, 1], l * np.sin(a) * turn, atol=1e-7)
    z = np.asarray(trajectory.state.z)
    np.testing.assert_allclose(z[:, 0] + 1j * z[:, 1], m * l * np.sin(a) / (m + mc) * (1 - turn), atol=1e-7)


@pytest.mark.long
def test_an_axisymmetric_pendulum_drives_a_ball_up_a_slope():
    """z = −½ A t², with the rod at the angle b uphill from the normal, by Newton and Euler.

    On the ball as a sled of mass mc = m0 + d / r² pull the pendulum's weight and the motor's Q / r. In the axes of the
    sled gravity is (g sin a + A, 0, −g cos a), whose torque on the pendulum is Q, so that nothing turns the spin.
    """
    trajectory, times, seen = rolling_run("axisymmetric-pendulum-on-a-slope")
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


@pytest.mark.long
def test_the_spin_of_a_gyroscopic_pendulum_is_the_impulse_of_its_motor():
    """C (n·ω) = ∫Q, with the rod n and ω = Ω + θ̇₁ E₂ + θ̇₂ w₂ + θ̇₃ n of the ring, all in body axes."""
    trajectory, times, seen = rolling_run("gyroscopic-pendulum")
    (t1, t2, _), rates = np.asarray(seen.joint_angles).T, np.asarray(seen.joint_rates)
    second = np.stack([np.cos(t1), 0 * t1, -np.sin(t1)], axis=1)
    rod = -np.stack([np.sin(t1) * np.cos(t2), -np.sin(t2), np.cos(t1) * np.cos(t2)], axis=1)
    omega = trajectory.state.Omega + rates[:, :1] * [0, 1, 0] + rates[:, 1:2] * second + rates[:, 2:] * rod
    impulse = np.interp(times, [0, 5, 10], [0, 1.0, 0.75])
    np.testing.assert_allclose(0.8 * 0.4**2 * np.sum(omega * rod, axis=1), impulse, atol=1e-7)
    ring = np.mean(np.asarray(seen.mass_positions_body), axis=1)
    np.testing.assert_allclose(ring, 0.4 * rod, atol=1e-12)
    assert np.linalg.norm(trajectory.state.z[-1]) > 0.2


@pytest.mark.long
def test_moball_rests_where_the_sum_of_its_forces_points_down():
    """At rest κ θ_j = Q_j − m g Γ·n_j, and Σ m θ_j n_j points down. With Σ n_j n_j = 2·1, so does Σ Q_j n_j.

    The ball is damped almost as much as makes it rest soonest, and its swing dies at a rate of about 0.4.
    """
    trajectory, _, seen = rolling_run("moball")
    f = np.array([4.0, 2.0, -3.0])
    G = np.asarray(seen.vertical_body)[-1]
    np.testing.assert_allclose(G, -f / np.linalg.norm(f), atol=1e-3)
    along = np.stack([f, -f], axis=1).ravel() / 2
    weight = 0.3 * 10 * np.stack([G, -G], axis=1).ravel()
    np.testing.assert_allclose(seen.joint_angles[-1], (along - weight) / 20, atol=1e-3)
    assert np.linalg.norm(trajectory.state.Omega[-1]) < 1e-3


@pytest.mark.long
def test_roboball_rolls_at_the_speed_at_which_motor_weight_and_resistance_balance():
    """3 (1 − v/4) = v + 0.02 M g r, and the pendulum stays where its weight has this torque; M g r = 18.

    The ball nears this at a rate of about (1 + 3/4) / (0.6 + 1.8), so e^−14 of it is missing; the smoothing of the dry
    friction leaves out 1e-6 / (2 v²) of it.
    """
    trajectory, _, seen = rolling_run("roboball")
    v = (3 - 0.02 * 18) / (1 + 3 / 4)
    torque = 3 * (1 - v / 4)
    np.testing.assert_allclose(trajectory.state.Omega[-1], [0, v, 0], atol=1e-5)
    np.testing.assert_allclose(seen.mass_positions_space[-1, 0, 0], torque / (0.8 * 10), atol=1e-5)
    np.testing.assert_allclose(seen.joint_efforts[-1], [-torque], atol=1e-5)


@pytest.mark.long
def test_roboball_2_swings_until_friction_holds_both_joints():
    """While both stick it is a rigid ball that rolls, so its energy stays, and neither effort passes 0.7 N m."""
    trajectory, times, seen = rolling_run("roboball-2")
    stuck = np.all(np.asarray(trajectory.history.sticks), axis=1)
    assert stuck[-1]
    assert times[stuck][0] < 5.0
    assert np.all(stuck[times > 5.0])
    energy = np.asarray(seen.kinetic_energy + seen.potential_energy)
    np.testing.assert_allclose(energy[stuck], energy[-1], rtol=1e-9)
    assert energy[0] - energy[-1] > 1.0
    assert np.abs(seen.joint_efforts[stuck]).max() < 0.7


@pytest.mark.thorough
def test_spokes_keep_the_momentum_of_a_balanced_ball():
    """(J + M r²) ω_h and J ω₃ stay, with J = 0.4 + 4/3 θ² of the four masses of 0.5 at θ from the centre."""
    trajectory, times, seen = rolling_run("spokes")
    theta = 0.5 + 0.4 * np.sin(times)
    J, omega = 0.4 + 4 / 3 * theta[:, None] ** 2, np.asarray(seen.angular_velocity_space)
    momentum = (J + np.array([3.0, 3.0, 0.0])) * omega
    at_start = (0.4 + 1 / 3 + np.array([3.0, 3.0, 0.0])) * [0.2, 0.5, 0.3]
    np.testing.assert_allclose(momentum - at_start, 0.0, atol=1e-8)
    np.testing.assert_allclose(np.asarray(trajectory.state.z) @ np.array([0.2, 0.5]), 0.0, atol=1e-8)


@pytest.mark.thorough
def test_a_pendulum_held_to_the_side_leads_the_ball_round_a_circle():
    """Of radius ρ, with the pendulum at s < 0 outward of the centre and h below it, and no spin about the vertical.

    The yoke's axis is along e3 + (ρ / r) e_ρ, and the torques about the tangent are in balance where
    s m g = W² ((m h − m r)(ρ + s) − (d / r + m0 r) ρ).
    """
    trajectory, times, seen = rolling_run("pendulum-and-yoke")
    s, h, rho, m = -0.5 * np.sin(0.3), 0.5 * np.cos(0.3), 2.0, 0.8
    W = np.sqrt(s * m * 10 / ((m * h - m) * (rho + s) - (0.4 + 1) * rho))
    turn = 1j * np.exp(1j * W * times)
    z, place = np.asarray(trajectory.state.z), np.asarray(seen.mass_positions_space)[:, 0]
    np.testing.assert_allclose(z[:, 0] + 1j * z[:, 1], rho * (turn - 1j), atol=1e-7)
    np.testing.assert_allclose(place[:, 0] + 1j * place[:, 1], s * turn, atol=1e-7)
    np.testing.assert_allclose(place[:, 2], -h, atol=1e-7)
    np.testing.assert_allclose(seen.angular_velocity_space[:, 2], 0.0, atol=1e-7)
    assert W * times[-1] > 2 * np.pi


@pytest.fixture(scope="module")
def yoke_robot():
    return rolling_run("yoke-robot")


def yoke_alone(t, y):
    """(place, shell's angle, angle of what hangs in it, and both rates) while the yoke turns in a plane, by Lagrange.

    T = ½ (j + m r²) ψ̇² + ½ I φ̇² − m_p r l cos φ ψ̇ φ̇, V = −m_p g l cos φ, for the pendulum's centre of mass l below.
    """
    phi, psidot, phidot = y[2:]
    m, r, l, g = 17.0, 0.3, 0.1, 9.81
    I = (2 / 6 + 5 / 2) * 0.2**2 + 0.2**2 / 3
    torque = 0.1 * (t < 8.0) - 0.04 * (phidot - psidot)
    coupling = r * l * np.cos(phi)
    mass = [[0.12 + m * r**2, -coupling], [-coupling, I]]
    force = [-torque - 0.16 * psidot - r * l * np.sin(phi) * phidot**2, torque - g * l * np.sin(phi)]
    return [-r * psidot, psidot, phidot, *np.linalg.solve(mass, force)]


@pytest.mark.long
def test_the_yoke_alone_rolls_the_robot_in_a_plane(yoke_robot):
    """Before the pendulum is driven, against Lagrange's equations of two angles, solved up to the jump and on."""
    trajectory, times, _ = yoke_robot
    before = times < 15.9
    known, state = [], np.zeros(5)
    for start, end in ((0.0, 8.0), (8.0, 15.5)):
        at = times[before & (times >= start) & (times <= end)]
        solved = solve_ivp(yoke_alone, (start, end - 1e-12), state, rtol=1e-11, atol=1e-13, dense_output=True)
        known.append(solved.sol(np.minimum(at, end - 1e-12)) if start == 0.0 else solved.sol(at)[:, 1:])
        state = solved.y[:, -1]
    y, psi, phi = np.concatenate(known, axis=1)[:3]
    np.testing.assert_allclose(trajectory.state.z[before], np.stack([0 * y, y], axis=1), atol=1e-8)
    np.testing.assert_allclose(trajectory.state.theta[before, 0], phi - psi, atol=1e-7)


@pytest.mark.thorough
def test_the_yoke_robot_goes_where_its_authors_equations_take_it(yoke_robot):
    """At 10, 20, …, 50 s, by the author's equations with their Euler steps of 10, 5 and 2.5 ms, whose errors of first
    and second order are extrapolated to 0; 5, 2.5 and 1.25 ms give the same to 1e-4, a third of which may be left.
    """
    known = [
        [0.0, 0.5945982],
        [0.0881762, 1.0198676],
        [0.2742601, 0.9136166],
        [0.3450442, 0.3204261],
        [0.2380404, -0.4643163],
    ]
    np.testing.assert_allclose(yoke_robot[0].state.z[20:101:20], known, atol=3e-5)


@pytest.mark.long
def test_norma_accelerates_evenly_and_then_turns_to_its_slider():
    """α = τ / ((2/3) m r² + M r²) with the torque τ = 0.2 and M = 5, until the slider moves."""
    trajectory, times, _ = rolling_run("norma")
    alpha, z = 0.2 / (2 / 3 * 3 * 0.2**2 + 5 * 0.2**2), np.asarray(trajectory.state.z)
    even = times <= 3.0
    np.testing.assert_allclose(z[even], np.outer(0.2 * alpha * times[even] ** 2 / 2, [1, 0]), atol=1e-9)
    heading = np.unwrap(np.arctan2(*np.diff(z[times >= 5.0], axis=0).T[::-1]))
    assert np.all(np.diff(heading) > 0)  # to the left, where the slider is
    assert heading[-1] > 0.5


@pytest.mark.thorough
def test_norma_rests_where_its_slider_leans_it():
    """tan φ = m_s d / (m_p L), where the weights of slider and pendulum are in balance in the authors' equations."""
    document = tomllib.loads(builtin_text("norma"))
    del document["mechanisms"][0]["joints"][0]["force"]
    document["mechanisms"][1]["joints"][0]["schedule"] = {"kind": "constant-rate", "theta": 0.05}
    lean = np.arctan(1.0 * 0.05 / (1.0 * 0.15))
    document["initial"] = {"axis": [1.0, 0.0, 0.0], "angle": -lean, "theta": [0.0], "thetadot": [0.0]}
    scenario = read_document(document)
    rates = jit(vector_field)(scenario.system, jnp.array(0.0), scenario.state)
    np.testing.assert_allclose(np.concatenate([rates.Omega, rates.thetadot]), 0.0, atol=1e-13)


@pytest.mark.long
def test_rotunbot_turns_by_what_its_flywheel_takes():
    """(J + C) ω₃ + C θ̇ = 0 of the flywheel, C = m R², and all else, J; then it drives straight on, while the momentum
    of the shell and of the pendulum's place, (d + M r²) ω − m l r cos φ φ̇, is the impulse of the motor.
    """
    trajectory, times, seen = rolling_run("rotunbot")
    z, rates, angles = np.asarray(trajectory.state.z), np.asarray(seen.joint_rates), np.asarray(seen.joint_angles)
    omega = np.asarray(seen.angular_velocity_space)
    J, C, d = 2 / 3 * 27.8 * 0.4**2 + 20.4 * 0.25**2, 9.81 * 0.2**2, 2 / 3 * 27.8 * 0.4**2
    np.testing.assert_allclose((J + C) * omega[:, 2] + C * rates[:, 2], 0.0, atol=1e-8)
    torque = J * np.pi / 8
    turned = torque / J * np.array([0.5, 2.0])  # after 1 and 2 s
    headings = np.arctan2(*trajectory.state.Lambda[[20, 40], :2, 0].T[::-1])
    np.testing.assert_allclose(headings, turned, atol=1e-8)
    np.testing.assert_allclose(z[:, 0], 0.0, atol=1e-8)  # a right angle after 4 s
    assert z[-1, 1] > 5.0
    driving, M = times >= 4.0, 27.8 + 20.4 + 82.8 + 9.81
    roll = -omega[driving, 0]
    phi_rate = roll + rates[driving, 0]
    phi = angles[driving, 0] + z[driving, 1] / 0.4
    momentum = (d + M * 0.4**2) * roll - 82.8 * 0.27 * 0.4 * np.cos(phi) * phi_rate
    np.testing.assert_allclose(momentum, 20.0 * (times[driving] - 4.0), atol=1e-5)
