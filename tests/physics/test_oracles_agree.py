"""Two independent versions of the mechanics agree with each other and with closed forms.

Lagrange's equations with multipliers and Newton's and Euler's laws, link by link, share no equation. Each solves a
dense system and refines once. In two thousand cases they differed by up to 6e-13 of the largest number of a kind.
"""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.support import lagrange, newton_euler
from tests.support.robots import (
    Carried,
    Chain,
    Joint,
    Moment,
    Robot,
    Setting,
    random_moment,
    random_robot,
    random_setting,
)

ROUNDING = 1e-12
LAWS = {"Lagrange": lagrange.solve, "Newton and Euler": newton_euler.solve}
E1, E2, E3 = np.eye(3)
ORIGIN = np.zeros(3)
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])

by_each = pytest.mark.parametrize("solve", LAWS.values(), ids=LAWS)


def random_case(seed, **options):
    rng = np.random.default_rng(seed)
    robot = random_robot(rng, **options)
    return robot, random_setting(rng), random_moment(rng, robot)


def columns(answer):
    """Each kind of quantity, in one array."""
    joints = [np.concatenate([np.zeros(1), *values]) for values in (answer.thetaddot, answer.efforts)]
    return [answer.Omegadot, answer.zddot, answer.R, *joints]


def assert_same(found, expected, bound=ROUNDING):
    for a, b in zip(columns(found), columns(expected), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=bound * max(1.0, np.abs(b).max()))


def assert_close(found, expected, bound=ROUNDING):
    np.testing.assert_allclose(found, expected, rtol=0, atol=bound * max(1.0, np.abs(expected).max()))


def rolling_ball(d=0.6, mass=1.3, radius=0.9, **inside):
    """A homogeneous ball, with the ratio k = d/(Mr²) of the shell alone."""
    return Robot(mass, np.full(3, d), radius, ORIGIN, **inside), d / (mass * radius**2)


def random_motion(rng):
    q = rng.normal(size=4)
    return Moment(q / np.linalg.norm(q), rng.normal(size=3), rng.normal(size=2))


def in_space(moment):
    return Rotation.from_quat(np.roll(moment.q, -1)).as_matrix()


@pytest.mark.long
@pytest.mark.parametrize("seed", range(20))
def test_the_two_versions_agree(seed):
    case = random_case(seed)
    assert_same(lagrange.solve(*case), newton_euler.solve(*case))


def test_what_is_drawn_has_every_kind():
    """Hinges and sliders, free and given, in chains of one, two and three; fixed masses or none."""
    robots = [random_case(seed)[0] for seed in range(20)]
    chains = [chain for robot in robots for chain in robot.chains]
    assert {(joint.kind, joint.free) for chain in chains for joint in chain.joints} == {
        (kind, free) for kind in ("hinge", "slider") for free in (True, False)
    }
    assert {len(chain.joints) for chain in chains} == {len(chain.masses) for chain in chains} == {1, 2, 3}
    assert {len(robot.chains) for robot in robots} == {1, 2, 3}
    assert {len(robot.still) for robot in robots} == {0, 1, 2}


@pytest.mark.long
@by_each
def test_efforts_of_given_joints_move_free_ones_alike(solve):
    """What is given and what is found change places, for all joints or for some."""
    for seed in range(5):
        robot, setting, moment = random_case(seed)
        expected = solve(robot, setting, moment)
        swapped = tuple(
            dataclasses.replace(c, joints=tuple(dataclasses.replace(j, free=not j.free) for j in c.joints))
            for c in robot.chains
        )
        given = tuple(
            np.array([q if joint.free else a for joint, a, q in zip(chain.joints, *values, strict=True)])
            for chain, *values in zip(swapped, expected.thetaddot, expected.efforts, strict=True)
        )
        found = solve(dataclasses.replace(robot, chains=swapped), setting, dataclasses.replace(moment, given=given))
        assert_same(found, expected)


@pytest.mark.thorough
@by_each
def test_accelerating_axes_are_a_change_of_gravity(solve):
    for seed in range(5):
        robot, setting, moment = random_case(seed)
        tilted = dataclasses.replace(setting, g_space=setting.g_space - setting.X2, X2=ORIGIN)
        assert_same(solve(robot, tilted, moment), solve(robot, setting, moment))


@pytest.mark.thorough
@by_each
def test_power_is_the_rate_of_the_energy(solve):
    """Ė = F·ż + Σ Q θ̇ + T·ω + f·u, by central differences over 1e-5, whose error is about 1e-10."""
    h = 1e-5
    for seed in range(5):
        robot, setting, moment = random_case(seed)
        setting = dataclasses.replace(setting, X2=ORIGIN)
        answer = solve(robot, setting, moment)
        omega = in_space(moment) @ moment.Omega
        u = setting.W * np.cross(E3, np.append(moment.z - setting.centre, 0.0))
        zdot = robot.radius * np.cross(omega, E3) + u
        level = omega * (1 - E3)
        dry = answer.R[2] * setting.mu_r * robot.radius / np.hypot(np.linalg.norm(level), setting.epsilon)
        torque = -(setting.c_r + dry) * level - setting.c_s * (omega[2] - setting.W) * E3 - setting.c_w * omega
        power = (setting.Fe - setting.c_v * zdot) @ zdot + torque @ omega + answer.R @ u
        power += sum(Q @ rate for Q, rate in zip(answer.efforts, moment.thetadot, strict=True))
        before, after = (
            lagrange.energy(
                robot, dataclasses.replace(setting, W=setting.W + t * setting.Wdot), later(moment, answer, zdot, t)
            )
            for t in (-h, h)
        )
        assert_close((after - before) / (2 * h), power, 1e-8)


def later(moment, answer, zdot, t):
    """Correct to first order, which is all that central differences see."""
    turn = Rotation.from_quat(np.roll(moment.q, -1)) * Rotation.from_rotvec(t * moment.Omega)
    return Moment(
        q=np.roll(turn.as_quat(), 1),
        Omega=moment.Omega + t * answer.Omegadot,
        z=moment.z + t * zdot[:2],
        theta=tuple(a + t * b for a, b in zip(moment.theta, moment.thetadot, strict=True)),
        thetadot=tuple(a + t * b for a, b in zip(moment.thetadot, answer.thetaddot, strict=True)),
        given=moment.given,
    )


@by_each
def test_homogeneous_ball_on_an_accelerating_turntable_on_an_incline(solve):
    """z̈ = (g − Ẍ)/(1+k) + k/(1+k) u̇ in the plane: g sin a/(1+k) on an incline, 2/7 W for a solid sphere turned."""
    ball, k = rolling_ball()
    rng = np.random.default_rng(0)
    incline = Setting(g_space=3 * np.array([np.sin(0.4), 0.0, -np.cos(0.4)]))
    turntable = dataclasses.replace(incline, W=0.8, Wdot=-0.5, centre=np.array([0.3, -0.2]), X2=rng.normal(size=3))
    for setting in (incline, turntable):
        moment = random_motion(rng)
        arm = np.append(moment.z - setting.centre, 0.0)
        zdot = ball.radius * np.cross(in_space(moment) @ moment.Omega, E3) + setting.W * np.cross(E3, arm)
        udot = setting.Wdot * np.cross(E3, arm) + setting.W * np.cross(E3, zdot)
        expected = (setting.g_space - setting.X2 + k * udot)[:2] / (1 + k)
        answer = solve(ball, setting, moment)
        assert_close(answer.zddot, expected)
        assert_close(answer.R, ball.mass * (np.append(expected, 0.0) - setting.g_space + setting.X2))
    downhill = solve(ball, incline, random_motion(rng))
    assert_close(downhill.zddot, np.array([3 * np.sin(0.4) / (1 + k), 0.0]))
    assert_close(np.linalg.norm(downhill.R[:2]), k / (1 + k) * ball.mass * 3 * np.sin(0.4))


@by_each
def test_homogeneous_ball_with_resistance(solve):
    """Viscous: z̈ = g/(1+k) − λż and ω₃ decays at (c_s + c_w)/d; dry: z̈ = −μ_r g/(1+k) ż/√(ż² + r²ε²)."""
    d = 0.6
    ball, k = rolling_ball(d)
    M, r = ball.mass, ball.radius
    moment = random_motion(np.random.default_rng(1))
    omega = in_space(moment) @ moment.Omega
    zdot = r * np.cross(omega, E3)[:2]
    viscous = Setting(g_space=np.array([0.4, 0.2, -2.0]), c_r=0.3, c_s=0.2, c_v=0.5, c_w=0.1)
    answer = solve(ball, viscous, moment)
    assert_close(answer.zddot, np.array([0.4, 0.2]) / (1 + k) - (0.3 + 0.1 + 0.5 * r**2) / (d + M * r**2) * zdot)
    assert_close((in_space(moment) @ answer.Omegadot)[2], -(0.2 + 0.1) / d * omega[2])
    dry = Setting(g_space=np.array([0.0, 0.0, -2.0]), mu_r=0.2, epsilon=0.3)
    speed = np.hypot(np.linalg.norm(zdot), r * 0.3)
    assert_close(solve(ball, dry, moment).zddot, -0.2 * 2.0 / (1 + k) * zdot / speed)


@by_each
def test_a_mass_on_three_free_sliders_is_not_felt_and_falls(solve):
    for seed in range(5):
        robot, setting, moment = random_case(seed, chains=2)
        axes = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
        sliders = Chain(tuple(Joint("slider", e, ORIGIN, True) for e in axes), (Carried(0.7, 0.3 * E1, 3),))
        theta, thetadot = np.array([0.2, -0.4, 0.5]), np.array([-1.1, 0.6, 0.3])
        loaded = solve(
            dataclasses.replace(robot, chains=(*robot.chains, sliders)),
            setting,
            dataclasses.replace(
                moment,
                theta=(*moment.theta, theta),
                thetadot=(*moment.thetadot, thetadot),
                given=(*moment.given, np.zeros(3)),
            ),
        )
        chi, chidot, chiddot = 0.3 * E1 + theta @ axes, thetadot @ axes, loaded.thetaddot[-1] @ axes
        Omega = moment.Omega
        swept = np.cross(loaded.Omegadot, chi) + np.cross(Omega, np.cross(Omega, chi) + 2 * chidot) + chiddot
        falls = setting.X2 + np.append(loaded.zddot, 0.0) + in_space(moment) @ swept
        assert_close(falls, setting.g_space)
        unloaded = dataclasses.replace(loaded, thetaddot=loaded.thetaddot[:-1], efforts=loaded.efforts[:-1])
        assert_same(unloaded, solve(robot, setting, moment))


@by_each
def test_rotor_keeps_its_momentum_but_for_the_motor(solve):
    """C (n·Ω + θ̇)˙ = Q, for a ring of three equal masses anywhere in an unbalanced ball."""
    robot, setting, moment = random_case(3, chains=1)
    frame = Rotation.random(rng=np.random.default_rng(3)).as_matrix()
    centre, m, radius, Q = np.array([0.2, -0.3, 0.1]), 0.4, 0.5, 0.7
    angles = 0.3 + 2 * np.pi / 3 * np.arange(3)
    places = [centre + radius * (np.cos(a) * frame[0] + np.sin(a) * frame[1]) for a in angles]
    ring = Chain((Joint("hinge", frame[2], centre, True),), tuple(Carried(m, x, 1) for x in places))
    answer = solve(
        dataclasses.replace(robot, chains=(*robot.chains, ring)),
        setting,
        dataclasses.replace(
            moment,
            theta=(*moment.theta, np.array([1.2])),
            thetadot=(*moment.thetadot, np.array([-2.0])),
            given=(*moment.given, np.array([Q])),
        ),
    )
    assert_close(3 * m * radius**2 * (frame[2] @ answer.Omegadot + answer.thetaddot[-1][0]), np.float64(Q))


@by_each
def test_conical_pendulum(solve):
    """On a sled of mass m_c = m₀ + d/r² a pendulum circles at w² = g (m + m_c)/(l m_c cos a), and N is the weight."""
    m, l, a, g = 0.5, 0.6, 0.7, 2.0
    hinges = (Joint("hinge", E1, ORIGIN, True), Joint("hinge", E2, ORIGIN, True))
    ball, k = rolling_ball(chains=(Chain(hinges, (Carried(m, -l * E3, 2),)),))
    sled = ball.mass * (1 + k)
    w = np.sqrt(g * (m + sled) / (l * sled * np.cos(a)))
    speed = m / (m + sled) * w * l * np.sin(a)  # of the ball, along −e2 when the pendulum is out along e1
    Omega = speed / ball.radius * E1
    moment = Moment(
        UPRIGHT,
        Omega,
        np.zeros(2),
        (np.array([0.0, -a]),),
        (np.array([w * np.tan(a) - Omega[0], 0.0]),),
        (np.zeros(2),),
    )
    answer = solve(ball, Setting(g_space=-g * E3), moment)
    assert_close(answer.zddot, np.array([w * speed, 0.0]))
    assert_close(answer.R, np.array([-k * ball.mass * w * speed, 0.0, (ball.mass + m) * g]))
