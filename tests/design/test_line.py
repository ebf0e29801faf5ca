"""A disk rolls along e1: its places are single numbers, and what it cannot reach is refused."""

import functools
import tomllib

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.studies import design
from jaxball.studies.design import optimal_control
from jaxball.studies.design.files import read_control
from tests.support.sentences import refuses

DISK = """
format = 1

[scenario]
format = 1
kind = "disk"
body = { mass = 1.0, radius = 0.5, inertia = 1.0, gravity = 2.0 }
initial = { phidot = -0.8 }
time = { start = 0.0, end = 2.0, saves = 5 }

[[variables]]
path = "initial.phidot"

[[objectives]]
kind = "reach-place"
place = 2.0
"""
PLACE = 'kind = "reach-place"\nplace = 2.0'


def of_disk(objective):
    """The problem with another objective, or a constraint."""
    return design.read_problem(DISK.replace(PLACE, objective)).problem


def constrained(constraint):
    return f"{PLACE}\n\n[[constraints]]\n{constraint}"


def test_a_place_of_a_disk_is_one_number():
    np.testing.assert_array_equal(of_disk(PLACE).objectives["reach-place"].place, [2.0, 0.0])
    np.testing.assert_array_equal(design.ReachPlace(2.0).place, [2.0, 0.0])


@pytest.mark.parametrize(
    ("wanted", "key"),
    [
        ('kind = "reach-place"\nplace = [2.0, 0.5]', "objectives[0].place"),
        ('kind = "reach-place"\nplace = [2.0, 0.0]', "objectives[0].place"),
        ('kind = "reach-pose"\nversor = [1.0, 0.0, 0.2, 0.1]', "objectives[0].versor"),
        (
            'kind = "follow-curve"\ncurve = { kind = "sigmoid", length = 2.0, height = 0.5 }',
            "objectives[0].curve.height",
        ),
        (
            'kind = "follow-trajectory"\ncurve = { kind = "figure-eight", length = 2.0, origin = [0.0, 1.0] }',
            "objectives[0].curve.origin",
        ),
        (
            'kind = "largest-distance"\ncurve = { kind = "through", points = [[0.0, 0.0], [1.0, 0.5]] }',
            "objectives[0].curve.points",
        ),
        ('kind = "avoid-obstacles"\ncentres = [[1.0, 0.5]]\nradii = [0.2]', "objectives[0].centres"),
        (constrained('kind = "clear-of-obstacles"\ncentres = [[1.0, 0.5]]\nradii = [0.2]'), "constraints[0].centres"),
        (constrained('kind = "within"\nlower = [-1.0, -1.0]\nupper = 1.0'), "constraints[0].lower"),
    ],
)
def test_what_no_disk_can_reach_is_refused_by_its_key(wanted, key):
    with refuses(jaxball.ScenarioError, key):
        of_disk(wanted)


@pytest.mark.parametrize(
    "wanted",
    [
        'kind = "reach-pose"\nversor = [1.0, 0.0, 0.2, 0.0]',
        'kind = "follow-curve"\ncurve = { kind = "sigmoid", length = 2.0 }',
        'kind = "follow-trajectory"\ncurve = { kind = "figure-eight", length = 2.0, height = 0.0, origin = 1.0 }',
        'kind = "largest-distance"\ncurve = { kind = "through", points = [0.0, 1.0] }',
        'kind = "avoid-obstacles"\ncentres = [1.0]\nradii = [0.2]',
        constrained('kind = "clear-of-obstacles"\ncentres = [1.0]\nradii = [0.2]'),
        constrained('kind = "within"\nlower = -1.0\nupper = 1.0'),
    ],
)
def test_what_a_disk_can_reach_is_not(wanted):
    assert of_disk(wanted).objectives


@functools.cache
def space():
    return of_disk(PLACE).space


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        (design.ReachPlace((1.0, 0.5)), "a position 0.5 off e1"),
        (design.ReachPose((1.0, 0.1, 0.0, 0.0)), "a turn about another axis"),
        (design.FollowCurve(design.Sigmoid(2.0, 0.5)), "a position 0.5 off e1"),
        (design.FollowTrajectory(design.FigureEight(2.0, 0.0, (0.0, -1.0))), "a position 1 off e1"),
        (design.LargestDistance(design.Through([[0.0, 0.0], [1.0, 0.25]])), "a position 0.25 off e1"),
        (design.AvoidObstacles([[1.0, 0.5]], [0.2]), "a position 0.5 off e1"),
        (design.ClearOfObstacles([[1.0, 0.5]], [0.2]), "a position 0.5 off e1"),
        (design.Within((-1.0, -1.0), (1.0, 1.0)), "a range of e2"),
    ],
)
def test_python_refuses_it_too(wanted, words):
    given = {"objectives": {}, "constraints": {}}
    given["objectives" if isinstance(wanted, design.AbstractObjective) else "constraints"] = {"mine": wanted}
    with refuses(design.DesignError, "mine"):
        design.Problem(space(), **given)


class Circling(design.AbstractCurve):
    """A curve of one's own."""

    def __call__(self, s):
        return jnp.stack([jnp.cos(s), jnp.sin(s)])


def on_rail():
    mass = jaxball.PointMass(1.0, jaxball.OnRail(jaxball.Circle(0.3), jaxball.ConstantRate(-1.5)))
    return jaxball.Disk(mass=1.0, inertia=1.0, masses=[mass])


def test_so_does_optimal_control():
    with refuses(design.DesignError, "mine", "0.841471"):
        optimal_control.Rolling(on_rail(), (0.0, 1.0), {"mine": design.FollowTrajectory(Circling())})
    with refuses(design.DesignError, "place"):
        optimal_control.Rolling(on_rail(), (0.0, 1.0), {}, place=(1.0, 0.0))
    text = DISK.replace('[[variables]]\npath = "initial.phidot"', "[control]\nplace = [1.0, 0.0]")
    with refuses(jaxball.ScenarioError, "control.place"):
        read_control(tomllib.loads(text))


def test_a_ball_may_go_anywhere():
    text = DISK.replace('"disk"', '"ball"').replace("inertia = 1.0", "inertia = [1.0, 1.0, 1.0]")
    text = text.replace("phidot = -0.8", "Omega = [0.0, 0.8, 0.0]").replace("initial.phidot", "initial.Omega[1]")
    found = design.read_problem(text.replace("place = 2.0", "place = [2.0, 0.5]")).problem
    np.testing.assert_array_equal(found.objectives["reach-place"].place, [2.0, 0.5])


@pytest.mark.thorough
def test_a_disk_within_a_range():
    """z = 0.4 t, beyond −1 by nothing and beyond 0.6 by 0.2 at t = 2, in radii."""
    found = of_disk(constrained('kind = "within"\nlower = -1.0\nupper = 0.6'))
    run = found.run(jnp.asarray(found.space.start))
    seen = eqx.filter_jit(found.constraints["within"])(run)
    t = np.linspace(0.0, 2.0, 5)
    np.testing.assert_allclose(seen, np.stack([-1.0 - 0.4 * t, 0.4 * t - 0.6], axis=1) / 0.5, atol=1e-9)


def test_the_path_of_a_disk_is_identified_from_single_numbers():
    with refuses(design.DesignError, "path"):
        space().identify(np.zeros((5, 2)))


R, G = 0.5, 2.0
SECOND = np.sqrt(R / G)


@pytest.mark.parametrize(
    ("objective", "value", "words"),
    [
        (design.ReachPlace((1.0, 2.0)), 0.3**2 / R**2, "distance 0.3"),
        (design.ReachPose((1.0, 0.0, 0.0, 0.0)), np.sin(0.4 / 2) ** 2, "angle 0.4 rad"),
        (design.Balanced(), 0.1**2 / R**2, "horizontal distance 0.1"),
        (design.GoFar(), -3.0 / R, "distance 3"),
        (design.Duration(), 7.0 / SECOND, "time 7"),
        (design.FollowTrajectory(design.Sigmoid(1.0, 1.0)), 0.2**2 / R**2, "root mean square distance 0.2"),
        (design.FollowCurve(design.Sigmoid(1.0, 1.0)), 2 * 0.2**2 / R**2, "root mean square distance 0.2"),
        (design.LargestDistance(design.Sigmoid(1.0, 1.0)), 0.6 / R, "largest distance 0.6"),
        (design.AccelerationEffort(), 1.0, ""),
    ],
    ids=lambda x: type(x).__name__ if isinstance(x, design.AbstractObjective) else "",
)
def test_values_in_units_of_the_scenario(objective, value, words):
    """Those of test_objectives, whose closed forms say what they are."""
    assert objective.in_units(value, R, SECOND) == words
