"""Parameters that are NaN are told by the path at which they stand, wherever that is."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Ball, BallState, CarriedMass, Circle, Hinge, Mechanism, Motor, OnRail, PointMass, Pulse, Status
from jaxball.physics.prescribed.signals import ConstantSignal
from tests.support.sentences import refuses, said

NAN = float("nan")
SHELL = {"mass": 1.0, "inertia": (0.5, 0.6, 0.7)}


def robot(drive):
    pendulum = Mechanism([Hinge((0.0, 1.0, 0.0), drive=drive)], [CarriedMass(0.2, (0.0, 0.0, -0.5))])
    return Ball(**SHELL, mechanisms=[pendulum])


def on_rail(rail, schedule):
    return Ball(
        **SHELL, masses=[PointMass(0.2, jaxball.Fixed((0.0, 0.0, 0.1))), PointMass(0.5, OnRail(rail, schedule))]
    )


REFUSED = {
    "signal": lambda x: Motor(x),
    "limit": lambda x: Motor(1.0, limit=x),
    "coefficient": lambda x: jaxball.Damper(x),
    "rest": lambda x: jaxball.Spring(1.0, x),
    "free_speed": lambda x: jaxball.physics.SpeedLimitedMotor(1.0, 1.0, x),
    "damping": lambda x: jaxball.PDServo(jaxball.ConstantRate(1.0), 1.0, x),
    "upper": lambda x: jaxball.EndStops(-1.0, x, 1.0),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_force_on_a_joint_is_not_made_of_it(name):
    with refuses(ValueError, name):
        REFUSED[name](NAN)


@pytest.mark.parametrize("make", REFUSED.values(), ids=REFUSED)
def test_what_is_not_known_yet_passes(make):
    def sum_of(x):
        return sum(jnp.sum(leaf) for leaf in jax.tree.leaves(make(x)))

    assert np.isnan(jax.jit(sum_of)(NAN))
    assert np.isfinite(jax.grad(sum_of)(2.0))
    np.testing.assert_array_equal(np.isnan(jax.vmap(sum_of)(jnp.array([2.0, NAN]))), [False, True])


DRIVE = "mechanisms[0].joints[0].drive"
LATER = jaxball.PiecewiseSignal([0.0, 1.0, 2.0], [1.0, NAN])
CASES = {
    f"{DRIVE}.signal.value": robot(Motor(ConstantSignal(NAN))),
    f"{DRIVE}.signal.values[1][0]": robot(Motor(LATER)),
    f"{DRIVE}.stiffness": robot(eqx.tree_at(lambda spring: spring.stiffness, jaxball.Spring(1.0), jnp.array(NAN))),
    f"{DRIVE}.terms[1].target.theta": robot(Motor(0.1) + jaxball.PDServo(jaxball.ConstantRate(NAN), 1.0)),
    "masses[1].motion.rail.radius": on_rail(Circle(NAN), Pulse(0.0)),
    "masses[1].motion.schedule.height": on_rail(Circle(0.5), Pulse(0.0, height=NAN)),
    "force.series.constant[2]": Ball(**SHELL, force=jaxball.physics.HarmonicForce((0.0, 1.0, NAN))),
}


@pytest.mark.parametrize("name", CASES)
def test_the_number_is_named(name):
    (problem,) = jaxball.problems(CASES[name])
    said(problem, name)


def test_a_number_that_a_rule_names_is_named_once():
    told = jaxball.problems(Ball(mass=NAN, inertia=(0.5, 0.6, 0.7), masses=[PointMass(NAN, jaxball.Fixed((0, 0, 0)))]))
    assert [line.split("`")[1] for line in told] == ["mass", "masses[0].mass"]


def may_be_anything(t, parameters):
    return 0.3 * parameters[:3]


def test_what_a_function_is_given_is_its_own_affair():
    motion = jaxball.Free(may_be_anything, np.array([0.1, 0.2, 0.3, NAN]))
    assert jaxball.problems(Ball(**SHELL, masses=[PointMass(0.2, motion)])) == []


@pytest.mark.long
@pytest.mark.parametrize(
    ("drive", "reached", "name"),
    [(Motor(ConstantSignal(NAN)), 0.0, "value"), (Motor(LATER), 1.0, "values[1][0]")],
)
def test_a_run_that_it_stops_names_it(drive, reached, name):
    run = jaxball.simulate(robot(drive), [0.0, 3.0], BallState(theta=[0.1], thetadot=[0.0]))
    assert run.status == Status.NOT_FINITE
    assert float(run.reached) == pytest.approx(reached)
    said(run.message, f"{DRIVE}.signal.{name}")
