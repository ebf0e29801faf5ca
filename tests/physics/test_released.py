"""Robots that slide and fly, everything on, against Newton's and Euler's laws with the law of friction."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.physics.contact import friction
from jaxball.physics.contact.released import ReleasedState, energy_of_released, rates, release, response, slip_velocity
from jaxball.physics.dynamics.equations import accelerations
from tests.support import lagrange, newton_euler, robots
from tests.support.robot_balls import ball_of, state_of
from tests.support.robots import Pushed, Slides

MOMENTS = 4  # of each robot, by one compiled program
SEEDS = [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 8))]
ORIGIN = np.zeros(3)


def lifted(robot, setting, moment, slip):
    """The moment with a slip velocity."""
    return dataclasses.replace(moment, V=robots.centre_velocity(robot, setting, moment) + slip)


def parted(robot, setting, moment, answer):
    """The slip acceleration V̇ − rω̇ × e3 − u̇ of an answer."""
    turn = robots.rotation(moment)
    arm = np.append(moment.z - setting.centre, 0.0)
    e3 = np.array([0.0, 0.0, 1.0])
    convected = setting.Wdot * np.cross(e3, arm) + setting.W * np.cross(e3, moment.V)
    turning = robot.radius * np.cross(turn @ answer.Omegadot, e3)
    return np.append(answer.zddot, answer.rise) - turning - convected


@pytest.fixture(scope="module", params=SEEDS)
def cases(request):
    """A robot in several settings and states in which it slides on the plane."""
    rng = np.random.default_rng(100 + request.param)
    robot, cases = robots.random_robot(rng), []
    while len(cases) < MOMENTS:
        setting, moment = robots.random_setting(rng), robots.random_moment(rng, robot)
        moment, mu = lifted(robot, setting, moment, np.append(rng.normal(size=2), 0.0)), rng.uniform(0.1, 0.6)
        answer = newton_euler.solve(robot, setting, moment, Slides(mu))
        if answer.R[2] > 0:
            cases.append((robot, setting, moment, mu, answer))
    return cases


def released_of(moment):
    return ReleasedState(state_of(moment), jnp.asarray(moment.V), jnp.zeros(()))


@jax.jit
def all_of(ball, t, state, mu, R):
    """What the tests of this module look at, as one program."""
    slip, still = slip_velocity(ball, t, state), jnp.zeros(2)
    found = response(ball, t, state)
    slides = friction.sliding(found, mu, friction.slip_direction(slip, still))
    flying = response(ball, t, state, jnp.asarray(False))
    flies = friction.flight(flying)

    def of(found, interaction):
        return interaction, rates(ball, state, found, interaction.amounts)

    without_slip = found.part("reaction", found.amounts(jnp.zeros(3), R[2]))
    accelerated = found.delassus @ (R - without_slip)
    pushed = friction.Interaction(found.amounts(accelerated, R[2]), R, R[2], jnp.ones(()))
    changes = of(found, slides)
    energy = jax.jvp(lambda t, x: energy_of_released(ball, t, x), (t, state), (jnp.ones_like(t), changes[1]))
    at_rest = release(ball, t, state.body)
    rolls = response(ball, t, at_rest)
    rolling = friction.rolling(rolls)
    rolled = rates(ball, at_rest, rolls, rolling.amounts)
    present = ball.field(t, state.body), accelerations(ball, t, state.body), jaxball.observe(ball, t, state.body)
    first = friction.first_slip(rolls, mu)
    return {
        "sliding": changes,
        "flight": of(flying, flies),
        "pushed": of(found, pushed),
        "contact": found.delassus,
        "inverse": found.yielding.reaction,
        "free": found.free,
        "energy": energy,
        "rolling": (rolling, rolled),
        "present": present,
        "first": (first, friction.sliding(rolls, mu, first.sigma), friction.margin(rolling.R, mu)),
    }


FORCE = np.array([0.7, -0.4, 1.3])


@pytest.fixture(scope="module")
def evaluated(cases):
    found = []
    for robot, setting, moment, mu, _ in cases:
        ball = ball_of(robot, setting, moment).prepare()
        found.append(all_of(ball, jnp.array(0.0), released_of(moment), jnp.asarray(mu), jnp.asarray(FORCE)))
    return found


def assert_same(found, expected, bound=1e-11):
    expected = np.asarray(expected)
    scale = max(1.0, np.max(np.abs(expected), initial=0.0))
    np.testing.assert_allclose(found, expected, rtol=0, atol=bound * scale)


def assert_answer(found, answer):
    interaction, changes = found
    assert_same(interaction.R, answer.R)
    assert_same(changes.body.Omega, answer.Omegadot)
    assert_same(changes.body.thetadot, np.concatenate(answer.thetaddot))
    assert_same(changes.V, np.append(answer.zddot, answer.rise))


@pytest.mark.long
def test_sliding_is_that_of_newton_and_euler_with_friction(cases, evaluated):
    for (robot, setting, moment, _, answer), found in zip(cases, evaluated, strict=True):
        assert_answer(found["sliding"], answer)
        interaction, changes = found["sliding"]
        assert_same(interaction.slip_acceleration, parted(robot, setting, moment, answer))
        assert interaction.slip_acceleration[2] == 0 == changes.V[2]
        assert interaction.solvability > 0
        assert_same(changes.body.z, moment.V[:2], 1e-15)


@pytest.mark.long
def test_any_reaction_and_none_are_those_of_newton_and_euler(cases, evaluated):
    for (robot, setting, moment, _, _), found in zip(cases, evaluated, strict=True):
        assert_answer(found["pushed"], newton_euler.solve(robot, setting, moment, Pushed(FORCE)))
        assert_answer(found["flight"], newton_euler.solve(robot, setting, moment, Pushed(ORIGIN, touching=False)))


@pytest.mark.thorough
def test_the_contact_matrix_is_what_unit_forces_of_the_plane_do(cases, evaluated):
    for (robot, setting, moment, _, _), found in zip(cases, evaluated, strict=True):
        smooth = dataclasses.replace(setting, mu_r=0.0)

        def answered(R, robot=robot, smooth=smooth, moment=moment):
            return parted(robot, smooth, moment, newton_euler.solve(robot, smooth, moment, Pushed(R)))

        free = answered(ORIGIN)
        assert_same(found["free"], free)
        assert_same(found["contact"], np.stack([answered(e) - free for e in np.eye(3)], axis=1))
        assert_same(found["contact"] @ found["inverse"], np.eye(3), 1e-12)
        assert np.all(np.linalg.eigvalsh(found["contact"]) > 0)


@pytest.mark.thorough
def test_rolling_is_what_it_was(cases, evaluated):
    """The equations of rolling, which know of no slip, to rounding."""
    for found in evaluated:
        (interaction, changes), (field, old, seen) = found["rolling"], found["present"]
        for x, y in zip(jax.tree.leaves(changes.body), jax.tree.leaves(field), strict=True):
            assert_same(x, y, 1e-13)
        assert_same(changes.body.Omega, old.Omegadot, 1e-13)
        assert_same(interaction.R, np.append(seen.friction, seen.normal_force), 1e-12)


@pytest.mark.thorough
def test_the_energy_changes_by_the_power_of_all_that_acts(cases, evaluated):
    """Ė = F·V + Σ Q θ̇ + T·ω + R·(v_s + u) − Ẍ·P; of it, friction has f·v_s."""
    for (robot, setting, moment, _, answer), found in zip(cases, evaluated, strict=True):
        value, rate = found["energy"]
        assert_same(value, lagrange.energy(robot, setting, moment), 1e-12)
        e3, omega = np.array([0.0, 0.0, 1.0]), robots.rotation(moment) @ moment.Omega
        lowest = moment.V - robot.radius * np.cross(omega, e3)
        level = omega * (1 - e3)
        dry = answer.R[2] * setting.mu_r * robot.radius / np.hypot(np.linalg.norm(level), setting.epsilon)
        torque = -(setting.c_r + dry) * level - setting.c_s * (omega[2] - setting.W) * e3 - setting.c_w * omega
        power = (setting.Fe - setting.c_v * moment.V) @ moment.V + torque @ omega + answer.R @ lowest
        power += sum(Q @ joint_rates for Q, joint_rates in zip(answer.efforts, moment.thetadot, strict=True))
        power -= setting.X2 @ robots.momentum(robot, moment)
        assert_same(rate, power, 1e-10)


@pytest.mark.thorough
def test_a_slip_begins_along_its_own_acceleration(cases, evaluated):
    """Where friction cannot hold, and with the friction of this direction, by the other formulation."""
    begun = 0
    for (robot, setting, moment, mu, _), found in zip(cases, evaluated, strict=True):
        first, interaction, margin = found["first"]
        if found["rolling"][0].R[2] < 0 or interaction.R[2] < 0:
            continue
        assert (first.growth > 0) == (margin < 0)
        if margin < 0:
            begun += 1
            sigma = np.asarray(first.sigma)
            answer = newton_euler.solve(robot, setting, lifted(robot, setting, moment, ORIGIN), Slides(mu, sigma))
            acceleration = parted(robot, setting, lifted(robot, setting, moment, ORIGIN), answer)
            assert_same(np.append(first.growth * sigma, 0.0), acceleration, 1e-10)
    assert begun > 0
