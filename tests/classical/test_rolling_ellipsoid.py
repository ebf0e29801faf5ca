"""An ellipsoid that rolls: against the ball, Newton's laws with an unknown reaction, and closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Ball, BallState, Resistance
from jaxball.physics.classical import EllipsoidState, RollingEllipsoid
from jaxball.physics.dynamics.locked import reaction
from tests.support.differences import slope

Q = np.array([0.6, 0.2, -0.5, 0.3]) / np.linalg.norm([0.6, 0.2, -0.5, 0.3])
OMEGA = (0.7, -1.1, 0.4)
NOW = jnp.array(0.0)
E3 = np.array([0.0, 0.0, 1.0])


RESISTING = Resistance(rolling=0.2, spinning=0.3, drag=0.1, rotational_drag=0.05, dry=0.04, smoothing=0.3)


@pytest.mark.thorough
@pytest.mark.parametrize("gravity", [9.8, -9.8])
@pytest.mark.parametrize("resistance", [None, RESISTING], ids=["alone", "resisted"])
def test_with_equal_semiaxes_it_is_the_ball(resistance, gravity):
    """Up to rounding, of which some tens add up in either; also where the plane would have to pull."""
    same = {"mass": 1.3, "inertia": (0.9, 1.0, 1.1), "offset": (0.1, -0.2, 0.15), "gravity": gravity}
    same["resistance"] = resistance
    ball, ellipsoid = Ball(radius=0.8, **same), RollingEllipsoid(semiaxes=(0.8, 0.8, 0.8), **same)
    rolling, state = BallState(Q, OMEGA), EllipsoidState(Q, OMEGA)
    expected, found = (
        jaxball.physics.vector_field(ball, NOW, rolling),
        jaxball.physics.vector_field(ellipsoid, NOW, state),
    )
    for name in ("q", "Omega", "z"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-13, atol=1e-13)
    R, force = ellipsoid.reaction(NOW, state), reaction(ball.prepare(), NOW, rolling)
    np.testing.assert_allclose([R[2], R[0] ** 2 + R[1] ** 2], [force.normal, force.friction_squared], rtol=1e-13)
    assert np.sign(R[2]) == np.sign(gravity)
    power = jaxball.observe(ball, NOW, rolling).dissipation
    np.testing.assert_allclose(ellipsoid.dissipation(NOW, state), power, rtol=1e-13)


def test_against_newtons_laws_with_an_unknown_reaction():
    """In space axes, with the nine unknowns of both accelerations and the reaction, whose point moves as it rolls.

    The velocity of the contact point's particle stays 0, and its rate is found by a difference, to some 1e-9. All parts
    of resistance act, the dry one in proportion to the normal force.
    """
    m, g, turn, offset = 1.3, 9.8, 0.4, np.array([0.1, -0.2, 0.15])
    semiaxes, moments = np.array([0.9, 0.7, 0.5]), (0.5, 0.6, 0.7)
    shape = {"mass": m, "semiaxes": semiaxes, "inertia": moments, "turn": turn, "offset": offset, "gravity": g}
    body = RollingEllipsoid(**shape, resistance=RESISTING)
    state = EllipsoidState(Q, OMEGA)
    Lambda, omega = np.asarray(state.Lambda), np.asarray(state.Lambda) @ OMEGA
    axes = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    J = Lambda @ axes @ np.diag(moments) @ axes.T @ Lambda.T

    def lowest(Lambda):
        """From the centre of mass to the lowest point, by its place on the surface A u with u on the unit sphere."""
        normal = semiaxes * (Lambda.T @ -E3)
        return Lambda @ (semiaxes * normal / np.linalg.norm(normal) - offset)

    def hat(w):
        return np.cross(w, np.eye(3)).T

    h, s = 1e-6, lowest(Lambda)
    turned = [jax.scipy.linalg.expm(jnp.asarray(hat(omega) * t)) @ Lambda for t in (h, -h)]
    sdot = (lowest(np.asarray(turned[0])) - lowest(np.asarray(turned[1]))) / (2 * h)
    # v + ω × s = 0 at all times: v̇ + ω̇ × s + ω × ṡ = 0.
    none, one = np.zeros((3, 3)), np.eye(3)
    flat, centre = omega * [1.0, 1.0, 0.0], -Lambda @ offset
    drag = -0.1 * np.cross(omega, centre - s)
    dry = -0.04 * (centre - s)[2] * flat / np.sqrt(flat @ flat + 0.3**2)  # over the normal force
    torque = -0.2 * flat - 0.3 * omega[2] * E3 - 0.05 * omega + np.cross(centre, drag)
    matrix = np.block([[m * one, none, -one], [none, J, -hat(s) - np.outer(dry, E3)], [one, -hat(s), none]])
    right = np.concatenate([drag - m * g * E3, torque - np.cross(omega, J @ omega), -np.cross(omega, sdot)])
    found = np.linalg.solve(matrix, right)
    np.testing.assert_allclose(Lambda @ np.asarray(body.field(NOW, state).Omega), found[3:6], atol=1e-7)
    np.testing.assert_allclose(body.reaction(NOW, state), found[6:], atol=1e-7)


@pytest.mark.thorough
def test_a_body_on_its_end_rocks_like_a_cradle():
    """About E2, ω² = m g (ρ − h) / (d2 + m h²) with the radius of curvature ρ = a1²/a3 at the height h = a3."""
    body = RollingEllipsoid(mass=1.3, semiaxes=(0.9, 0.7, 0.5), inertia=(0.2, 0.3, 0.35), gravity=9.8)

    def tilted(angle):
        q = jnp.stack([jnp.cos(angle / 2), jnp.zeros(()), jnp.sin(angle / 2), jnp.zeros(())])
        return body.field(NOW, EllipsoidState(q)).Omega[1]

    expected = 1.3 * 9.8 * (0.9**2 / 0.5 - 0.5) / (0.3 + 1.3 * 0.5**2)
    np.testing.assert_allclose(jax.grad(tilted)(jnp.array(0.0)), -expected, rtol=1e-13)


@pytest.mark.thorough
def test_a_spheroid_rolls_steadily_around_a_circle():
    """Where the torque of the reaction is the rate of the angular momentum, in axes that turn with the axis.

    The axis of the body is tilted by α, it precesses at the rate W, and ω = W e3 + ν k: for each W there is a ν, from
    a linear equation, as the torque has only the component across both.
    """
    m, g, alpha, W, semiaxes, moments = 1.0, 1.0, 1.2, 0.9, np.array([1.0, 1.0, 0.6]), np.array([0.3, 0.3, 0.45])
    k = np.array([np.sin(alpha), 0.0, np.cos(alpha)])
    height = np.sqrt((1.0 * np.sin(alpha)) ** 2 + (0.6 * np.cos(alpha)) ** 2)
    across = np.array([np.cos(alpha), 0.0, -np.sin(alpha)])
    s = -(0.6**2 * (k @ E3) * k + 1.0 * (across @ E3) * across) / height

    def missing(nu):
        omega = W * E3 + nu * k
        L = moments[0] * (omega - (omega @ k) * k) + moments[2] * (omega @ k) * k
        R = m * (np.cross(W * E3, np.cross(s, omega)) + g * E3)
        return (np.cross(s, R) - np.cross(W * E3, L))[1]

    nu = -missing(0.0) / (missing(1.0) - missing(0.0))
    q = np.array([np.cos(alpha / 2), 0.0, np.sin(alpha / 2), 0.0])
    body = RollingEllipsoid(mass=m, semiaxes=semiaxes, inertia=moments, gravity=g)
    start = EllipsoidState(q, W * np.array([-np.sin(alpha), 0.0, np.cos(alpha)]) + nu * E3)
    run = jaxball.simulate(body, np.linspace(0.0, 2 * np.pi / W, 401), start, throw=True)
    # Errors of the solve, which grow slowly where steady rolling is stable.
    np.testing.assert_allclose(run.state.Gamma[:, 2], np.cos(alpha), atol=1e-8)
    np.testing.assert_allclose(run.state.z[-1], start.z, atol=1e-8)
    assert float(jnp.ptp(run.laws.energy)) < 1e-8


def back(semiaxes=(0.2, 0.03, 0.02)):
    """The rattleback of Kane and Levinson, whose principal axes of inertia are turned by 0.8 degrees."""
    A, B, C, D = 2e-4, 1.6e-3, 1.7e-3, 2e-5
    mean, half = (A + B) / 2, np.hypot((B - A) / 2, D)
    turn = np.arctan2(2 * D, B - A) / 2
    inertia = (mean - half, mean + half, C)
    return RollingEllipsoid(semiaxes=semiaxes, inertia=inertia, turn=turn, offset=(0.0, 0.0, -0.01), gravity=9.81)


def rocking(spin):
    """Spun on its back, tilted by half a degree."""
    tilt = np.deg2rad(0.5)
    return EllipsoidState((np.cos(tilt / 2), np.sin(tilt / 2), 0.0, 0.0), (0.0, 0.0, spin))


@pytest.fixture(scope="module")
def rattleback():
    times = np.linspace(0.0, 8.0, 401)
    return {spin: jaxball.simulate(back(), times, rocking(spin), throw=True) for spin in (5.0, -5.0)}


def test_a_rattleback_spun_against_its_sense_turns_back(rattleback):
    """Without loss of energy, and one that spins in its sense goes on."""
    spins = {spin: np.asarray(run.state.Omega[:, 2]) for spin, run in rattleback.items()}
    assert spins[5.0].min() > 4.9
    assert spins[-5.0].max() > 4.9
    for run in rattleback.values():
        energy = np.asarray(run.laws.energy)
        np.testing.assert_allclose(energy, energy[0], rtol=1e-8)  # some hundred steps with errors of 1e-10 each


@pytest.mark.long
def test_a_gradient_through_the_reversal_of_a_rattleback():
    """Of the spin at a time when it turns, along the semi-axes, against a difference over two points."""

    def spin(scale):
        body = back(semiaxes=scale * np.array([0.2, 0.03, 0.02]))
        return jaxball.simulate(body, (0.0, 1.0), rocking(-5.0)).state.Omega[-1, 2]

    one = jnp.array(1.0)
    found = jaxball.jit(jax.grad(spin))(one)
    np.testing.assert_allclose(found, slope(jaxball.jit(spin), one, 1e-5, points=2), rtol=1e-4)


def test_what_no_ellipsoid_can_be():
    body = RollingEllipsoid(semiaxes=(1.0, 0.0, 1.0), inertia=(1.0, 1.0, 3.0), offset=(0.0, 0.0, 2.0))
    assert [problem.split("`")[1] for problem in jaxball.problems(body)] == ["semiaxes", "inertia", "offset"]
