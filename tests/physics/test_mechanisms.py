"""Bodies with mechanisms on a moving, tilted ground, with resistance, against two independent formulations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.physics.dynamics.equations import accelerations
from tests.support import lagrange, newton_euler, robots
from tests.support.robot_balls import ball_of, follow, state_of

MOMENTS = 5  # of each robot, by one compiled program
SEEDS = [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 8))]


@pytest.fixture(scope="module", params=SEEDS)
def cases(request):
    """A robot in several settings and states in which the plane holds it."""
    rng = np.random.default_rng(request.param)
    robot, cases = robots.random_robot(rng), []
    while len(cases) < MOMENTS:
        setting, moment = robots.random_setting(rng), robots.random_moment(rng, robot)
        answer = newton_euler.solve(robot, setting, moment)
        if answer.R[2] > 0:
            cases.append((robot, setting, moment, answer))
    return cases


def turned(axis, point, angle, x):
    """x turned about an axis through a point: Rodrigues' formula."""
    n, arm = axis / jnp.linalg.norm(axis), x - point
    along = jnp.dot(n, arm) * n
    return point + along + jnp.cos(angle) * (arm - along) + jnp.sin(angle) * jnp.cross(n, arm)


AXIS, POINT, SLIDE, BACK = (
    jnp.asarray(v) for v in ((0.2, 1.0, 0.3), (0.1, 0.0, 0.2), (0.6, 0.0, 0.8), (1.0, 0.0, 0.4))
)
BRANCHES = (0.3, 0.2, 0.4)


def of_branches(theta, _):
    """A hinge that carries a mass on a circle and one in a tube, and another hinge beside it."""
    circle = 0.4 * jnp.stack([jnp.cos(theta[1]), jnp.zeros(()), jnp.sin(theta[1])])
    tube = jnp.asarray((0.0, 0.1, -0.3)) + theta[2] * SLIDE
    return jnp.stack(
        [
            turned(AXIS, POINT, theta[0], circle),
            turned(AXIS, POINT, theta[0], tube),
            turned(BACK, jnp.zeros(3), theta[3], jnp.asarray((0.0, 0.5, 0.1))),
        ]
    )


@pytest.mark.long
def test_branches_are_what_a_function_of_their_places_makes_of_them():
    """One of the branches has a law; derivatives of the function are automatic, those of the joints written out."""
    drives = [jaxball.Spring(1.0), None, jaxball.Damper(0.1), jaxball.Accelerated()]
    masses = [jaxball.CarriedMass(0.3, joint=1), jaxball.CarriedMass(0.2, (0.0, 0.1, -0.3), 2)]
    branches = jaxball.Mechanism(
        [
            jaxball.Hinge(AXIS, POINT, drives[0]),
            jaxball.Carriage(jaxball.Circle(0.4), drives[1]),
            jaxball.Slider(SLIDE, drives[2], on=0),
            jaxball.Hinge(BACK, drive=drives[3], on=-1),
        ],
        [*masses, jaxball.CarriedMass(0.4, (0.0, 0.5, 0.1), 3)],
    )
    function = jaxball.physics.FunctionMechanism(of_branches, BRANCHES, drives)
    state = jaxball.BallState(Omega=(0.3, -0.5, 0.7), theta=[0.4, 0.9, 0.2, -0.3], thetadot=[0.6, -0.8, 0.3, 0.5])
    law = jaxball.FunctionLaw(follow, jnp.asarray([0.7]))
    found, wanted = (
        jax.tree.leaves(rates(jaxball.Ball(mass=1.0, inertia=(0.4, 0.5, 0.6), mechanisms=[one], law=law), state))
        for one in (branches, function)
    )
    for x, y in zip(found, wanted, strict=True):
        assert scaled(x, y) < 1e-12


@jax.jit
def rates(ball, state):
    """What the equations of motion give, and what a solve advances."""
    prepared, t = ball.prepare(), jnp.array(0.0)
    return prepared.field(t, state), prepared.field_of_packed(t, prepared.to_packed(t, state))


def scaled(found, expected):
    expected = np.asarray(expected)
    return np.max(np.abs(np.asarray(found) - expected), initial=0.0) / max(1.0, np.max(np.abs(expected), initial=0.0))


@jax.jit
def all_of(ball, t, state):
    """What the tests of random robots look at, as one program."""

    def seen(t, state):
        return jaxball.observe(ball, t, state)

    found = accelerations(ball, t, state)
    rates, one = ball.field(t, state), jnp.ones_like(t)
    observed, changes = jax.jvp(seen, (t, state), (one, rates))
    packed, packed_rates = jax.jvp(ball.to_packed, (t, state), (one, rates))
    advanced, back = ball.field_of_packed(t, packed), ball.from_packed(t, packed)
    return found, observed, changes.energy, packed_rates, advanced, back


@pytest.fixture(scope="module")
def evaluated(cases):
    return [all_of(ball_of(*case[:3]).prepare(), jnp.array(0.0), state_of(case[2])) for case in cases]


def test_what_is_drawn_has_every_kind():
    """Hinges and sliders, free and given, in chains of one, two and three; fixed masses or none."""
    drawn = [robots.random_robot(np.random.default_rng(seed)) for seed in range(20)]
    chains = [chain for robot in drawn for chain in robot.chains]
    assert {(joint.kind, joint.free) for chain in chains for joint in chain.joints} == {
        (kind, free) for kind in ("hinge", "slider") for free in (True, False)
    }
    assert {len(chain.joints) for chain in chains} == {len(chain.masses) for chain in chains} == {1, 2, 3}
    assert {len(robot.chains) for robot in drawn} == {1, 2, 3}
    assert {len(robot.still) for robot in drawn} == {0, 1, 2}


@pytest.mark.long
def test_accelerations_and_efforts_are_those_of_two_other_formulations(cases, evaluated):
    for (robot, setting, moment, expected), (found, seen, *_) in zip(cases, evaluated, strict=True):
        for oracle in (expected, lagrange.solve(robot, setting, moment)):
            assert scaled(found.Omegadot, oracle.Omegadot) < 1e-11
            assert scaled(found.angles[2], np.concatenate(oracle.thetaddot)) < 1e-11
            assert scaled(np.append(seen.friction, seen.normal_force), oracle.R) < 1e-11
            assert scaled(seen.joint_efforts, np.concatenate(oracle.efforts)) < 1e-11


@pytest.mark.long
def test_what_a_solve_advances_has_the_rates_of_these_equations(cases, evaluated):
    """The locked velocities' rates are those of the state, seen through the change of coordinates."""
    for (_, _, moment, _), (*_, expected, found, back) in zip(cases, evaluated, strict=True):
        for x, y in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
            assert scaled(x, y) < 1e-11
        for x, y in zip(jax.tree.leaves(back), jax.tree.leaves(state_of(moment)), strict=True):
            assert scaled(x, y) < 1e-12


@pytest.mark.thorough
def test_energy_changes_by_the_power_of_all_that_acts(cases, evaluated):
    for case, (_, seen, rate, *_) in zip(cases, evaluated, strict=True):
        assert float(seen.energy) == pytest.approx(lagrange.energy(*case[:3]), rel=1e-12, abs=1e-12)
        assert float(rate) == pytest.approx(float(seen.power), rel=1e-10, abs=1e-10)
