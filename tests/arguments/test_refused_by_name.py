"""Wrong arguments, each refused by the name of the argument and of the class that was typed."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Ball, BallState, CarriedMass, Circle, Disk, DiskState, Driven, Event, Hinge, Mechanism, PointMass
from jaxball.analysis.chaos import chart, lyapunov_spectrum_of
from jaxball.simulation.ensemble import Maximum, simulate_ensemble
from tests.support.sentences import refuses, said

pytestmark = pytest.mark.usefixtures("no_type_checks")

SHELL = {"mass": 1.0, "inertia": (0.5, 0.6, 0.7)}
BALL, TIMES = Ball(**SHELL), [0.0, 1.0]
DISK, ROLLING = Disk(mass=1.0, inertia=0.5), DiskState(phidot=-1.0)


class OwnBall(Ball):
    """A class of one's own."""


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: Ball(gravty=3), "gravty"),
        (lambda: Disk(**SHELL, masess=[]), "masess"),
        (lambda: OwnBall(raduis=3), "raduis"),
        (lambda: Circle(radus=3), "radus"),
        (lambda: Circle(0.5, zip=3), "zip"),
        (lambda: BallState(Omga=1), "Omga"),
        (lambda: Ball(mass=1.0), "inertia"),
        (lambda: Ball(1.0, 2.0), "Arguments of Ball"),
        (lambda: Disk(1.0), "Arguments of Disk"),
        (lambda: BallState(1, 2, 3, 4, 5, 6, 7), "BallState"),
    ],
)
def test_the_class_that_was_typed(make, named):
    with refuses(TypeError, named) as caught:
        make()
    assert "__init__" not in str(caught.value)


def test_a_mechanism_without_joints():
    with refuses(ValueError, "joints"):
        Mechanism(joints=[])


def run(**settings):
    return jaxball.simulate(DISK, TIMES, ROLLING, **settings)


def ensemble(**settings):
    starts = jax.tree.map(lambda leaf: jnp.stack([leaf] * 3), ROLLING)
    return simulate_ensemble(DISK, TIMES, starts, in_axes=(None, 0), **settings)


@pytest.mark.parametrize("solve", [run, ensemble])
@pytest.mark.parametrize("name", ["rtol", "atol"])
@pytest.mark.parametrize("value", ["-1.0", "-1e-08", "nan", "inf"])
def test_one_wrong_tolerance_beside_a_right_one(solve, name, value):
    with refuses(ValueError, name):
        solve(**{name: float(value)})


@pytest.mark.parametrize("name", ["rtol", "atol"])
@pytest.mark.parametrize("size", [1, 2, 3])  # the last is that of the state
def test_a_run_has_one_tolerance(name, size):
    with refuses(ValueError, name):
        run(**{name: [1e-8] * size})


@pytest.mark.thorough
def test_one_wrong_tolerance_of_many_runs():
    with refuses(ValueError, "atol[1]"):
        ensemble(atol=[1e-8, -1e-8, 1e-8])
    with refuses(ValueError, "rtol"):  # a row whose larger one is too small
        ensemble(atol=[1e-8, 0.0, 1e-8], rtol=[0.0, 1e-30, 0.0])
    assert ensemble(atol=[1e-8, 0.0, 1e-8], rtol=[0.0, 1e-8, 0.0]).trajectory.status.tolist() == [0, 0, 0]


FLAGS = ("dense", "step_to_times", "dae", "project", "inside", "throw")


@pytest.mark.parametrize("name", FLAGS)
@pytest.mark.parametrize("value", ["yes", 1, None, np.ones(2)])
def test_flags_of_a_run(name, value):
    with refuses(TypeError, name):
        run(**{name: value})


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: ensemble(inside="no"), "inside"),
        (lambda: Event(lambda system, t, state: t, terminal="no"), "terminal"),
        (lambda: jaxball.Detachment(terminal=0), "terminal"),
        (lambda: jaxball.Slip(0.3, terminal="yes"), "terminal"),
        (lambda: jaxball.Damper(1.0, negative="no"), "negative"),
        (lambda: jaxball.Resistance(rolling=0.1, negative="no"), "negative"),
        (lambda: jaxball.analysis.verify.check_laws(DISK, TIMES, ROLLING, quick="no"), "quick"),
        (lambda: run().view(all_times="no"), "all_times"),
    ],
)
def test_other_flags(make, name):
    with refuses(TypeError, name):
        make()


def branching(*given):
    """Of whatever it is given, it asks whether the first number is positive."""
    number = next(leaf for leaf in jax.tree.leaves(given) if leaf.ndim == 0)
    return number if number > 0 else -number


def pulled(t, theta, thetadot, state, parameters):
    return branching(theta)


def accelerated(t, state, parameters):
    return state.theta * branching(t)


def placed(t, parameters):
    return jnp.stack([branching(t)] * 3)


def angle(t, parameters):
    return branching(t)


def crossed(system, t, state):
    return branching(t)


def changing(t, x, args):
    return x * branching(t)


def made(first, second):
    return Disk(mass=1.0, inertia=branching(first)), DiskState()


def robot(drive):
    return Ball(
        **SHELL, mechanisms=[Mechanism([Hinge((0.0, 1.0, 0.0), drive=drive)], [CarriedMass(0.2, (0, 0, -0.5))])]
    )


def of_one_joint():
    return BallState(theta=[0.1], thetadot=[0.0])


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("use", "name"),
    [
        (
            lambda: jaxball.simulate(robot(jaxball.physics.FunctionJointForce(pulled)), TIMES, of_one_joint()),
            "function",
        ),
        (
            lambda: jaxball.simulate(
                Ball(**SHELL, masses=[PointMass(0.2, Driven(Circle(0.5)))], law=jaxball.FunctionLaw(accelerated)),
                TIMES,
                of_one_joint(),
            ),
            "function",
        ),
        (lambda: jaxball.FunctionForce(placed), "function"),
        (lambda: jaxball.Free(placed), "function"),
        (lambda: jaxball.FunctionRail(placed), "function"),
        (lambda: jaxball.FunctionSchedule(angle), "function"),
        (lambda: jaxball.physics.classical.FunctionAxis(placed), "function"),
        (lambda: run(events={"post": Event(crossed)}), "of"),
        (lambda: ensemble(reductions={"most": Maximum(crossed)}), "quantity"),
        (lambda: lyapunov_spectrum_of(changing, (0.0, 4.0), (1.0,), transient=1.0), "field"),
        (lambda: chart(made, {"a": [1.0], "b": [1.0]}, (0.0, 4.0), transient=1.0), "make"),
    ],
)
def test_a_function_with_a_branch_is_told_what_to_write_for_it(use, name):
    with pytest.raises(TypeError) as caught:
        use()
    told = str(caught.value)
    said(told, name)
