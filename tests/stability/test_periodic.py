"""Floquet multipliers against linearisations, Newton's and Euler's laws, Mathieu's functions, and quadrature."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from scipy.integrate import quad, solve_ivp
from scipy.spatial.transform import Rotation
from scipy.special import mathieu_a, mathieu_b

import jaxball
from jaxball.analysis.stability import periodic_motion, steady_rolling
from jaxball.physics.system import vector_field
from tests.support import newton_euler
from tests.support.differences import slope
from tests.support.robots import Carried, Chain, Joint, Moment, Robot, Setting
from tests.support.sentences import refuses, said

E2, E3 = np.eye(3)[1:]
WEIGHT, LENGTH, GRAVITY, STALL, FREE_SPEED = 0.8, 0.5, 10.0, 3.0, 4.0
SYMMETRIC, UNEQUAL = (0.6, 0.2, 0.6), (0.7, 0.3, 0.5)


def robot(moments, speed, rolling, spinning):
    """A ball that a pendulum drives, and its steady rolling: its weight at a sin α holds the torque c_r v."""
    ahead = np.arcsin(rolling * speed / (WEIGHT * GRAVITY * LENGTH))
    command = -(speed / FREE_SPEED + rolling * speed / STALL)
    motor = jaxball.physics.SpeedLimitedMotor(command, stall=STALL, free_speed=FREE_SPEED)
    ball = jaxball.Ball(
        mass=1.0,
        inertia=moments,
        gravity=GRAVITY,
        mechanisms=[jaxball.planar_pendulum(WEIGHT, LENGTH, drive=motor)],
        resistance=jaxball.Resistance(rolling=rolling, spinning=spinning),
    )
    return ball, jaxball.physics.ReducedState(Omega=speed * E2, Gamma=E3, theta=[-ahead], thetadot=[-speed])


def by_newton_and_euler(moments, speed, rolling, spinning):
    """ẋ of x = (Ω, Γ, θ, θ̇), where reactions and efforts are unknowns."""
    hinge = Joint("hinge", E2, np.zeros(3), free=True)
    chain = Chain((hinge,), (Carried(WEIGHT, -LENGTH * E3, 1),))
    body = Robot(1.0, np.array(moments), 1.0, np.zeros(3), (chain,))
    setting = Setting(g_space=-GRAVITY * E3, c_r=rolling, c_s=spinning)
    command = -(speed / FREE_SPEED + rolling * speed / STALL)

    def rate(x):
        Omega, Gamma, theta, thetadot = x[:3], x[3:6], x[6:7], x[7:]
        first = np.cross(E2, Gamma) / np.linalg.norm(np.cross(E2, Gamma))
        Lambda = np.stack([first, np.cross(Gamma, first), Gamma])
        q = np.roll(Rotation.from_matrix(Lambda).as_quat(), 1)
        torque = STALL * (command - thetadot / FREE_SPEED)
        moment = Moment(q, Omega, np.zeros(2), (theta,), (thetadot,), (torque,))
        answer = newton_euler.solve(body, setting, moment)
        return np.concatenate([answer.Omegadot, np.cross(Gamma, Omega), thetadot, answer.thetaddot[0]])

    return rate


def in_order(multipliers):
    multipliers = np.asarray(multipliers).astype(complex)
    return multipliers[np.lexsort((-multipliers.imag, -np.abs(multipliers).round(9)))]


def tangent(Gamma, *more):
    """A basis of deviations of (Ω, Γ, θ, θ̇) orthogonal to Γ and to more."""
    normal = np.concatenate([np.zeros(3), Gamma, np.zeros(2)])
    return np.linalg.svd(np.stack([normal, *more]))[2][1 + len(more) :]


@pytest.mark.long
@pytest.mark.parametrize(("speed", "rolling", "spinning"), [(1.5, 0.3, 0.3), (3.0, 0.3, 0.3), (2.0, 0.1, 0.0)], ids=str)
def test_a_symmetric_body_has_the_exponents_of_its_steady_motion(speed, rolling, spinning):
    """In axes that turn with the pendulum, steady rolling is an equilibrium of Newton's and Euler's laws.

    There θ is 0 at all times, and x˙ is that in the body less θ̇ E2 × of vectors. Differences over four points are
    good to about 1e-11.
    """
    case = (SYMMETRIC, speed, rolling, spinning)
    ahead = np.arcsin(rolling * speed / (WEIGHT * GRAVITY * LENGTH))
    steady = np.array([0, speed, 0, np.sin(ahead), 0, np.cos(ahead), 0, -speed])
    in_body = by_newton_and_euler(*case)

    def rate(x):
        return in_body(x) - np.concatenate([np.cross(x[7] * E2, x[:3]), np.cross(x[7] * E2, x[3:6]), [x[7], 0.0]])

    np.testing.assert_allclose(rate(steady), 0, atol=1e-12)
    h = 1e-3 * np.eye(8)
    J = np.stack([8 * (rate(steady + d) - rate(steady - d)) - rate(steady + 2 * d) + rate(steady - 2 * d) for d in h])
    J = J.T / 12e-3
    basis = tangent(steady[3:6], np.eye(8)[6])
    eigenvalues = np.linalg.eigvals(basis @ J @ basis.T)
    motion = periodic_motion(*robot(*case), period=6.0 / speed)
    assert motion.ok
    assert motion.turns == (-1,)
    assert motion.period == pytest.approx(2 * np.pi / speed, rel=1e-11)
    expected = in_order(np.exp(eigenvalues * 2 * np.pi / speed))
    np.testing.assert_allclose(in_order(motion.multipliers), expected, atol=1e-8)
    assert motion.growth == pytest.approx(np.max(eigenvalues.real), abs=1e-8)
    assert motion.stable == (motion.growth < 0)


@pytest.fixture(scope="module")
def wobbling():
    case = (UNEQUAL, 2.1, 0.2, 0.05)
    return case, periodic_motion(*robot(*case), period=3.0)


@pytest.mark.long
def test_an_unequal_body_has_the_multipliers_of_newton_and_euler(wobbling):
    """SciPy solves the two laws over a turn, from states at ±h on either side of the motion.

    Of the eight directions, that along Γ is of states of another |Γ|, and that along the motion is the shift in time.
    """
    case, motion = wobbling
    rate = by_newton_and_euler(*case)
    x = np.concatenate(
        [np.ravel(leaf) for leaf in (motion.state.Omega, motion.state.Gamma, motion.state.theta, motion.state.thetadot)]
    )

    def after_a_turn(start):
        start = start / np.concatenate([np.ones(3), np.full(3, np.linalg.norm(start[3:6])), np.ones(2)])
        run = solve_ivp(lambda t, x: rate(x), (0, motion.period), start, method="DOP853", rtol=1e-10, atol=1e-12)
        return run.y[:, -1]

    np.testing.assert_allclose(after_a_turn(x) - x, [0, 0, 0, 0, 0, 0, -2 * np.pi, 0], atol=1e-9)
    basis = tangent(x[3:6], rate(x))
    columns = [slope(lambda s, d=d: after_a_turn(x + s * d), 0.0, 1e-4, points=2) for d in basis]
    expected = in_order(np.linalg.eigvals(basis @ np.array(columns).T))
    assert abs(expected[0]) > 1.3
    np.testing.assert_allclose(in_order(motion.multipliers), expected, atol=1e-6)
    assert motion.kind == "saddle"
    assert motion.message == f"The motion is unstable, a saddle: deviations grow as exp({motion.growth:.6g} t)."


@pytest.mark.long
def test_the_product_of_the_multipliers_is_liouvilles(wobbling):
    """exp ∫ tr f′ along the motion; those along Γ and along the motion are 1."""
    case, motion = wobbling
    ball, _ = robot(*case)
    unravel = ravel_pytree(motion.state)[1]
    times = jnp.linspace(0.0, motion.period, 65)
    run = jaxball.simulate(ball, times, motion.state, rtol=1e-12, atol=1e-12, step_to_times=True)

    def trace(state):
        rates = jax.jacfwd(lambda x: ravel_pytree(vector_field(ball, jnp.array(0.0), unravel(x)))[0])
        return jnp.trace(rates(ravel_pytree(state)[0]))

    traces = np.asarray(jax.jit(jax.vmap(trace))(run.state))
    np.testing.assert_allclose(traces[0], traces[-1], atol=1e-9)
    product = np.exp(np.mean(traces[:-1]) * motion.period)  # the trapezoidal rule, exponentially good for a period
    assert np.prod(motion.multipliers).real == pytest.approx(product, rel=1e-7)


@pytest.mark.long
def test_rolling_in_circles_has_the_exponents_of_its_eigenvalues():
    """Ω and Γ of a Routh sphere turn about E3, after whose turn they come back: a motion that `steady_motion` knows."""
    masses = [jaxball.PointMass(m, jaxball.Fixed([0.0, 0.0, h])) for m, h in ((0.5, 0.6), (0.3, -0.2))]
    sphere = jaxball.Ball(mass=1.0, inertia=(0.5, 0.5, 0.7), offset=(0.0, 0.0, -0.15), gravity=2.0, masses=masses)
    steady = steady_rolling(sphere, inclination=0.4, precession=1.3)
    period = 2 * np.pi / abs(steady.turning)
    motion = periodic_motion(sphere, steady.state, period)
    assert motion.iterations <= 1
    assert motion.period == pytest.approx(period, rel=1e-10)
    expected = np.exp(steady.eigenvalues * period)
    turning = expected[np.abs(expected - 1) > 1e-3]
    assert len(turning) == 2
    for value in turning:
        assert np.min(np.abs(motion.multipliers - value)) < 1e-9
    # The others are those of families of circles and of the integrals, of which the shift in time is left out.
    assert np.sum(np.abs(motion.multipliers - 1) < 1e-5) == len(expected) - len(turning) - 1
    assert motion.kind == "centre"


LOW, DISK = 0.2, 0.36
ROCKING = LOW / (DISK + (1 - LOW) ** 2)  # ω₀² for m = r = g = 1


def shaken(amplitude, frequency):
    """A disk that is heavier below, on a plane with Z = A sin νt: φ¨ + ω₀² (1 − A ν² sin νt) φ = 0 near rest."""
    path = jaxball.HarmonicSeries(jnp.zeros(3), amplitude * jnp.eye(3)[2:], jnp.stack([frequency]))
    ground = jaxball.Ground(motion=jaxball.Oscillating(path))
    return jaxball.Disk(mass=1.0, inertia=DISK, offset=(0.0, 0.0, -LOW), ground=ground)


@pytest.mark.thorough
@pytest.mark.parametrize(("border", "q"), [(mathieu_b, 0.3), (mathieu_a, 0.3), (mathieu_b, 0.7)])
def test_a_shaken_disk_is_at_the_border_where_mathieus_functions_have_it(border, q):
    """With τ = νt/2, a = 4 ω₀²/ν² and 2q = a A ν²: both multipliers are −1 at a = a₁(q) and at a = b₁(q).

    They are a double one there, and their sum is the well-conditioned number.
    """
    a = border(1, q)
    frequency = 2 * np.sqrt(ROCKING / a)
    amplitude = 2 * q / (a * frequency**2)
    motion = periodic_motion(shaken(amplitude, frequency), jaxball.DiskState(phi=0.1), 2 * np.pi / frequency)
    assert motion.ok
    np.testing.assert_allclose(motion.state.phi, 0, atol=1e-9)
    assert np.sum(motion.multipliers).real == pytest.approx(-2, abs=1e-8)
    inside = periodic_motion(shaken(amplitude, 2 * np.sqrt(ROCKING)), jaxball.DiskState(), np.pi / np.sqrt(ROCKING))
    assert inside.kind == "saddle"
    assert "t), changing sign each period." in inside.message


@pytest.mark.long
def test_the_shaken_ball_of_the_gallery_grows_as_hills_equation_says():
    """About both axes; SciPy solves φ¨ + ω₀² (1 − sin νt ν²/g) φ = 0 over a period of the plane."""
    scenario = jaxball.load_scenario("vibrating-plane")
    period = 2 * np.pi / 2.8
    squared = 9.8 * 0.2 / (0.36 + 0.8**2)

    def rate(t, y):
        return [y[1], -squared * (1 - 2.8**2 / 9.8 * np.sin(2.8 * t)) * y[0]]

    columns = [solve_ivp(rate, (0, period), y, rtol=1e-12, atol=1e-13, method="DOP853").y[:, -1] for y in np.eye(2)]
    expected = in_order(np.linalg.eigvals(np.array(columns).T))
    motion = periodic_motion(scenario.system, jaxball.BallState(), period)
    assert motion.kind == "saddle"
    rocking = motion.multipliers[[0, 1, -2, -1]]
    np.testing.assert_allclose(rocking, np.repeat(expected, 2), atol=1e-8)
    # The others are those of heading and spin about the vertical, one of which drives the other.
    np.testing.assert_allclose(motion.multipliers[2:-2], 1, atol=1e-5)
    assert len(motion.multipliers) == 6


def quadrature(phi, phidot):
    """T = ∫ dφ / φ˙ at the energy ½ J(φ) φ˙² − m g c cos φ of a state, with J about the contact point."""

    def inertia(phi):
        return DISK + 1 + LOW**2 - 2 * LOW * np.cos(phi)

    energy = 0.5 * inertia(phi) * phidot**2 - LOW * np.cos(phi)
    if energy > LOW:
        return quad(lambda phi: np.sqrt(inertia(phi) / (2 * (energy + LOW * np.cos(phi)))), 0, 2 * np.pi)[0]
    k = np.sqrt((energy + LOW) / (2 * LOW))  # sin of half the largest angle; sin φ/2 = k sin u

    def pace(u):
        half = np.arcsin(k * np.sin(u))
        return np.sqrt(inertia(2 * half) / LOW) / np.cos(half)

    return 4 * quad(pace, 0, np.pi / 2)[0]


@pytest.mark.thorough
@pytest.mark.parametrize(("phi", "phidot", "turns"), [(0.9, 0.0, 0), (0.0, 1.2, 1), (0.0, -1.2, -1)])
def test_a_free_disk_has_the_period_of_a_quadrature(phi, phidot, turns):
    """It rocks, or rolls round either way, at the energy of the motion of its family that is found."""
    disk = jaxball.Disk(mass=1.0, inertia=DISK, offset=(0.0, 0.0, -LOW))
    motion = periodic_motion(disk, jaxball.DiskState(phi=phi, phidot=phidot), 1.02 * quadrature(phi, phidot))
    assert motion.ok
    assert motion.turns == (turns,)
    found = quadrature(float(motion.state.phi), float(motion.state.phidot))
    assert motion.period == pytest.approx(found, rel=1e-8)
    # A family by energy, and its shift in time, which is left out.
    np.testing.assert_allclose(motion.multipliers, [1], atol=1e-8)
    assert motion.kind == "centre"


@pytest.mark.long
def test_what_is_not_found_is_said():
    disk = jaxball.Disk(mass=1.0, inertia=DISK, offset=(0.0, 0.0, -LOW))
    rolling = jaxball.DiskState(phidot=1.2)
    wrong = periodic_motion(disk, rolling, 5.5, turns=[2], iterations=2)
    assert not wrong.ok
    assert not wrong.stable
    assert wrong.kind == "unknown"
    assert np.all(np.isnan(wrong.multipliers))
    assert "No periodic motion was found near the state: after 2 steps of Newton's method it fails" in wrong.message
    short = periodic_motion(disk, rolling, 5.5, max_steps=2)
    said(short.message, "max_steps")
    rest = periodic_motion(disk, jaxball.DiskState(phi=0.0), 5.0)
    said(rest.message, "steady_motion")
    impossible = periodic_motion(jaxball.Disk(mass=-1.0, inertia=DISK), rolling, 5.5)
    said(impossible.message)


@pytest.mark.thorough
def test_wrong_arguments():
    disk = jaxball.Disk(mass=1.0, inertia=DISK, offset=(0.0, 0.0, -LOW))
    with refuses(ValueError, "period"):
        periodic_motion(disk, jaxball.DiskState(), -1.0)
    with refuses(ValueError, "period"):
        periodic_motion(shaken(0.3, 0.9), jaxball.DiskState(phi=0.1), 5.0)
    for turns in ([1, 2], [0.5]):
        with refuses(ValueError, "turns"):
            periodic_motion(disk, jaxball.DiskState(), 5.0, turns=turns)
    sprung = jaxball.planar_pendulum(0.5, 0.5, drive=jaxball.Spring(stiffness=1.0))
    robot = jaxball.Disk(mass=1.0, inertia=DISK, mechanisms=[sprung])
    state = jaxball.DiskState(phidot=1.0, theta=[0.1], thetadot=[0.0])
    with refuses(ValueError, "turns[1]"):
        periodic_motion(robot, state, 5.0, turns=[0, 1])
    with refuses(TypeError, "DiskState"):
        periodic_motion(disk, jaxball.BallState(), 5.0)
