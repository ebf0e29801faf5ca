"""What is wrong with mechanisms, ground, resistance or a linear law in a file is one sentence that names the key."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import CarriedMass, Hinge, Mechanism, Scenario, ScenarioError, read_scenario, write_scenario
from jaxball.files.scenario.checks import key_of
from jaxball.files.scenario.errors import all_problems
from jaxball.files.scenario.sources import builtin_text
from tests.support.sentences import refuses

from .documents import BALL
from .test_mechanisms_in_files import PENDULUM, TURNING, with_drive, with_parts

SLOPE = builtin_text("pendulum-on-a-slope")
JOINT = "mechanisms[0].joints[0]"
TWO_JOINTS = PENDULUM.replace("axis = [0, 1, 0] }", 'axis = [0, 1, 0] }, { kind = "hinge", axis = [1, 0, 0] }')


def with_force(force):
    return with_drive(f"force = {force}")


def with_law(law, joint="accelerated = true"):
    return with_drive(joint) + f"[actuation]\n{law}\n"


CASES = {
    "misspelt kind": (with_parts(PENDULUM.replace("hinge", "hing")), f"{JOINT}.kind"),
    "misspelt key of a joint": (with_drive("pointt = [0, 0, 0]"), f"{JOINT}.pointt"),
    "misspelt key of a mechanism": (with_parts(PENDULUM.replace("joints", "joint")), "mechanisms[0].joint"),
    "no axis": (with_parts(PENDULUM.replace(", axis = [0, 1, 0]", "")), f"{JOINT}.axis"),
    "an axis of length 0": (with_parts(PENDULUM.replace("axis = [0, 1, 0]", "axis = [0, 0, 0]")), f"{JOINT}.axis"),
    "no joints": (with_parts("[[mechanisms]]\njoints = []\nmasses = [{ mass = 1 }]"), "mechanisms[0].joints"),
    "a circle of joints": (with_drive("on = 0"), f"{JOINT}.on"),
    "a mass on no joint": (
        with_parts(PENDULUM.replace("mass = 0.5", "mass = 0.5, joint = 2")),
        "mechanisms[0].masses[0].joint",
    ),
    "a joint without masses": (
        with_parts(TWO_JOINTS.replace("mass = 0.5", "mass = 0.5, joint = 0")),
        "mechanisms[0].joints[1]",
    ),
    "a mass on the axis": (with_parts(PENDULUM.replace("[0, 0, -0.6]", "[0, 0.5, 0]")), JOINT),
    "a mass outside": (with_parts(PENDULUM.replace("-0.6", "-1.6")), "mechanisms[0]"),
    "a negative mass": (with_parts(PENDULUM.replace("mass = 0.5", "mass = -0.5")), "mechanisms[0].masses[0].mass"),
    "a force and a schedule": (
        with_drive('schedule = { kind = "pulse", theta = 0 }, force = { kind = "motor", signal = 0 }'),
        f"{JOINT}.schedule",
    ),
    "no force": (with_force("1.0"), f"{JOINT}.force"),
    "no kind of force": (with_force('{ kind = "sprint", stiffness = 1 }'), f"{JOINT}.force.kind"),
    "a key of another force": (
        with_force('[{ kind = "spring", stiffness = 1 }, { kind = "damper", stiffness = 1 }]'),
        f"{JOINT}.force[1].stiffness",
    ),
    "a negative damper": (
        with_force('[{ kind = "spring", stiffness = 1 }, { kind = "damper", coefficient = -1 }]'),
        f"{JOINT}.force[1].coefficient",
    ),
    "a negative limit": (with_force('{ kind = "motor", signal = 1, limit = -1 }'), f"{JOINT}.force.limit"),
    "less static than kinetic friction": (
        with_force('{ kind = "joint-friction", kinetic = 0.7, static = 0.65 }'),
        f"{JOINT}.force.static",
    ),
    "a fraction for an exponent": (
        with_force('{ kind = "joint-friction", kinetic = 0.7, exponent = 1.5 }'),
        f"{JOINT}.force.exponent",
    ),
    "a law that falls from the start": (
        with_force('{ kind = "majd-simaan-friction", viscous = 0, kinetic = 1, peak = 1, rate = 1, steepness = 0.5 }'),
        f"{JOINT}.force.steepness",
    ),
    "end stops the wrong way round": (
        with_force('{ kind = "end-stops", lower = 1, upper = -1, stiffness = 2 }'),
        f"{JOINT}.force.lower",
    ),
    "a text for a signal": (with_force('{ kind = "motor", signal = "full" }'), f"{JOINT}.force.signal"),
    "too many steps": (
        with_force('{ kind = "motor", signal = { kind = "steps", times = [0, 1], values = [1, 2] } }'),
        f"{JOINT}.force.signal.values",
    ),
    "no law": (with_drive("accelerated = true"), "actuation.form"),
    "nothing to follow": (with_law('form = "integrated"'), f"{JOINT}.schedule"),
    "gains for joints": (with_law('form = "servo"\nstiffness = [1, 2]\ndamping = [1]', TURNING), "actuation.stiffness"),
    "nothing to drive": (BALL + '[actuation]\nform = "integrated"\nmasses = []\n', "actuation.masses"),
    "a linear law for nothing": (BALL + '[actuation]\nform = "linear"\nsignals = [1]\n', "actuation.form"),
    "an empty linear law": (with_law('form = "linear"'), "actuation"),
    "a linear law beside a schedule": (with_law('form = "linear"\nsignals = [1]', TURNING), f"{JOINT}.schedule"),
    "a factor of another shape": (with_law('form = "linear"\nOmega = [[1, 2]]'), "actuation.Omega"),
    "too many signals": (with_law('form = "linear"\nsignals = [1, 2]'), "actuation.signals"),
    "a rail without a schedule": (
        BALL.replace('schedule = { kind = "constant-rate", theta = 0.7, rate = 0.2 }\n', ""),
        "masses[0].schedule",
    ),
    "angles of joints": (with_parts(PENDULUM, "[initial]\ntheta = [0.1, 0.2]"), "initial.theta"),
    "a slope in degrees": (with_parts("[ground]\nangle = 30"), "ground.angle"),
    "a wall": (with_parts("[ground]\nangle = 1.5708"), "ground.angle"),
    "two motions of the ground": (
        with_parts("[ground]\nmotion = { position = [0, 0, 0], free = { constant = [0, 0, 0] } }"),
        "ground.motion",
    ),
    "a misspelt turntable": (with_parts("[ground]\nturntabel = {}"), "ground.turntabel"),
    "negative resistance": (with_parts("[resistance]\nrolling = -0.1"), "resistance.rolling"),
    "no smoothing": (with_parts("[resistance]\ndry = 0.1\nsmoothing = 0"), "resistance.smoothing"),
    "exact resistance of none": (with_parts("[resistance]\nrolling = 0.1\nexact = true"), "resistance.exact"),
    "exact resistance of 0": (with_parts("[resistance]\ndry = 0\nexact = true"), "resistance.dry"),
    "static friction below that in motion": (
        with_parts("[resistance]\ndry = 0.2\nstatic_dry = 0.1\nexact = true"),
        "resistance.static_dry",
    ),
    "static friction that is smoothed": (
        with_parts("[resistance]\ndry = 0.1\nstatic_dry = 0.2"),
        "resistance.static_dry",
    ),
    "a rate over which nothing falls": (
        with_parts("[resistance]\ndry = 0.1\nstribeck = 0.2\nexact = true"),
        "resistance.stribeck",
    ),
    "powers in two dimensions": (with_parts("[force]\npowers = [[1, 2]]"), "force.powers"),
    "powers out of a disk's plane": (
        with_parts("[force]\npowers = [[0, 1, 0]]").replace('"ball"', '"disk"').replace("[0.9, 1.0, 1.1]", "1.0"),
        "force.powers",
    ),
}


@pytest.mark.thorough
@pytest.mark.parametrize(("text", "named"), CASES.values(), ids=CASES.keys())
def test_sentence(text, named):
    with refuses(ScenarioError, named):
        read_scenario(text)


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
    "force on a joint": (hanging(jaxball.physics.FunctionJointForce(nothing)), "mechanisms[0].joints[0].force"),
    "mechanism": (
        {"mechanisms": [jaxball.physics.FunctionMechanism(on_a_circle, [0.2], [None], 0.5)]},
        "mechanisms[0]",
    ),
    "motion of the ground": ({"ground": jaxball.Ground(motion=jaxball.Free(nowhere))}, "ground.motion"),
}


@pytest.mark.parametrize(("parts", "named"), IN_PYTHON.values(), ids=IN_PYTHON.keys())
def test_python_function_has_no_place_in_a_file(parts, named):
    system = jaxball.Ball(mass=1.0, inertia=(1.0, 1.0, 1.0), **parts)
    with refuses(ScenarioError, named):
        write_scenario(Scenario("", system, jaxball.BallState(), np.array([0.0, 1.0])))
