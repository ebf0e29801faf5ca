"""What is wrong with mechanisms, ground, resistance or a linear law in a file is one sentence that names the key."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import CarriedMass, Hinge, Mechanism
from jaxball.scenario import Scenario, ScenarioError, builtin_text, read_scenario, write_scenario
from jaxball.scenario.checks import key_of
from jaxball.scenario.errors import all_problems

from .documents import BALL
from .test_mechanisms_in_files import PENDULUM, TURNING, with_drive, with_parts

SLOPE = builtin_text("pendulum-on-a-slope")
JOINT = "Key `mechanisms[0].joints[0]"
TWO_JOINTS = PENDULUM.replace("axis = [0, 1, 0] }", 'axis = [0, 1, 0] }, { kind = "hinge", axis = [1, 0, 0] }')


def with_force(force):
    return with_drive(f"force = {force}")


def with_law(law, joint="accelerated = true"):
    return with_drive(joint) + f"[actuation]\n{law}\n"


CASES = {
    "misspelt kind": (
        with_parts(PENDULUM.replace("hinge", "hing")),
        f'{JOINT}.kind` cannot be "hing"; did you mean "hinge"?',
    ),
    "misspelt key of a joint": (
        with_drive("pointt = [0, 0, 0]"),
        f"{JOINT}.pointt` is not known; did you mean `point`?",
    ),
    "misspelt key of a mechanism": (
        with_parts(PENDULUM.replace("joints", "joint")),
        "Key `mechanisms[0].joint` is not known; did you mean `joints`?",
    ),
    "no axis": (with_parts(PENDULUM.replace(", axis = [0, 1, 0]", "")), f"{JOINT}.axis` must be a list of 3 finite "),
    "an axis of length 0": (
        with_parts(PENDULUM.replace("axis = [0, 1, 0]", "axis = [0, 0, 0]")),
        f"{JOINT}.axis` must be a direction, three finite numbers that are not all 0, but it is [0, 0, 0].",
    ),
    "no joints": (
        with_parts("[[mechanisms]]\njoints = []\nmasses = [{ mass = 1 }]"),
        "Key `mechanisms[0].joints` must be a list of tables, each under the heading [[mechanisms.joints]], but ",
    ),
    "a circle of joints": (
        with_drive("on = 0"),
        f"{JOINT}.on` must be the index of a joint before it, or -1 for the body, but it is 0, so that joints would "
        "carry each other in a circle; list a joint after the one that carries it.",
    ),
    "a mass on no joint": (
        with_parts(PENDULUM.replace("mass = 0.5", "mass = 0.5, joint = 2")),
        "Key `mechanisms[0].masses[0].joint` must be the index of one of the 1 joints, but it is 2.",
    ),
    "a joint without masses": (
        with_parts(TWO_JOINTS.replace("mass = 0.5", "mass = 0.5, joint = 0")),
        "Key `mechanisms[0].joints[1]` must move some mass, but it carries none; give it a mass, or leave it out.",
    ),
    "a mass on the axis": (
        with_parts(PENDULUM.replace("[0, 0, -0.6]", "[0, 0.5, 0]")),
        f"{JOINT}` must be a joint that moves some mass in a way that those before it do not, with a positive inertia "
        "of its own",
    ),
    "a mass outside": (
        with_parts(PENDULUM.replace("-0.6", "-1.6")),
        "Key `mechanisms[0]` must keep its masses inside the shell of radius 1, with end stops if need be, but mass 0 ",
    ),
    "a negative mass": (
        with_parts(PENDULUM.replace("mass = 0.5", "mass = -0.5")),
        "Key `mechanisms[0].masses[0].mass` must be a positive number, but it is -0.5.",
    ),
    "a force and a schedule": (
        with_drive('schedule = { kind = "pulse", theta = 0 }, force = { kind = "motor", signal = 0 }'),
        f"{JOINT}.schedule` must not be combined with `force`, because a joint moves either by a prescribed motion or "
        "under forces; ",
    ),
    "no force": (with_force("1.0"), f"{JOINT}.force` must be a table, or a list of tables whose forces add up, but "),
    "no kind of force": (
        with_force('{ kind = "sprint", stiffness = 1 }'),
        f'{JOINT}.force.kind` cannot be "sprint"; did you mean "spring"?',
    ),
    "a key of another force": (
        with_force('[{ kind = "spring", stiffness = 1 }, { kind = "damper", stiffness = 1 }]'),
        f"{JOINT}.force[1].stiffness` is not known; the keys here are coefficient, negative.",
    ),
    "a negative damper": (
        with_force('[{ kind = "spring", stiffness = 1 }, { kind = "damper", coefficient = -1 }]'),
        f"{JOINT}.force[1].coefficient` must be 0 or positive, unless `negative` allows it, but it is -1.0.",
    ),
    "a negative limit": (
        with_force('{ kind = "motor", signal = 1, limit = -1 }'),
        f"{JOINT}.force.limit` must be 0 or positive, but it is -1.0.",
    ),
    "less static than kinetic friction": (
        with_force('{ kind = "joint-friction", kinetic = 0.7, static = 0.65 }'),
        f"{JOINT}.force.static` must be a positive number, not less than `kinetic`, but it is 0.65.",
    ),
    "a fraction for an exponent": (
        with_force('{ kind = "joint-friction", kinetic = 0.7, exponent = 1.5 }'),
        f"{JOINT}.force.exponent` must be a whole number from 1 to 100, but it is 1.5.",
    ),
    "a law that falls from the start": (
        with_force('{ kind = "majd-simaan-friction", viscous = 0, kinetic = 1, peak = 1, rate = 1, steepness = 0.5 }'),
        f"{JOINT}.force.steepness` must be 1 or more, but it is 0.5.",
    ),
    "end stops the wrong way round": (
        with_force('{ kind = "end-stops", lower = 1, upper = -1, stiffness = 2 }'),
        f"{JOINT}.force.lower` must be less than `upper`, but it is 1.0.",
    ),
    "a text for a signal": (
        with_force('{ kind = "motor", signal = "full" }'),
        f'{JOINT}.force.signal` must be a finite number, or the table of a signal or a schedule, but it is "full".',
    ),
    "too many steps": (
        with_force('{ kind = "motor", signal = { kind = "steps", times = [0, 1], values = [1, 2] } }'),
        f"{JOINT}.force.signal.values` must be a list with a number for each interval between the 2 `times`, but it is "
        "one of 2 numbers.",
    ),
    "no law": (
        with_drive("accelerated = true"),
        'Key `actuation.form` must be one of "integrated", "servo", "linear", because a law accelerates '
        'mechanisms[0].joints[0], but it is "prescribed".',
    ),
    "nothing to follow": (
        with_law('form = "integrated"'),
        f'{JOINT}.schedule` must be a table where `actuation.form` is "integrated", which follows it, but it is ',
    ),
    "gains for joints": (
        with_law('form = "servo"\nstiffness = [1, 2]\ndamping = [1]', TURNING),
        "Key `actuation.stiffness` must be a list of 1 number, one for each of mechanisms[0].joints[0], but it is one ",
    ),
    "nothing to drive": (
        BALL + '[actuation]\nform = "integrated"\nmasses = []\n',
        "Key `actuation.masses` must be a list of increasing whole numbers, one or more, each the number of a mass ",
    ),
    "a linear law for nothing": (
        BALL + '[actuation]\nform = "linear"\nsignals = [1]\n',
        'Key `actuation.form` must be "prescribed" where something else moves every mass and joint, but it is '
        '"linear".',
    ),
    "an empty linear law": (
        with_law('form = "linear"'),
        "Key `actuation` must have one or more of the keys theta, thetadot, Omega, Gamma, z, omega, signals, but it "
        "has none.",
    ),
    "a linear law beside a schedule": (
        with_law('form = "linear"\nsignals = [1]', TURNING),
        f'{JOINT}.schedule` must be left out where `actuation.form` is "linear", which follows no schedule; give ',
    ),
    "a factor of another shape": (
        with_law('form = "linear"\nOmega = [[1, 2]]'),
        "Key `actuation.Omega` must be 1 by 3 numbers, a row for each of mechanisms[0].joints[0], but it is 1 by 2.",
    ),
    "too many signals": (
        with_law('form = "linear"\nsignals = [1, 2]'),
        "Key `actuation.signals` must be a list of 1, one for each of mechanisms[0].joints[0], but it is one of 2.",
    ),
    "a rail without a schedule": (
        BALL.replace('schedule = { kind = "constant-rate", theta = 0.7, rate = 0.2 }\n', ""),
        "Key `masses[0].schedule` must be a table, but it is missing.",
    ),
    "angles of joints": (
        with_parts(PENDULUM, "[initial]\ntheta = [0.1, 0.2]"),
        "Key `initial.theta` must be a list of 1 number, those of mechanisms[0].joints[0], but it is one of 2.",
    ),
    "a slope in degrees": (
        with_parts("[ground]\nangle = 30"),
        "Key `ground.angle` must be a finite number of radians from -π/2 to π/2, but it is 30; 30 degrees are "
        "0.52359878 radians.",
    ),
    "a wall": (
        with_parts("[ground]\nangle = 1.5708"),
        "Key `ground.angle` must be an angle of less than a right angle, π/2, either way, but it is 1.5708.",
    ),
    "two motions of the ground": (
        with_parts("[ground]\nmotion = { position = [0, 0, 0], free = { constant = [0, 0, 0] } }"),
        "Key `ground.motion` must have exactly one of the keys `rail`, `position`, `free`, but it has `position` and ",
    ),
    "a misspelt turntable": (
        with_parts("[ground]\nturntabel = {}"),
        "Key `ground.turntabel` is not known; did you mean `turntable`?",
    ),
    "negative resistance": (
        with_parts("[resistance]\nrolling = -0.1"),
        "Key `resistance.rolling` must be 0 or positive, unless `negative` allows it, but it is -0.1.",
    ),
    "no smoothing": (
        with_parts("[resistance]\ndry = 0.1\nsmoothing = 0"),
        "Key `resistance.smoothing` must be a positive number, but it is 0.0.",
    ),
    "exact resistance of none": (
        with_parts("[resistance]\nrolling = 0.1\nexact = true"),
        "Key `resistance.exact` must be false where there is no dry friction, but it is true; give `resistance.dry`",
    ),
    "exact resistance of 0": (
        with_parts("[resistance]\ndry = 0\nexact = true"),
        "Key `resistance.dry` must be a positive number, as it is `exact`, but it is 0.0.",
    ),
    "powers in two dimensions": (
        with_parts("[force]\npowers = [[1, 2]]"),
        "Key `force.powers` must be a list of rows of 3 finite numbers, but it is [[1, 2]].",
    ),
    "powers out of a disk's plane": (
        with_parts("[force]\npowers = [[0, 1, 0]]").replace('"ball"', '"disk"').replace("[0.9, 1.0, 1.1]", "1.0"),
        "Key `force.powers` must be in the plane of a disk, E1 and E3, with second entry 0, but it is [[0, 1, 0]].",
    ),
}


@pytest.mark.thorough
@pytest.mark.parametrize(("text", "sentence"), CASES.values(), ids=CASES.keys())
def test_sentence(text, sentence):
    with pytest.raises(ScenarioError) as caught:
        read_scenario(text)
    assert str(caught.value).startswith(sentence)
    assert str(caught.value).endswith((".", "?"))


def test_all_problems_at_once():
    text = SLOPE.replace("angle = 0.1", "angle = 2").replace("dry = 0.02", "dry = -1").replace("mass = 0.5", "mass = 0")
    with all_problems() as problems:
        read_scenario(text.replace("coefficient = 0.05", "coefficient = -0.05"))
    keys = ("ground.angle", "resistance.dry", "mechanisms[0].joints[0].force[1].coefficient", "mechanisms[0].masses[0]")
    assert [str(problem).split("`")[1].removesuffix(".mass") for problem in problems] == list(keys)


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("ground.angle", "ground.angle"),
        ("resistance.rolling", "resistance.rolling"),
        ("mechanisms[0].joints[1]", "mechanisms[0].joints[1]"),
        ("mechanisms[0].joints[1].drive.limit", "mechanisms[0].joints[1].force.limit"),
        ("mechanisms[0].joints[1].drive.terms[2].lower", "mechanisms[0].joints[1].force[2].lower"),
        ("masses[0].motion.rail", "masses[0].rail"),
        ("state.theta", "initial.theta"),
    ],
)
def test_keys_of_names_in_python(name, key):
    assert key_of(name) == key


def nowhere(*_):
    return jnp.zeros(3)


def nothing(*_):
    return jnp.zeros(())


def hanging(drive):
    return {"mechanisms": [Mechanism([Hinge((0.0, 1.0, 0.0), drive=drive)], [CarriedMass(0.5, (0.0, 0.0, -0.6))])]}


def on_a_circle(theta, radius):
    return radius * jnp.stack([jnp.cos(theta[0]), 0.0 * theta[0], jnp.sin(theta[0])])[None]


IN_PYTHON = {
    "force on a joint": (
        hanging(jaxball.FunctionJointForce(nothing)),
        "Key `mechanisms[0].joints[0].force` must be one of Motor, Spring, Damper, SpeedLimitedMotor, PDServo, ",
    ),
    "mechanism": (
        {"mechanisms": [jaxball.FunctionMechanism(on_a_circle, [0.2], [None], 0.5)]},
        "Key `mechanisms[0]` must be one of Mechanism to be written to a file, but it is a FunctionMechanism; keep ",
    ),
    "motion of the ground": (
        {"ground": jaxball.Ground(motion=jaxball.Free(nowhere))},
        "Key `ground.motion` must be on a rail, at a position or oscillating to be written to a file, but its motion ",
    ),
}


@pytest.mark.parametrize(("parts", "sentence"), IN_PYTHON.values(), ids=IN_PYTHON.keys())
def test_python_function_has_no_place_in_a_file(parts, sentence):
    system = jaxball.Ball(mass=1.0, inertia=(1.0, 1.0, 1.0), **parts)
    with pytest.raises(ScenarioError) as caught:
        write_scenario(Scenario("", system, jaxball.BallState(), np.array([0.0, 1.0])))
    assert str(caught.value).startswith(sentence)
