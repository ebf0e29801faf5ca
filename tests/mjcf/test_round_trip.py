"""A file that is written, read and written again is the same; what a ball with mechanisms is not is refused by name."""

import dataclasses

import mujoco
import numpy as np
import pytest

from jaxball import (
    Ball,
    BallState,
    CarriedMass,
    Contact,
    HardStops,
    Hinge,
    JointFriction,
    Mechanism,
    Resistance,
    Spring,
    load_scenario,
    read_scenario,
)
from jaxball.files.mjcf import MJCFError, read_mjcf, to_mjcf
from jaxball.files.scenario import Units
from jaxball.physics import LimitSurface, ReleasedState
from tests.mjcf.robots import free_ball, free_disk, loaded, prescribed_ball, random_state, scenario
from tests.support.sentences import refuses

# A robot as somebody else may write it: degrees, frames of its own, an inertia that is not along the axes.
FOREIGN = """
<mujoco model="roller">
  <compiler eulerseq="XYZ"/>
  <option gravity="0.5 0 -9.7"/>
  <worldbody>
    <light pos="0 0 3"/>
    <geom name="floor" type="plane" size="5 5 0.1"/>
    <body name="hull" pos="0.3 0.1 0.4" euler="20 30 40">
      <freejoint/>
      <inertial pos="0.02 0 0.05" quat="0.9 0.1 0.3 0.2" mass="2" diaginertia="0.12 0.14 0.17"/>
      <geom name="skin" type="sphere" size="0.4" pos="0.01 0.02 0"/>
      <body name="frame" pos="0 0.1 0" axisangle="0 0 1 30">
        <inertial pos="0 0 0" mass="0.3" diaginertia="0.01 0.01 0.01"/>
        <body name="arm" pos="0.1 0 -0.1" xyaxes="0 1 0 -1 0 0">
          <joint name="swing" axis="1 0 1" pos="0 0 0.1" damping="0.1"/>
          <joint name="reach" type="slide" axis="0 0 1" stiffness="30"/>
          <inertial pos="0 0 -0.1" mass="0.5" fullinertia="0.004 0.005 0.006 0.001 0 0.0005"/>
          <body name="bob" pos="0 0.1 -0.1">
            <inertial pos="0 0 0" mass="0.2" diaginertia="0 0 0"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="aim" joint="swing" kp="3" kv="0.2"/>
    <motor name="push" joint="reach" gear="2"/>
  </actuator>
</mujoco>
"""


# Another one, with classes, inertias by geoms, sensors, and a joint that says it is free.
BY_GEOMS = """
<mujoco model="robot by geoms">
  <compiler angle="radian"/>
  <default>
    <geom density="700" contype="0" conaffinity="0"/>
    <joint damping="0.05"/>
    <site pos="0 0.02 0"/>
    <motor gear="2" ctrlrange="-1 1"/>
    <default class="skin"><geom contype="1" conaffinity="1"/></default>
    <default class="arm">
      <geom type="capsule" size="0.02"/>
      <joint axis="0 1 0.2"/>
      <default class="stiff"><joint type="slide" stiffness="3"/></default>
    </default>
  </default>
  <worldbody>
    <geom class="skin" type="plane" size="5 5 0.1"/>
    <body name="hull" pos="0 0 0.4">
      <joint type="free" damping="0"/>
      <geom class="skin" size="0.4" mass="1.5" shellinertia="true"/>
      <geom type="box" size="0.1 0.05 0.02" pos="0 0.1 0.1" euler="0.3 0.2 0.1"/>
      <geom type="mesh" mesh="none" mass="0"/>
      <site name="imu" pos="0.1 0 0" euler="0.1 0.2 0.3"/>
      <body name="arm" childclass="arm" pos="0 0 0.1" euler="0 0 0.4">
        <joint name="swing"/>
        <geom fromto="0 0 0 0 0.1 -0.2"/>
        <geom type="ellipsoid" size="0.03 0.04 0.05" pos="0 0.1 -0.2" quat="1 0.2 0.3 0.1"/>
        <site name="tip"/>
        <body pos="0 0.1 -0.2">
          <joint name="reach" class="stiff"/>
          <geom type="cylinder" size="0.05 0.02" mass="0.3" euler="0.2 0 0"/>
          <geom type="capsule" size="0.02 0.05" euler="0 0.7 0"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="push" joint="swing"/>
  </actuator>
  <sensor>
    <accelerometer name="felt" site="imu" noise="0.1"/>
    <gyro name="turned" site="tip"/>
    <accelerometer name="end" site="tip"/>
    <framepos name="seen" objtype="site" objname="imu"/>
    <jointpos name="angle" joint="swing"/>
    <jointvel name="rate" joint="reach"/>
  </sensor>
</mujoco>
"""


@pytest.mark.thorough
@pytest.mark.parametrize("system", [free_ball, free_disk])
def test_a_file_read_and_written_again_is_the_same(system):
    system = system()
    state = random_state(np.random.default_rng(3), system)
    text = to_mjcf(scenario(system, state)).text
    again = read_mjcf(text).scenario
    assert isinstance(again.state, ReleasedState)
    assert differences(to_mjcf(again).text, text) == []


@pytest.mark.thorough
def test_prescribed_motions_come_back_as_servos():
    """A mass on three slides of one body comes back as three links, which is then what is written."""
    system = prescribed_ball()
    text = to_mjcf(scenario(system, random_state(np.random.default_rng(3), system))).text
    again = to_mjcf(read_mjcf(text).scenario).text
    assert all(name.startswith("body_") for name in differences(again, text))
    assert differences(to_mjcf(read_mjcf(again).scenario).text, again) == []


def test_a_robot_of_somebody_else_has_the_same_accelerations_and_masses():
    """MuJoCo's accelerations of the file, and of what is written of it, in other axes, at the same state."""
    model, data = loaded(FOREIGN)
    qvel = np.random.default_rng(4).normal(size=model.nv)
    qpos = numbers([0.3, 0.1, 2.0, *data.qpos[3:7], 0.3, 0.1])
    key = f'<keyframe><key qpos="{qpos}" qvel="{numbers(qvel)}" ctrl="0.5 0.7"/></keyframe>'
    text = FOREIGN.replace("</mujoco>", f"{key}</mujoco>")
    read = read_mjcf(text, contact=True).scenario
    (model, data), (own, its_data) = loaded(text), loaded(to_mjcf(read).text)
    mujoco.mj_forward(model, data)
    mujoco.mj_forward(own, its_data)
    assert data.ncon == its_data.ncon == 0
    assert abs(own.body_mass.sum() - model.body_mass.sum()) <= 1e-12
    assert np.allclose(its_data.qacc[6:], data.qacc[6:], rtol=1e-10, atol=1e-10)  # MuJoCo's own inertias are rounded
    turn = np.zeros((3, 3))
    mujoco.mju_quat2Mat(turn.reshape(-1), its_data.qpos[3:7])
    mine, its = turn @ its_data.qacc[3:6], data.xmat[1].reshape(3, 3) @ data.qacc[3:6]
    assert np.allclose(mine, its, rtol=1e-10, atol=1e-10)


def test_classes_geoms_and_sensors_are_those_that_mujoco_compiles():
    """Masses, accelerations and readings of its model of the file, and of that of what is written again of it.

    The mesh without mass is read here, and left out for MuJoCo, which has no file of it.
    """
    state = {"qpos": [0.3, 0.1, 2.0, 0.5, 0.5, 0.1, 0.7, 0.3, 0.1], "qvel": np.random.default_rng(5).normal(size=8)}
    state["qpos"][3:7] = (np.asarray(state["qpos"][3:7]) / np.linalg.norm(state["qpos"][3:7])).tolist()
    words = " ".join(f'{name}="{numbers(values)}"' for name, values in state.items())
    text = BY_GEOMS.replace("</mujoco>", f'<keyframe><key {words} ctrl="3"/></keyframe></mujoco>')
    read = read_mjcf(text).scenario
    assert set(read.sensors) == {"felt", "turned", "end", "seen", "angle", "rate"}
    known, again = loaded(text.replace('<geom type="mesh" mesh="none" mass="0"/>', "")), loaded(to_mjcf(read).text)
    for model, data in (known, again):
        mujoco.mj_forward(model, data)
        assert data.ncon == 0
    assert abs(again[0].body_mass.sum() - known[0].body_mass.sum()) <= 1e-12
    assert np.allclose(again[1].qacc[6:], known[1].qacc[6:], rtol=1e-9, atol=1e-9)  # moments through MuJoCo's rounding
    for name in read.sensors:
        assert np.allclose(again[1].sensor(name).data, known[1].sensor(name).data, rtol=1e-9, atol=1e-9), name


@pytest.mark.parametrize("angle", ["", 'angle="radian"'])
def test_springs_rest_where_mujoco_has_them(angle):
    """On a hinge in the angles of the file, which are degrees unless it says otherwise, on a slide at a length."""
    text = FOREIGN.replace("<compiler ", f"<compiler {angle} ")
    text = text.replace(DAMPED, 'stiffness="2" springref="30"').replace('stiffness="30"', 'stiffness="3" springref="2"')
    (model, _), (own, _) = loaded(text), loaded(to_mjcf(read_mjcf(text).scenario).text)
    assert np.all(model.jnt_stiffness[1:] > 0)
    np.testing.assert_allclose(own.qpos_spring[7:], model.qpos_spring[7:], rtol=1e-15)


TURNED = """
<mujoco>
  {}
  <worldbody>
    <geom type="plane" size="5 5 0.1"/>
    <body pos="0 0 0.4" euler="0.2 0.3 0.4">
      <freejoint/>
      <geom size="0.4" mass="1"/>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize(
    "compilers",
    [
        '<compiler eulerseq="zyx"/><compiler angle="radian"/>',
        '<compiler angle="radian"/><compiler eulerseq="ZYX"/>',
        '<compiler angle="radian" eulerseq="zyx"/><compiler angle="degree" eulerseq="xyz"/>',
        '<compiler angle="degree"/><compiler angle="radian"/>',
    ],
)
def test_a_later_compiler_replaces_only_what_it_states(compilers):
    text = TURNED.format(compilers)
    _, data = loaded(text)
    # Both are unit quaternions, of either sign.
    assert abs(abs(read_mjcf(text).scenario.state.q @ data.qpos[3:7]) - 1) <= 1e-14


def rolling_on(plane, sphere):
    """A ball that touches a plane, with some attributes of their geoms."""
    text = TURNED.format("").replace('type="plane"', f'name="floor" type="plane" margin="0.01" {plane}')
    return text.replace('<geom size="0.4"', f'<geom name="skin" size="0.4" {sphere}')


@pytest.mark.parametrize(
    ("plane", "sphere"),
    [
        ('friction="0.2" priority="1"', ""),
        ('friction="0.2"', 'friction="1.2" priority="-1"'),
        ('friction="0.2 0.3" condim="4"', 'friction="0.4" priority="2"'),
        ('friction="0.2 0 0.03" condim="6" priority="1"', 'friction="0.4 0 0.05"'),
        ('friction="0.2 0 0.03" condim="6" priority="1"', 'friction="0.4 0 0.02" priority="1"'),
        ('condim="1" priority="1"', ""),
    ],
)
def test_the_geom_with_the_higher_priority_has_the_friction(plane, sphere):
    text = rolling_on(plane, sphere)
    model, data = loaded(text)
    mujoco.mj_forward(model, data)
    (contact,) = data.contact
    read = read_mjcf(text, contact=True).scenario
    assert float(read.contact.friction) == (contact.friction[0] if contact.dim > 1 else 0.0)
    resistance = read.system.resistance
    rolling = 0.0 if resistance is None else float(resistance.dry) * 0.4
    assert rolling == pytest.approx(contact.friction[3] if contact.dim == 6 else 0.0, rel=1e-15)


def test_a_contact_pair_is_told():
    """MuJoCo has its friction instead of that of the geoms."""
    pair = '<contact><pair name="grip" geom1="skin" geom2="floor" friction="0.3 0.3"/></contact>'
    text = rolling_on('friction="0.2"', 'friction="0.2"').replace("</mujoco>", f"{pair}</mujoco>")
    model, data = loaded(text)
    mujoco.mj_forward(model, data)
    assert [contact.friction[0] for contact in data.contact] == [0.3]
    read = read_mjcf(text, contact=True)
    assert float(read.scenario.contact.friction) == 0.2
    assert read.notes == (
        'The <pair name="grip"> of "skin" and "floor" was not imported, because only the shell and the plane touch '
        "here, with the friction of their geoms; give it to these as `friction`.",
        'The `margin` of <geom name="floor"> was not imported, because contacts are rigid here.',
    )


def test_dry_friction_of_a_joint_comes_back():
    hinge = Hinge((0.0, 1.0, 0.0), drive=JointFriction(0.2, viscous=0.1) + Spring(0.3))
    arm = Mechanism([hinge], [CarriedMass(0.5, (0.1, 0.0, -0.5))])
    exported = to_mjcf(scenario(Ball(mass=1.0, inertia=(0.5, 0.4, 0.45), mechanisms=[arm])))
    assert "creep" in exported.notes[-1]
    model, _ = loaded(exported.text)
    joint = model.joint("mechanisms[0].joints[0]")
    assert (joint.frictionloss[0], joint.damping[0], joint.stiffness[0]) == (0.2, 0.1, 0.3)
    assert differences(to_mjcf(read_mjcf(exported.text).scenario).text, exported.text) == []
    with refuses(MJCFError, "frictionloss"):
        read_mjcf(exported.text, contact=True)


@pytest.mark.thorough
def test_a_body_that_starts_by_rolling_always_rolls():
    text = to_mjcf(load_scenario("three-rotors")).text
    assert read_mjcf(text).scenario.contact is None
    assert float(read_mjcf(text, contact=True).scenario.contact.friction) == 1.0


def differences(first, second):
    """What of the bodies, joints, actuators and keyframes of two files differs by more than rounding."""
    one, other = mujoco.MjModel.from_xml_string(first), mujoco.MjModel.from_xml_string(second)
    names = [
        "body_mass", "body_inertia", "body_pos", "body_ipos", "body_parentid", "jnt_type", "jnt_pos", "jnt_axis",
        "jnt_stiffness", "qpos_spring", "dof_damping", "dof_frictionloss", "actuator_gainprm", "actuator_biasprm",
        "actuator_forcerange", "actuator_forcelimited", "actuator_trnid", "key_qpos", "key_qvel", "key_ctrl",
        "geom_size", "geom_condim",
    ]  # fmt: skip
    pairs = {name: (getattr(one, name), getattr(other, name)) for name in names}
    pairs["gravity"] = (one.opt.gravity, other.opt.gravity)
    alike = (a.shape == b.shape and np.allclose(a, b, rtol=1e-14, atol=1e-14) for a, b in pairs.values())
    return [name for name, same in zip(pairs, alike, strict=True) if not same]


def numbers(values):
    return " ".join(repr(float(x)) for x in values)


ARM = '<inertial pos="0 0 -0.1" mass="0.5" fullinertia="0.004 0.005 0.006 0.001 0 0.0005"/>'
SWING, DAMPED, FLOOR = '<joint name="swing"', 'damping="0.1"', 'type="plane"'
REFUSED = {
    "not XML": ("<mujoco", "<mujoco <", "The file"),
    "no class": ('<joint name="swing"', '<joint class="arm" name="swing"', "class"),
    "a default of a motor": ("<worldbody>", '<default><position kp="3"/></default><worldbody>', "kp"),
    "a sensor": ("</mujoco>", '<sensor><touch site="tip"/></sensor></mujoco>', "Element <touch>"),
    "a sensor elsewhere": ("</mujoco>", '<sensor><gyro site="tip"/></sensor></mujoco>', "site"),
    "groups": ("<compiler ", '<compiler inertiagrouprange="0 1" ', "inertiagrouprange"),
    "a free joint with friction": ("<freejoint/>", '<joint type="free" damping="1"/>', "damping"),
    "a tendon": ("<actuator>", "<tendon/><actuator>", "Element <tendon> in <mujoco>"),
    "another body": ("<light", '<body name="box"/><light', "There"),
    "a box": ('type="sphere"', 'type="box"', "skin"),
    "contact": (SWING, f'<geom name="knob" size="1"/>{SWING}', "knob"),
    "a ball joint": (SWING, f'<joint type="ball"/>{SWING}', "ball"),
    "armature": (DAMPED, 'armature="0.1"', "armature"),
    "a range": (DAMPED, 'range="-1 1"', "range"),
    "no density": (ARM, '<geom density="-30" contype="0" conaffinity="0"/>', "density"),
    "a mesh": (ARM, '<geom type="mesh" contype="0" conaffinity="0"/>', "mesh"),
    "a hollow box": (ARM, '<geom type="box" shellinertia="true" contype="0" conaffinity="0"/>', "shellinertia"),
    "a box between points": (ARM, '<geom type="box" fromto="0 0 0 1 1 1" contype="0" conaffinity="0"/>', "fromto"),
    "a muscle": ('<motor name="push"', '<muscle name="push"', "push"),
    "a medium": ("<option ", '<option density="1.2" ', "density"),
    "a missing number": ('mass="2"', "", "mass"),
    "a word": ('mass="2"', 'mass="two"', "mass"),
    "a tilted plane": (FLOOR, f'{FLOOR} euler="3 0 0"', "floor"),
    "spinning friction": (FLOOR, f'{FLOOR} condim="4"', '<geom name="floor">'),
    "another joint": ('joint="reach"', 'joint="grip"', "grip"),
}


@pytest.mark.parametrize("case", sorted(REFUSED))
def test_what_is_no_ball_with_mechanisms_is_refused_by_name(case):
    before, after, named = REFUSED[case]
    assert before in FOREIGN
    with refuses(MJCFError, named):
        read_mjcf(FOREIGN.replace(before, after, 1))


@pytest.mark.parametrize("attribute", ["damping", "stiffness", "armature", "frictionloss"])
def test_a_disk_that_is_held_by_its_first_joints_is_refused(attribute):
    text = to_mjcf(scenario(free_disk())).text
    first = text.index("<joint")
    with refuses(MJCFError, attribute):
        read_mjcf(f'{text[:first]}<joint {attribute}="0.5"{text[first + len("<joint") :]}')


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "named"),
    [
        ("suslov", "kind"),
        ("roboball", "resistance.rolling"),
        ("roboball-2", "mechanisms[0].joints[0]"),
        ("vibrating-plane", "ground.motion"),
        ("ball-in-a-bowl", "ground"),
        ("ellipse-and-eight", "masses[0]"),
    ],
)
def test_what_mjcf_cannot_express_is_refused_by_name(name, named):
    with refuses(MJCFError, named):
        to_mjcf(load_scenario(name))


def test_hard_stops_are_refused_by_name():
    pendulum = Mechanism([Hinge((0.0, 1.0, 0.0), drive=HardStops(-1.0, 1.0))], [CarriedMass(0.5, (0.0, 0.0, -0.6))])
    system = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), mechanisms=[pendulum])
    with refuses(MJCFError, "mechanisms[0].joints[0]"):
        to_mjcf(scenario(system, BallState(theta=[0.0], thetadot=[0.0])))


def test_rolling_friction_that_is_larger_at_rest_is_refused():
    law = Resistance(dry=0.1, static_dry=0.2, exact=True)
    system = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), resistance=law)
    with refuses(MJCFError, "resistance.static_dry"):
        to_mjcf(scenario(system, BallState()))


def test_friction_that_depends_on_the_slip_speed_is_refused():
    with refuses(MJCFError, "contact.friction"):
        to_mjcf(load_scenario("tippe-top"))
    spinning = dataclasses.replace(scenario(free_ball()), contact=Contact(LimitSurface(0.3, 0.1)))
    with refuses(MJCFError, "contact.friction"):
        to_mjcf(spinning)


def test_numbers_in_other_units_than_si_are_written_only_if_asked_for():
    """MJCF does not say its units: grams would be taken for kilograms."""
    robot = scenario(free_ball())
    plain = to_mjcf(robot).text
    grams = dataclasses.replace(robot, units=Units("cm", "g", "s"))
    with refuses(MJCFError, "units"):
        to_mjcf(grams)
    assert to_mjcf(grams, any_units=True).text == plain
    for units in (Units("m", "kg", "s"), Units()):
        assert to_mjcf(dataclasses.replace(robot, units=units)).text == plain


HELD = """
format = 1
kind = "disk"
body = { mass = 1.0, inertia = 0.5, radius = 1.0, gravity = 10.0 }
time = { start = 0.0, end = 4.0, step = 0.04 }

[[mechanisms]]
masses = [{ mass = 0.8, place = [0.0, 0.0, -0.5] }]
joints = [{ kind = "hinge", axis = [0.0, 1.0, 0.0], schedule = { kind = "constant-rate", theta = 0.0, rate = 0.1 } }]
"""
NOT_WRITTEN = {
    "[sensors.way]\nkind = 'position'": None,
    "[events.turned]\nof = 'phi'\nlevel = 1.0": "`events`",
    "[sensors.way]\nkind = 'position'\nerrors.noise = 0.01": "`sensors.way.errors`",
    "[feedback]\nkind = 'tvlqr'\nQ = 1.0\nR = 1.0\n[estimator]\nspread = { phi = 0.1 }\n"
    "[sensors.way]\nkind = 'position'\nerrors.noise = 0.01": "`feedback`, `estimator` and `sensors.way.errors`",
}


@pytest.mark.parametrize(("tables", "told"), NOT_WRITTEN.items())
def test_what_is_left_out_is_told(tables, told):
    notes = [note for note in to_mjcf(read_scenario(f"{HELD}{tables}\n")).notes if note.startswith("Not written")]
    assert notes == ([] if told is None else [f"Not written, because MJCF has nothing like it: {told}."])
