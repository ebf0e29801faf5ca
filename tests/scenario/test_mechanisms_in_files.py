"""Mechanisms, grounds, resistance and linear laws in files are those that the same words make in Python."""

import math
import tomllib

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tomli_w

import jaxball
from jaxball import (
    Accelerated,
    BallState,
    CarriedMass,
    ConstantRate,
    Hinge,
    Mechanism,
    PiecewiseSignal,
    Scenario,
    ScenarioError,
    read_scenario,
    write_scenario,
)
from jaxball.files.scenario.paths import with_numbers
from jaxball.files.scenario.sources import builtin_text
from tests.support import corpus
from tests.support.sentences import refuses
from tests.support.structure import Structure

from .documents import BALL, DISK, edited
from .test_round_trip import same_objects

SLOPE = builtin_text("pendulum-on-a-slope")
SHELL = BALL[: BALL.index("[[masses]]")]
TIMES = BALL[BALL.index("[time]") :]
PENDULUM = (
    '[[mechanisms]]\njoints = [{ kind = "hinge", axis = [0, 1, 0] }]\nmasses = [{ mass = 0.5, place = [0, 0, -0.6] }]\n'
)


def with_parts(*parts):
    """A ball with other tables."""
    return "\n".join([SHELL, *parts, TIMES])


def with_drive(drive):
    """A ball with one pendulum, whose joint has another drive."""
    return with_parts(PENDULUM.replace("axis = [0, 1, 0]", f"axis = [0, 1, 0], {drive}"))


def ball(**parts):
    return jaxball.Ball(mass=1.0, radius=1.0, inertia=(0.9, 1.0, 1.1), gravity=1.0, **parts)


def pendulum(drive):
    return Mechanism([Hinge((0.0, 1.0, 0.0), drive=drive)], [CarriedMass(0.5, (0.0, 0.0, -0.6))])


def assert_reads(text, system, state):
    """The text makes this system and state, and is written and read again as the same, bit for bit."""
    scenario = read_scenario(text)
    assert same_objects(scenario, Scenario("", system, state, np.linspace(0.0, 2.0, 5)))
    assert same_objects(scenario, read_scenario(write_scenario(scenario)))


AT_REST = BallState(theta=[0.0], thetadot=[0.0])
STEPS = PiecewiseSignal([0.0, 1.0, 2.0], [0.5, -0.5])
RAMP = PiecewiseSignal([0.0, 1.0], [[0.5, -0.5]])
FORCES = {
    "nothing": ("on = -1", None),
    "a number": ('force = { kind = "motor", signal = 0.5 }', jaxball.Motor(0.5)),
    "steps": (
        'force = { kind = "motor", signal = { kind = "steps", times = [0, 1, 2], values = [0.5, -0.5] }, limit = 2 }',
        jaxball.Motor(STEPS, 2.0),
    ),
    "a ramp": (
        'force = { kind = "motor", signal = { kind = "piecewise", times = [0, 1], values = [[0.5, -0.5]] } }',
        jaxball.Motor(RAMP),
    ),
    "a schedule as a signal": (
        'force = { kind = "motor", signal = { kind = "sinusoids", theta = 0, amplitude = [0.3], frequency = [2] } }',
        jaxball.Motor(jaxball.Sinusoids(0.0, [0.3], [2.0])),
    ),
    "a negative damper": (
        'force = { kind = "damper", coefficient = -0.1, negative = true }',
        jaxball.Damper(-0.1, negative=True),
    ),
    "a motor with a speed": (
        'force = { kind = "speed-limited-motor", command = 0.8, stall = 0.3, free_speed = 4 }',
        jaxball.physics.SpeedLimitedMotor(0.8, 0.3, 4.0),
    ),
    "a servo": (
        'force = { kind = "pd-servo", target = { kind = "constant-rate", theta = 0.2 }, stiffness = 3, limit = 1 }',
        jaxball.PDServo(ConstantRate(0.2), 3.0, limit=1.0),
    ),
    "end stops": (
        'force = { kind = "end-stops", lower = -1, upper = 1, stiffness = 50, damping = 0.2 }',
        jaxball.EndStops(-1.0, 1.0, 50.0, 0.2),
    ),
    "hard stops": (
        'force = { kind = "hard-stops", lower = -1, upper = 0.5, restitution = 0.4 }',
        jaxball.HardStops(-1.0, 0.5, 0.4),
    ),
    "a hard stop": (
        'force = [{ kind = "hard-stops", lower = -1 }, { kind = "damper", coefficient = 0.1 }]',
        jaxball.HardStops(-1.0, math.inf) + jaxball.Damper(0.1),
    ),
    "friction": (
        'force = { kind = "joint-friction", kinetic = 2, static = 3, viscous = 1, stribeck = 0.5, exponent = 1 }',
        jaxball.JointFriction(2.0, 3.0, 1.0, 0.5, 1),
    ),
    "smooth friction": (
        'force = { kind = "joint-friction", kinetic = 0.2, smoothing = 0.01 }',
        jaxball.JointFriction(0.2, smoothing=0.01),
    ),
    "friction with five numbers": (
        'force = { kind = "majd-simaan-friction", viscous = 1, kinetic = 2, peak = 3, rate = 4, steepness = 5 }',
        jaxball.physics.MajdSimaanFriction(1.0, 2.0, 3.0, 4.0, 5.0),
    ),
    "a sum": (
        'force = [{ kind = "spring", stiffness = 2, rest = 0.1 }, { kind = "damper", coefficient = 0.1 }]',
        jaxball.Spring(2.0, 0.1) + jaxball.Damper(0.1),
    ),
    "a sum of one": (
        'force = [{ kind = "spring", stiffness = 2 }]',
        jaxball.physics.JointForces((jaxball.Spring(2.0),)),
    ),
}


@pytest.mark.thorough
@pytest.mark.parametrize(("drive", "force"), FORCES.values(), ids=FORCES.keys())
def test_forces_on_joints(drive, force):
    joint = Hinge((0.0, 1.0, 0.0), drive=force, on=-1 if force is None else None)
    mechanism = Mechanism([joint], [CarriedMass(0.5, (0.0, 0.0, -0.6))])
    assert_reads(with_drive(drive), ball(mechanisms=[mechanism]), AT_REST)


def test_chains_branches_and_carriages():
    text = with_parts(
        """
[[mechanisms]]
joints = [
  { kind = "hinge", axis = [0, 1, 0], point = [0, 0, 0.1] },
  { kind = "slider", axis = [1, 0, 0] },
  { kind = "carriage", rail = { kind = "circle", radius = 0.3 }, on = 0 },
]
masses = [
  { mass = 0.2, place = [0, 0, -0.3], joint = 1 },
  { mass = 0.1 },
  { mass = 0.1, place = [0.2, 0, 0], joint = 0 },
]
"""
    )
    joints = [
        Hinge((0.0, 1.0, 0.0), (0.0, 0.0, 0.1)),
        jaxball.Slider((1.0, 0.0, 0.0)),
        jaxball.Carriage(jaxball.Circle(0.3), on=0),
    ]
    masses = [CarriedMass(0.2, (0.0, 0.0, -0.3), 1), CarriedMass(0.1), CarriedMass(0.1, (0.2, 0.0, 0.0), 0)]
    state = BallState(theta=[0.0] * 3, thetadot=[0.0] * 3)
    assert_reads(text, ball(mechanisms=[Mechanism(joints, masses)]), state)


GROUNDS = {
    "a slope": ("angle = 0.2\nheading = -1.5", jaxball.Ground(0.2, -1.5)),
    "level": ("angle = 0.0", jaxball.Ground()),
    "an accelerated one": (
        "motion = { free = { constant = [0, 0, 0], powers = [[0, 0, 0], [0.05, 0, 0]] } }",
        jaxball.Ground(
            motion=jaxball.Oscillating(jaxball.HarmonicSeries((0.0, 0.0, 0.0), powers=[(0.0,) * 3, (0.05, 0.0, 0.0)]))
        ),
    ),
    "one that goes round": (
        '[ground.motion]\nrail = { kind = "circle", radius = 3 }\nschedule = { kind = "constant-rate", theta = 0.5 }',
        jaxball.Ground(motion=jaxball.OnRail(jaxball.Circle(3.0), ConstantRate(0.5))),
    ),
    "one elsewhere": ("motion = { position = [1, 2, 3] }", jaxball.Ground(motion=jaxball.Fixed((1.0, 2.0, 3.0)))),
    "a turntable": (
        'turntable = { turning = { kind = "constant-rate", theta = 0, rate = 2 }, centre = [1, 0.5] }',
        jaxball.Ground(turntable=jaxball.Turntable(ConstantRate(0.0, 2.0), (1.0, 0.5))),
    ),
    "a belt": (
        'belt = { travel = { kind = "constant-rate", theta = 0, rate = 2 }, heading = 0.5 }',
        jaxball.Ground(belt=jaxball.Belt(ConstantRate(0.0, 2.0), 0.5)),
    ),
    "a turntable in a bowl": (
        'kind = "bowl"\nradius = 3\nturntable = { turning = { kind = "constant-rate", theta = 0, rate = 2 } }',
        jaxball.Bowl(3.0, turntable=jaxball.Turntable(ConstantRate(0.0, 2.0))),
    ),
    "a belt on a plate": (
        'kind = "tilting-plane"\nbelt = { travel = { kind = "constant-rate", theta = 0, rate = 2 } }',
        jaxball.physics.TiltingPlane(belt=jaxball.Belt(ConstantRate(0.0, 2.0))),
    ),
}


@pytest.mark.parametrize(("keys", "ground"), GROUNDS.values(), ids=GROUNDS.keys())
def test_grounds(keys, ground):
    assert_reads(with_parts("[ground]", keys), ball(ground=ground), BallState())


def test_resistance():
    keys = "rolling = 0.1\nspinning = 0.2\ndrag = 0.3\nrotational_drag = 0.4\ndry = 0.05\nsmoothing = 0.02"
    resistance = jaxball.Resistance(0.1, 0.2, 0.3, 0.4, 0.05, 0.02)
    assert_reads(with_parts("[resistance]", keys), ball(resistance=resistance), BallState())
    negative = jaxball.Resistance(rolling=-0.1, negative=True)
    text = with_parts("[resistance]", "rolling = -0.1\nnegative = true")
    assert_reads(text, ball(resistance=negative), BallState())
    assert_reads(with_parts("[resistance]"), ball(resistance=jaxball.Resistance()), BallState())
    exact = jaxball.Resistance(dry=0.05, dry_spinning=0.01, exact=True)
    text = with_parts("[resistance]", "dry = 0.05\ndry_spinning = 0.01\nexact = true")
    assert_reads(text, ball(resistance=exact), BallState())
    sticks = jaxball.Resistance(dry=0.05, static_dry=0.08, stribeck=0.3, exponent=1, exact=True)
    text = with_parts("[resistance]", "dry = 0.05\nstatic_dry = 0.08\nstribeck = 0.3\nexponent = 1\nexact = true")
    assert_reads(text, ball(resistance=sticks), BallState())


def test_forces_with_powers():
    force = jaxball.physics.HarmonicForce((0.0, 0.0, 0.0), powers=[(0.1, 0.0, 0.0), (0.0, 0.2, 0.0)])
    assert_reads(with_parts("[force]\npowers = [[0.1, 0, 0], [0, 0.2, 0]]"), ball(force=force), BallState())


def test_a_linear_law():
    text = with_parts(
        """
[[masses]]
mass = 0.2
rail = { kind = "circle", radius = 0.5 }

[[masses]]
mass = 0.1
rail = { kind = "circle", radius = 0.3 }
schedule = { kind = "constant-rate", theta = 0.3 }
""",
        PENDULUM,
        PENDULUM.replace("axis = [0, 1, 0]", "axis = [1, 0, 0], accelerated = true"),
        """
[actuation]
form = "linear"
theta = [[-4, 0.5, 0], [0, 0, -3]]
Gamma = [[0, 0.2, 0], [0.1, 0, 0]]
z = [[0.1, 0], [0, 0.2]]
signals = [0.1, { kind = "steps", times = [0, 1], values = [0.3] }]

[initial]
theta = [0.1, 0.2, 0.3]
""",
    )
    law = jaxball.LinearLaw(
        theta=[[-4.0, 0.5, 0.0], [0.0, 0.0, -3.0]],
        Gamma=[[0.0, 0.2, 0.0], [0.1, 0.0, 0.0]],
        z=[[0.1, 0.0], [0.0, 0.2]],
        signals=[0.1, PiecewiseSignal([0.0, 1.0], [0.3])],
    )
    masses = [
        jaxball.PointMass(0.2, jaxball.Driven(jaxball.Circle(0.5))),
        jaxball.PointMass(0.1, jaxball.OnRail(jaxball.Circle(0.3), ConstantRate(0.3))),
    ]
    accelerated = Mechanism([Hinge((1.0, 0.0, 0.0), drive=Accelerated())], [CarriedMass(0.5, (0.0, 0.0, -0.6))])
    system = ball(masses=masses, mechanisms=[pendulum(None), accelerated], law=law)
    assert system.coordinates == ("masses[0]", "mechanisms[0].joints[0]", "mechanisms[1].joints[0]")
    assert_reads(text, system, BallState(theta=[0.1, 0.2, 0.3], thetadot=[0.0, 0.0, 0.0]))


TURNING = 'accelerated = true, schedule = { kind = "constant-rate", theta = 0.3, rate = 0.5 }'


def test_accelerated_joints_follow_schedules():
    """As masses do: they start where their schedules are, and those of an integrated law stay on them."""
    text = with_drive(TURNING) + '[actuation]\nform = "integrated"\n'
    state = BallState(theta=[0.3], thetadot=[0.5])
    law = jaxball.FollowSchedules((ConstantRate(0.3, 0.5),))
    assert_reads(text, ball(mechanisms=[pendulum(Accelerated())], law=law), state)
    servo = text.replace('"integrated"', '"servo"\nstiffness = [4]\ndamping = [2]') + "[initial]\ntheta = [0.1]\n"
    law = jaxball.Servo((ConstantRate(0.3, 0.5),), [4.0], [2.0])
    assert_reads(servo, ball(mechanisms=[pendulum(Accelerated())], law=law), BallState(theta=[0.1], thetadot=[0.5]))


def test_a_servo_beside_a_free_joint():
    text = BALL + PENDULUM.replace("axis = [0, 1, 0]", f"axis = [0, 1, 0], {TURNING}") + PENDULUM
    text += '[actuation]\nform = "servo"\nstiffness = [4]\ndamping = [2]\nmasses = []\n[initial]\ntheta = [0.1, 0.2]\n'
    scenario = read_scenario(text)
    assert len(scenario.system.accelerated) == 1
    assert len(scenario.system.coordinates) == 2
    assert same_objects(scenario, read_scenario(write_scenario(scenario)))


def test_masses_that_are_prescribed_beside_joints_that_are_driven():
    text = BALL + PENDULUM.replace("axis = [0, 1, 0]", f"axis = [0, 1, 0], {TURNING}")
    every, none = (text + f'[actuation]\nform = "integrated"\n{which}' for which in ("", "masses = []\n"))
    assert read_scenario(every).system.coordinates == ("masses[0]", "mechanisms[0].joints[0]")
    scenario = read_scenario(none)
    assert scenario.system.coordinates == ("mechanisms[0].joints[0]",)
    assert same_objects(scenario, read_scenario(write_scenario(scenario)))


def test_prescribed_joints():
    text = with_drive('schedule = { kind = "pulse", theta = 0.2 }')
    assert_reads(text, ball(mechanisms=[pendulum(jaxball.Pulse(0.2))]), BallState())


@pytest.mark.thorough
@pytest.mark.parametrize("text", [corpus.EVERY_MECHANISM, corpus.EVERY_MOTION])
def test_round_trip(text):
    scenario = read_scenario(text)
    written = write_scenario(scenario)
    again = read_scenario(written)
    assert same_objects(scenario, again)
    assert write_scenario(again) == written


@pytest.mark.long
def test_balance_counts_the_masses_of_mechanisms_and_knows_the_slope():
    """0.6 · 0.5 cos(θ − a) + 0.5 (0.3 cos a − 0.4 sin a) = −M r sin a, as by the moment about the contact point.

    Of both angles, 2.58 is nearer to 3 than 3.81 is. The ground that moves is refused.
    """
    joint = PENDULUM.replace("[0, 0, -0.6]", "[0.3, 0, -0.4]")
    mass = '[[masses]]\nmass = 0.6\nrail = { kind = "circle", radius = 0.5 }\n'
    mass += 'schedule = { kind = "constant-rate", theta = 3.0 }\n'
    start, a = "[initial]\nbalance = { masses = [0] }\n", 0.05
    (item,) = read_scenario(with_parts(mass, joint, start, f"[ground]\nangle = {a}\n")).system.point_masses
    angle = a + np.arccos((-2.1 * np.sin(a) - 0.5 * (0.3 * np.cos(a) - 0.4 * np.sin(a))) / 0.3)
    np.testing.assert_allclose(item.motion.schedule.theta, angle, rtol=0, atol=1e-9)
    with refuses(ScenarioError, "initial.balance"):
        read_scenario(with_parts(mass, start, "[ground.motion.free]\nconstant = [0.0, 0.0, 0.0]\n"))


CHANGED = {
    "resistance.rolling": 0.3,
    "ground.angle": 0.05,
    "mechanisms[0].masses[0].mass": 0.3,
    "mechanisms[0].masses[0].place[2]": -0.5,
    "mechanisms[0].joints[0].force[0].stiffness": 0.4,
    "initial.theta[0]": 0.2,
}


def traced_and_read(text, changes):
    """The leaves of a document whose numbers are traced, and of the one with these numbers in it."""
    document = tomllib.loads(text)
    structure = Structure(document, tuple(changes))
    values = jnp.asarray(list(changes.values()))
    scenario = read_scenario(tomli_w.dumps(with_numbers(document, changes)))
    return jax.tree.leaves(structure.build(values)[:2]), jax.tree.leaves((scenario.system, scenario.state)), structure


@pytest.mark.thorough
def test_traced_numbers_make_what_files_make():
    traced, read, structure = traced_and_read(SLOPE, CHANGED)
    for ours, theirs in zip(traced, read, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-15, atol=0)
    hold = jax.jit(structure.conditions)
    good, bad = jnp.asarray(list(CHANGED.values())), jnp.asarray([-0.3, 1.6, -0.3, -1.5, 0.4, 0.2])
    assert all(bool(value) for value in hold(good).values())
    broken = {path for path, value in hold(bad).items() if not bool(value)}
    moved = {"mechanisms[0].masses[0].mass", "masses", "mechanisms"}  # out of the shell, and with an inertia below 0
    assert broken == {"resistance.rolling", "ground.angle", *moved}


@pytest.mark.thorough
def test_friction_without_a_normal_force_is_refused_in_files():
    """A light shell and a mass ahead: no solution from B / (m x) = 2.03 on, as in tests/physics/test_painleve.py."""
    light = SHELL.replace("mass = 1.0", "mass = 0.1").replace(
        "inertia = [0.9, 1.0, 1.1]", "inertia = [0.01, 0.01, 0.01]"
    )
    ahead = "[[masses]]\nmass = 2.0\n[masses.free]\nconstant = [0.9, 0.0, 0.0]\n"
    rolling = "[initial]\nOmega = [0.0, 2.0, 0.0]\n"

    def text(dry):
        return "\n".join([light, ahead, f"[resistance]\ndry = {dry}\n", rolling, TIMES])

    structure = Structure(tomllib.loads(text(1.9)), ("resistance.dry",))
    assert jax.jit(structure.conditions)(jnp.array([2.0]))["resistance.dry"]
    assert not jax.jit(structure.conditions)(jnp.array([2.1]))["resistance.dry"]
    with refuses(ScenarioError, "resistance.dry"):
        read_scenario(text(2.1))


@pytest.mark.thorough
def test_every_number_can_be_traced():
    changes = {
        "force.parameters.drag": 0.05,
        "force.parameters.velocity[1]": 0.2,
        "force.kink_times[0]": 0.7,
        "ground.turntable.turning.rate": 0.2,
        "ground.motion.schedule.amplitude[0]": 0.2,
        "ground.turntable.centre[0]": 0.4,
        "resistance.dry": 0.02,
        "masses[1].free.powers[0][0]": 0.02,
        "mechanisms[0].joints[0].axis[0]": 0.2,
        "mechanisms[0].joints[1].force[0].limit": 0.4,
        "mechanisms[0].joints[1].force[1].signal.values[0]": 0.2,
        "mechanisms[0].joints[1].force[4].lower": -0.2,
        "mechanisms[1].joints[1].force.free_speed": 3.0,
        "actuation.theta[0][0]": -5.0,
        "actuation.signals[0]": 0.2,
        "actuation.signals[1].amplitude[0]": 0.3,
    }
    traced, read, _ = traced_and_read(corpus.EVERY_MECHANISM, changes)
    for ours, theirs in zip(traced, read, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-15, atol=0)


@pytest.mark.parametrize("path", ["mechanisms[0].joints[1].on", "mechanisms[0].masses[0].joint", "sensors.felt.at[0]"])
def test_what_shapes_a_mechanism_cannot_change(path):
    with refuses(ScenarioError, path):
        jaxball.files.scenario.paths.check_number(tomllib.loads(corpus.EVERY_MECHANISM), path)


@pytest.mark.thorough
def test_a_disk_on_a_slope():
    """It rolls as a ball does: z = ½ t² g sin a / (1 + k), with the moment 1 of a disk of mass 1."""
    empty = DISK[: DISK.index("[[masses]]")] + "[ground]\nangle = 0.1\n" + TIMES
    run = read_scenario(empty).simulate()
    np.testing.assert_allclose(run.state.z, 0.25 * np.sin(0.1) * np.asarray(run.times) ** 2, rtol=0, atol=1e-9)
    with refuses(ScenarioError, "ground.turntable"):
        read_scenario(edited("angle = 0.1", 'turntable = { turning = { kind = "constant-rate", theta = 0 } }', empty))
