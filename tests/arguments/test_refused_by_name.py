"""Wrong arguments, each refused by the name of the argument and of the class that was typed."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Ball, BallState, CarriedMass, Circle, Disk, DiskState, Driven, Event, Hinge, Mechanism, PointMass
from jaxball.chaos import chart, lyapunov_spectrum_of
from jaxball.ensemble import Maximum, simulate_ensemble

pytestmark = pytest.mark.usefixtures("no_type_checks")

SHELL = {"mass": 1.0, "inertia": (0.5, 0.6, 0.7)}
BALL, TIMES = Ball(**SHELL), [0.0, 1.0]
DISK, ROLLING = Disk(mass=1.0, inertia=0.5), DiskState(phidot=-1.0)


class OwnBall(Ball):
    """A class of one's own."""


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Ball(gravty=3), "Argument `gravty` of Ball is not known; did you mean `gravity`?"),
        (lambda: Disk(**SHELL, masess=[]), "Argument `masess` of Disk is not known; did you mean `masses`?"),
        (lambda: OwnBall(raduis=3), "Argument `raduis` of OwnBall is not known; did you mean `radius`?"),
        (lambda: Circle(radus=3), "Argument `radus` of Circle is not known; did you mean `radius`?"),
        (lambda: Circle(0.5, zip=3), "Argument `zip` of Circle is not known; the arguments are "),
        (lambda: BallState(Omga=1), "Argument `Omga` of BallState is not known; did you mean `Omega`?"),
        (lambda: Ball(mass=1.0), "Argument `inertia` of Ball must be given, but it is missing."),
        (lambda: Ball(1.0, 2.0), "Arguments of Ball must be named, as in Ball(mass=...), but 2 have no names."),
        (lambda: Disk(1.0), "Arguments of Disk must be named, as in Disk(mass=...), but 1 has no name."),
        (
            lambda: BallState(1, 2, 3, 4, 5, 6, 7),
            "must be no more than q, Omega, z, theta, thetadot, own, but there are 7.",
        ),
    ],
)
def test_the_class_that_was_typed(make, sentence):
    with pytest.raises(TypeError) as caught:
        make()
    assert sentence in str(caught.value)
    assert "__init__" not in str(caught.value)


def test_a_mechanism_without_joints():
    with pytest.raises(ValueError, match="`joints` must be a list of one joint or more, but it is empty; a mass"):
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
    with pytest.raises(ValueError, match=rf"^Argument `{name}` must be 0 or a positive number, but it is {value}\.$"):
        solve(**{name: float(value)})


@pytest.mark.parametrize("name", ["rtol", "atol"])
@pytest.mark.parametrize("size", [1, 2, 3])  # the last is that of the state
def test_a_run_has_one_tolerance(name, size):
    with pytest.raises(ValueError, match=rf"^Argument `{name}` must be a single number, but its shape is \({size},\)"):
        run(**{name: [1e-8] * size})


@pytest.mark.thorough
def test_one_wrong_tolerance_of_many_runs():
    with pytest.raises(ValueError, match=r"^Argument `atol\[1\]` must be 0 or a positive number, but it is -1e-08\.$"):
        ensemble(atol=[1e-8, -1e-8, 1e-8])
    with pytest.raises(ValueError, match="must not both be below"):  # a row whose larger one is too small
        ensemble(atol=[1e-8, 0.0, 1e-8], rtol=[0.0, 1e-30, 0.0])
    assert ensemble(atol=[1e-8, 0.0, 1e-8], rtol=[0.0, 1e-8, 0.0]).trajectory.status.tolist() == [0, 0, 0]


FLAGS = ("dense", "step_to_times", "dae", "project", "inside", "throw")


@pytest.mark.parametrize("name", FLAGS)
@pytest.mark.parametrize("value", ["yes", 1, None, np.ones(2)])
def test_flags_of_a_run(name, value):
    with pytest.raises(TypeError, match=rf"^Argument `{name}` must be True or False, but it is "):
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
        (lambda: jaxball.verify.verify(DISK, TIMES, ROLLING, quick="no"), "quick"),
        (lambda: run().view(all_times="no"), "all_times"),
    ],
)
def test_other_flags(make, name):
    with pytest.raises(TypeError, match=rf"^Argument `{name}` must be True or False, but it is "):
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
        (lambda: jaxball.simulate(robot(jaxball.FunctionJointForce(pulled)), TIMES, of_one_joint()), "function"),
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
        (lambda: jaxball.classical.FunctionAxis(placed), "function"),
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
    assert told.startswith(f"Argument `{name}` must be a function that JAX can trace, but ")
    assert told.endswith("`jnp.where(condition, a, b)` for `if`.")
