"""What is wrong with the masses of a scenario file, or with its run, is one sentence that names the key."""

import pytest

from jaxball.scenario import ScenarioError, read_scenario

from .documents import BALL, DISK, edited, with_motion, with_rail, with_schedule

TUBE = '{ kind = "tube", direction = [1, 0, 0] }'
IN_TUBE = with_rail(TUBE)

RAILS = {
    "negative mass": (
        edited("mass = 0.5", "mass = -0.5"),
        "Key `masses[0].mass` must be a positive number, but it is -0.5.",
    ),
    "negative rail radius": (
        with_rail('{ kind = "circle", radius = -0.9 }'),
        "Key `masses[0].rail.radius` must be a positive number, but it is -0.9.",
    ),
    "rail off centre": (
        with_rail('{ kind = "circle", radius = 0.5, centre = [0, 0, 0.75] }'),
        "Key `masses[0].rail` must be a curve inside the shell of radius 1, but it is 1.25 from the "
        "centre at "
        "theta = 1.5708.",
    ),
    "no direction": (
        with_rail('{ kind = "tube", direction = [0, 0, 0] }'),
        "Key `masses[0].rail.direction` must be a direction, three finite numbers that are not all 0, but it is "
        "[0, 0, 0].",
    ),
    "Fourier rail": (
        with_rail('{ kind = "fourier", cosine = [[0.1, 0, 0]], sine = [[0, 0.1, 0], [0, 0, 0]] }'),
        "Key `masses[0].rail.sine` must be as long as `cosine`, which has 1 row, but it is one of 2.",
    ),
    "spline through two points": (
        with_rail('{ kind = "spline", points = [[0, 0, 0.1], [0.1, 0, 0]] }'),
        "Key `masses[0].rail.points` must be a list of three points or more, but it is one of 2.",
    ),
    "no rotation": (
        with_rail('{ kind = "circle", radius = 0.9, frame = { matrix = [[1, 0, 0], [0, 1, 0], [0, 0, -1]] } }'),
        "Key `masses[0].rail.frame.matrix` must be a rotation matrix, whose columns are orthonormal "
        "and whose "
        "determinant is 1, but it is [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]].",
    ),
    "elevation in degrees": (
        with_rail('{ kind = "circle", radius = 0.9, frame = { azimuth = 0.3, elevation = 90 } }'),
        "Key `masses[0].rail.frame.elevation` must be a finite number of radians from -π/2 to π/2, but it is 90; 90 "
        "degrees are 1.5707963 radians.",
    ),
    "azimuth in degrees": (
        with_rail('{ kind = "circle", radius = 0.9, frame = { azimuth = -45.0, elevation = 0 } }'),
        "Key `masses[0].rail.frame.azimuth` must be a finite number of radians from -2π to 2π, but it is -45.0; -45.0 "
        "degrees are -0.78539816 radians.",
    ),
    "zero versor": (
        with_rail('{ kind = "circle", radius = 0.9, frame = { versor = [0, 0, 0, 0] } }'),
        "Key `masses[0].rail.frame.versor` must be a list of 4 finite numbers, not all zero, but it is [0, 0, 0, 0].",
    ),
    "two frames": (
        with_rail('{ kind = "circle", radius = 0.9, frame = { azimuth = 0, versor = [1, 0, 0, 0] } }'),
        "Key `masses[0].rail.frame` must have exactly one of the keys `azimuth`, `versor`, `matrix`, "
        "but it has "
        "`azimuth` and `versor`.",
    ),
    "position outside": (
        with_motion("position = [0.8, 0.8, 0]"),
        "Key `masses[0].position` must be a point inside the shell of radius 1, but it is [0.8, 0.8, 0.0].",
    ),
    "disk's position": (
        with_motion("position = [0.0, 0.5, 0.0]", DISK),
        "Key `masses[0].position` must lie in the plane of a disk, E1 and E3, but it passes [0.0, 0.5, 0.0].",
    ),
    "disk's rail": (
        with_rail('{ kind = "tube", direction = [0, 1, 0] }', DISK),
        "Key `masses[0].rail` must lie in the plane of a disk, E1 and E3, but it passes [0.0, 1.0, 0.0].",
    ),
}

MOTIONS = {
    "carried out of a tube": (
        with_schedule('{ kind = "constant-rate", theta = 0.5, rate = 0.4 }', IN_TUBE),
        "Key `masses[0].schedule` must keep the mass inside the shell of radius 1 from t = 0 to t = "
        "2, but the "
        "mass leaves it at t = 1.25, and is 1.3 from the centre at t = 2.",
    ),
    "out for an instant": (
        # |chi| = 0.3 + 0.70001 sin t exceeds 1 for a few thousandths about t = pi/2.
        with_schedule('{ kind = "sinusoids", theta = 0.3, amplitude = [0.70001], frequency = [1] }', IN_TUBE),
        "Key `masses[0].schedule` must keep the mass inside the shell of radius 1 from t = 0 to t = "
        "2, but the "
        "mass leaves it at t = 1.56545, and is 1.00001 from the centre at t = 1.5708.",
    ),
    "free and out": (
        with_motion("free = { constant = [0.5, 0, 0], amplitude = [[1, 0, 0]], frequency = [1] }"),
        "Key `masses[0].free` must keep the mass inside the shell of radius 1 from t = 0 to t = 2, "
        "but the mass "
        "leaves it at t = 0.523599, and is 1.5 from the centre at t = 1.5708.",
    ),
    "pulse backwards": (
        with_schedule('{ kind = "pulse", theta = 0, start = 0.3 }'),
        "Key `masses[0].schedule.hold` must be not before `start` = 0.3, but it is 0.1.",
    ),
    "pulse without fall": (
        with_schedule('{ kind = "pulse", theta = 0, end = 0.1 }'),
        "Key `masses[0].schedule.end` must be later than `hold` = 0.1, but it is 0.1.",
    ),
    "pieces": (
        with_schedule('{ kind = "piecewise-acceleration", theta = 0, times = [0, 1], accelerations = [[1], [2]] }'),
        "Key `masses[0].schedule.accelerations` must be a list with a row for each interval between the 2 "
        "`times`, but it is one of 2 rows.",
    ),
    "times not increasing": (
        with_schedule('{ kind = "waypoints", times = [0, 2, 1], theta = [0, 1, 2] }'),
        "Key `masses[0].schedule.times` must be a list of increasing numbers, but it is [0, 2, 1].",
    ),
    "one waypoint": (
        with_schedule('{ kind = "waypoints", times = [0], theta = [0] }'),
        "Key `masses[0].schedule.times` must be a list of two times or more, but it is one of 1.",
    ),
    "an angle too few": (
        with_schedule('{ kind = "waypoints", times = [0, 1], theta = [0] }'),
        "Key `masses[0].schedule.theta` must be as long as `times`, which has 2 entries, but it is one of 1.",
    ),
}

SERVO = '[actuation]\nform = "servo"\n'

RUNS = {
    "unknown form": (
        BALL + '[actuation]\nform = "magic"',
        'Key `actuation.form` must be one of "prescribed", "integrated", "servo", "linear", but it is "magic".',
    ),
    "gains of a prescribed motion": (
        BALL + '[actuation]\nform = "prescribed"\nstiffness = [1.0]',
        "Key `actuation.stiffness` is not known; there are no keys here.",
    ),
    "gains too many": (
        BALL + SERVO + "stiffness = [1.0]\ndamping = [1.0, 2.0]",
        "Key `actuation.damping` must be a list of 1 number, one for each driven mass, but it is one of 2.",
    ),
    "negative gain": (
        BALL + SERVO + "stiffness = [-1.0]\ndamping = [1.0]",
        "Key `actuation.stiffness` must be a list of non-negative numbers, but it is [-1.0].",
    ),
    "no such mass": (
        BALL + '[actuation]\nform = "integrated"\nmasses = [1]',
        "Key `actuation.masses` must be masses on rails, which are [0], but it is [1].",
    ),
    "a mass twice": (
        BALL + '[actuation]\nform = "integrated"\nmasses = [0, 0]',
        "Key `actuation.masses` must be a list of increasing whole numbers, one or more, each the number of "
        "a mass counted from 0, but it is [0, 0].",
    ),
    "nothing to integrate": (
        with_motion("position = [0, 0, 0]") + '[actuation]\nform = "integrated"',
        'Key `actuation.form` must be "prescribed" where no mass is on a rail, but it is "integrated".',
    ),
    "not a versor": (
        BALL + "[initial]\nversor = [1, 1, 0, 0]",
        "Key `initial.versor` must be a versor, whose four numbers have squares that add up to 1, but it is "
        "[1.0, 1.0, 0.0, 0.0].",
    ),
    "angles of prescribed masses": (
        BALL + "[initial]\ntheta = [0.1]",
        "Key `initial.theta` must be a list of 0 numbers, one for each mass that a law drives, but it is one of 1.",
    ),
    "starts outside": (
        IN_TUBE + '[initial]\ntheta = [1.5]\n[actuation]\nform = "integrated"',
        "Key `initial.theta` must be angles at which each mass is inside the shell of radius 1, but "
        "it is [1.5], "
        "which puts mass 0 at the distance 1.5 from the centre.",
    ),
    "balance of no mass": (
        BALL + "[initial]\nbalance = { masses = [3] }",
        "Key `initial.balance.masses` must be masses on rails, which are [0], but it is [3].",
    ),
    "balance and angles": (
        BALL + '[initial]\ntheta = [0.1]\nbalance = { masses = [0] }\n[actuation]\nform = "integrated"',
        "Key `initial.balance` must not be combined with `theta`, because it finds the angles.",
    ),
    "above neither true nor false": (
        BALL + "[initial]\nbalance = { masses = [0], above = 1 }",
        "Key `initial.balance.above` must be true or false, but it is 1.",
    ),
    "backwards": (
        edited("end = 2.0", "end = -2.0"),
        "Key `time.end` must be later than `start` = 0.0, but it is -2.0.",
    ),
    "one save": (
        edited("saves = 5", "saves = 1"),
        "Key `time.saves` must be a whole number from 2 to 10000000, but it is 1.",
    ),
    "half a save": (
        edited("saves = 5", "saves = 2.5"),
        "Key `time.saves` must be a whole number from 2 to 10000000, but it is 2.5.",
    ),
    "more saves than numbers": (
        edited("start = 0.0\nend = 2.0", "start = 1.0\nend = 1.0000000000000002"),
        "Key `time.saves` must be few enough for the times to differ, but it is 5.",
    ),
    "step beside the span": (
        edited("saves = 5", "step = 0.3"),
        "Key `time.step` must be the span from 0.0 to 2.0 divided by a whole number of at most 10000000, "
        "but it is 0.3.",
    ),
    "one time": (
        edited("start = 0.0\nend = 2.0\nsaves = 5", "at = [1.0]"),
        "Key `time.at` must be a list of two times or more, but it is [1.0].",
    ),
    "another solver": (
        BALL + '[solve]\nsolver = "euler"',
        'Key `solve.solver` must be one of "dopri5", "dopri8", "tsit5", "kvaerno3", "kvaerno5", "adams", "radau5", '
        '"radau9", "radau13", "ndf", "gauss16", "trapezoidal", "tr-bdf2", but it is "euler".',
    ),
    "a DAE by a solver for ODEs": (
        BALL + '[solve]\nsolver = "gauss16"\ndae = true',
        'Key `solve.solver` must be one of "radau5", "radau9", "radau13", "ndf" where `solve.dae` is true, because '
        'other solvers do not support a mass matrix, but it is "gauss16".',
    ),
    "a DAE of a disk": (
        DISK + '[solve]\nsolver = "radau5"\ndae = true',
        "Key `solve.dae` must be false for a disk, whose state has no versor, but it is true; use a ball.",
    ),
    "no tolerance": (
        BALL + "[solve]\nrtol = 0.0",
        "Key `solve.rtol` must be a positive number, but it is 0.0.",
    ),
    "no length of steps": (
        BALL + "[solve]\nmax_step = 0.0",
        "Key `solve.max_step` must be a positive number, but it is 0.0.",
    ),
    "no steps": (
        BALL + "[solve]\nmax_steps = 0",
        "Key `solve.max_steps` must be a whole number from 1 to 1000000000, but it is 0.",
    ),
}

CASES = RAILS | MOTIONS | RUNS


@pytest.mark.thorough
@pytest.mark.parametrize(("text", "sentence"), CASES.values(), ids=CASES.keys())
def test_sentence(text, sentence):
    with pytest.raises(ScenarioError) as caught:
        read_scenario(text)
    assert str(caught.value) == sentence


def test_rail_too_large():
    """A circle about the centre is as far from it everywhere, so no certain theta is named."""
    with pytest.raises(ScenarioError, match=r"^Key `masses\[0\].rail` must be a curve inside .* it is 1.25 from"):
        read_scenario(with_rail('{ kind = "circle", radius = 1.25 }'))


@pytest.mark.thorough
def test_balance_without_solution():
    heavy = with_rail(
        '{ kind = "circle", radius = 0.1 }', edited("gravity = 1.0", "gravity = 1.0\noffset = [0, 0.5, 0]")
    )
    with pytest.raises(ScenarioError, match=r"^Key `initial.balance` has no solution: No angles of these masses"):
        read_scenario(heavy + "[initial]\nbalance = { masses = [0] }")
