"""What is wrong with the masses of a scenario file, or with its run, is one sentence that names the key."""

import pytest

from jaxball import ScenarioError, read_scenario
from tests.support.sentences import refuses

from .documents import BALL, DISK, edited, with_motion, with_rail, with_schedule

TUBE = '{ kind = "tube", direction = [1, 0, 0] }'
IN_TUBE = with_rail(TUBE)

RAILS = {
    "negative mass": (edited("mass = 0.5", "mass = -0.5"), "masses[0].mass"),
    "negative rail radius": (with_rail('{ kind = "circle", radius = -0.9 }'), "masses[0].rail.radius"),
    "rail off centre": (with_rail('{ kind = "circle", radius = 0.5, centre = [0, 0, 0.75] }'), "masses[0].rail"),
    "no direction": (with_rail('{ kind = "tube", direction = [0, 0, 0] }'), "masses[0].rail.direction"),
    "Fourier rail": (
        with_rail('{ kind = "fourier", cosine = [[0.1, 0, 0]], sine = [[0, 0.1, 0], [0, 0, 0]] }'),
        "masses[0].rail.sine",
    ),
    "spline through two points": (
        with_rail('{ kind = "spline", points = [[0, 0, 0.1], [0.1, 0, 0]] }'),
        "masses[0].rail.points",
    ),
    "no rotation": (
        with_rail('{ kind = "circle", radius = 0.9, frame = { matrix = [[1, 0, 0], [0, 1, 0], [0, 0, -1]] } }'),
        "masses[0].rail.frame.matrix",
    ),
    "elevation in degrees": (
        with_rail('{ kind = "circle", radius = 0.9, frame = { azimuth = 0.3, elevation = 90 } }'),
        "masses[0].rail.frame.elevation",
    ),
    "azimuth in degrees": (
        with_rail('{ kind = "circle", radius = 0.9, frame = { azimuth = -45.0, elevation = 0 } }'),
        "masses[0].rail.frame.azimuth",
    ),
    "zero versor": (
        with_rail('{ kind = "circle", radius = 0.9, frame = { versor = [0, 0, 0, 0] } }'),
        "masses[0].rail.frame.versor",
    ),
    "two frames": (
        with_rail('{ kind = "circle", radius = 0.9, frame = { azimuth = 0, versor = [1, 0, 0, 0] } }'),
        "masses[0].rail.frame",
    ),
    "position outside": (with_motion("position = [0.8, 0.8, 0]"), "masses[0].position"),
    "disk's position": (with_motion("position = [0.0, 0.5, 0.0]", DISK), "masses[0].position"),
    "disk's rail": (with_rail('{ kind = "tube", direction = [0, 1, 0] }', DISK), "masses[0].rail"),
}

MOTIONS = {
    "carried out of a tube": (
        with_schedule('{ kind = "constant-rate", theta = 0.5, rate = 0.4 }', IN_TUBE),
        "masses[0].schedule",
    ),
    "out for an instant": (
        # |chi| = 0.3 + 0.70001 sin t exceeds 1 for a few thousandths about t = pi/2.
        with_schedule('{ kind = "sinusoids", theta = 0.3, amplitude = [0.70001], frequency = [1] }', IN_TUBE),
        "masses[0].schedule",
    ),
    "free and out": (
        with_motion("free = { constant = [0.5, 0, 0], amplitude = [[1, 0, 0]], frequency = [1] }"),
        "masses[0].free",
    ),
    "pulse backwards": (with_schedule('{ kind = "pulse", theta = 0, start = 0.3 }'), "masses[0].schedule.hold"),
    "pulse without fall": (with_schedule('{ kind = "pulse", theta = 0, end = 0.1 }'), "masses[0].schedule.end"),
    "pieces": (
        with_schedule('{ kind = "piecewise-acceleration", theta = 0, times = [0, 1], accelerations = [[1], [2]] }'),
        "masses[0].schedule.accelerations",
    ),
    "times not increasing": (
        with_schedule('{ kind = "waypoints", times = [0, 2, 1], theta = [0, 1, 2] }'),
        "masses[0].schedule.times",
    ),
    "one waypoint": (with_schedule('{ kind = "waypoints", times = [0], theta = [0] }'), "masses[0].schedule.times"),
    "an angle too few": (
        with_schedule('{ kind = "waypoints", times = [0, 1], theta = [0] }'),
        "masses[0].schedule.theta",
    ),
}

SERVO = '[actuation]\nform = "servo"\n'

RUNS = {
    "unknown form": (BALL + '[actuation]\nform = "magic"', "actuation.form"),
    "gains of a prescribed motion": (
        BALL + '[actuation]\nform = "prescribed"\nstiffness = [1.0]',
        "actuation.stiffness",
    ),
    "gains too many": (BALL + SERVO + "stiffness = [1.0]\ndamping = [1.0, 2.0]", "actuation.damping"),
    "negative gain": (BALL + SERVO + "stiffness = [-1.0]\ndamping = [1.0]", "actuation.stiffness"),
    "no such mass": (BALL + '[actuation]\nform = "integrated"\nmasses = [1]', "actuation.masses"),
    "a mass twice": (BALL + '[actuation]\nform = "integrated"\nmasses = [0, 0]', "actuation.masses"),
    "nothing to integrate": (
        with_motion("position = [0, 0, 0]") + '[actuation]\nform = "integrated"',
        "actuation.form",
    ),
    "not a versor": (BALL + "[initial]\nversor = [1, 1, 0, 0]", "initial.versor"),
    "angles of prescribed masses": (BALL + "[initial]\ntheta = [0.1]", "initial.theta"),
    "starts outside": (IN_TUBE + '[initial]\ntheta = [1.5]\n[actuation]\nform = "integrated"', "initial.theta"),
    "balance of no mass": (BALL + "[initial]\nbalance = { masses = [3] }", "initial.balance.masses"),
    "balance and angles": (
        BALL + '[initial]\ntheta = [0.1]\nbalance = { masses = [0] }\n[actuation]\nform = "integrated"',
        "initial.balance",
    ),
    "above neither true nor false": (
        BALL + "[initial]\nbalance = { masses = [0], above = 1 }",
        "initial.balance.above",
    ),
    "backwards": (edited("end = 2.0", "end = -2.0"), "time.end"),
    "one save": (edited("saves = 5", "saves = 1"), "time.saves"),
    "half a save": (edited("saves = 5", "saves = 2.5"), "time.saves"),
    "more saves than numbers": (
        edited("start = 0.0\nend = 2.0", "start = 1.0\nend = 1.0000000000000002"),
        "time.saves",
    ),
    "step beside the span": (edited("saves = 5", "step = 0.3"), "time.step"),
    "one time": (edited("start = 0.0\nend = 2.0\nsaves = 5", "at = [1.0]"), "time.at"),
    "another solver": (BALL + '[solve]\nsolver = "euler"', "solve.solver"),
    "a DAE by a solver for ODEs": (BALL + '[solve]\nsolver = "gauss16"\ndae = true', "solve.solver"),
    "a DAE of a disk": (DISK + '[solve]\nsolver = "radau5"\ndae = true', "solve.dae"),
    "a projection of a disk": (DISK + "[solve]\nproject = true", "solve.project"),
    "no tolerance": (BALL + "[solve]\nrtol = 0.0", "solve.rtol"),
    "no length of steps": (BALL + "[solve]\nmax_step = 0.0", "solve.max_step"),
    "no steps": (BALL + "[solve]\nmax_steps = 0", "solve.max_steps"),
}

CASES = RAILS | MOTIONS | RUNS


@pytest.mark.thorough
@pytest.mark.parametrize(("text", "named"), CASES.values(), ids=CASES.keys())
def test_sentence(text, named):
    with refuses(ScenarioError, named):
        read_scenario(text)


def test_rail_too_large():
    """A circle about the centre is as far from it everywhere, so no certain theta is named."""
    with refuses(ScenarioError, "masses[0].rail"):
        read_scenario(with_rail('{ kind = "circle", radius = 1.25 }'))


@pytest.mark.thorough
def test_balance_without_solution():
    heavy = with_rail(
        '{ kind = "circle", radius = 0.1 }', edited("gravity = 1.0", "gravity = 1.0\noffset = [0, 0.5, 0]")
    )
    with refuses(ScenarioError, "initial.balance"):
        read_scenario(heavy + "[initial]\nbalance = { masses = [0] }")
