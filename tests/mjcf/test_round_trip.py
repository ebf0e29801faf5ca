"""A file that is written, read and written again is the same; what a ball with mechanisms is not is refused by name."""

import mujoco
import numpy as np
import pytest

from jaxball import ReleasedState, load_scenario
from jaxball.mjcf import MJCFError, from_mjcf, to_mjcf
from tests.mjcf.robots import free_ball, free_disk, loaded, prescribed_ball, random_state, scenario

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


@pytest.mark.parametrize("system", [free_ball, free_disk])
def test_a_file_read_and_written_again_is_the_same(system):
    system = system()
    state = random_state(np.random.default_rng(3), system)
    text = to_mjcf(scenario(system, state)).text
    again = from_mjcf(text)
    assert isinstance(again.state, ReleasedState)
    assert differences(to_mjcf(again).text, text) == []


def test_prescribed_motions_come_back_as_servos():
    """A mass on three slides of one body comes back as three links, which is then what is written."""
    system = prescribed_ball()
    text = to_mjcf(scenario(system, random_state(np.random.default_rng(3), system))).text
    again = to_mjcf(from_mjcf(text)).text
    assert all(name.startswith("body_") for name in differences(again, text))
    assert differences(to_mjcf(from_mjcf(again)).text, again) == []


def test_a_robot_of_somebody_else_has_the_same_accelerations_and_masses():
    """MuJoCo's accelerations of the file, and of what is written of it, in other axes, at the same state."""
    model, data = loaded(FOREIGN)
    qvel = np.random.default_rng(4).normal(size=model.nv)
    qpos = numbers([0.3, 0.1, 2.0, *data.qpos[3:7], 0.3, 0.1])
    key = f'<keyframe><key qpos="{qpos}" qvel="{numbers(qvel)}" ctrl="0.5 0.7"/></keyframe>'
    text = FOREIGN.replace("</mujoco>", f"{key}</mujoco>")
    read = from_mjcf(text, contact=True)
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


def test_a_body_that_starts_by_rolling_always_rolls():
    text = to_mjcf(load_scenario("three-rotors")).text
    assert from_mjcf(text).contact is None
    assert float(from_mjcf(text, contact=True).contact.sliding) == 1.0


def differences(first, second):
    """What of the bodies, joints, actuators and keyframes of two files differs by more than rounding."""
    one, other = mujoco.MjModel.from_xml_string(first), mujoco.MjModel.from_xml_string(second)
    names = [
        "body_mass", "body_inertia", "body_pos", "body_ipos", "body_parentid", "jnt_type", "jnt_pos", "jnt_axis",
        "jnt_stiffness", "qpos_spring", "dof_damping", "actuator_gainprm", "actuator_biasprm", "actuator_forcerange",
        "actuator_forcelimited", "actuator_trnid", "key_qpos", "key_qvel", "key_ctrl", "geom_size", "geom_condim",
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
    "not XML": ("<mujoco", "<mujoco <", "The file must be XML"),
    "defaults": ("<worldbody>", "<default/><worldbody>", "Element <default> in <mujoco"),
    "a tendon": ("<actuator>", "<tendon/><actuator>", "Element <tendon>"),
    "another body": ("<light", '<body name="box"/><light', "There must be one <body>"),
    "a box": ('type="sphere"', 'type="box"', 'touch, a sphere, but it has <geom name="skin"> of type box'),
    "contact": (SWING, f'<geom name="knob" size="1"/>{SWING}', '<geom name="knob"> must have contype'),
    "a ball joint": (SWING, f'<joint type="ball"/>{SWING}', 'must be a hinge or a slide, but its type is "ball"'),
    "armature": (DAMPED, 'armature="0.1"', 'Attribute `armature` of <joint name="swing"> must be 0'),
    "a range": (DAMPED, 'range="-1 1"', 'Attribute `range` of <joint name="swing">'),
    "no inertia": (ARM, '<geom contype="0" conaffinity="0"/>', '<body name="arm"> must have an <inertial>'),
    "a muscle": ('<motor name="push"', '<muscle name="push"', 'Element <muscle name="push"> must be a <motor>'),
    "a medium": ("<option ", '<option density="1.2" ', "Attribute `density` of <option>"),
    "a missing number": ('mass="2"', "", "must have `mass`, a number, but it is missing"),
    "a word": ('mass="2"', 'mass="two"', 'must be a number, but it is "two"'),
    "a tilted plane": (FLOOR, f'{FLOOR} euler="3 0 0"', 'Element <geom name="floor"> must be the plane z = 0'),
    "spinning friction": (FLOOR, f'{FLOOR} condim="4"', "against spinning must be 0"),
    "another joint": ('joint="reach"', 'joint="grip"', 'one acts on "grip"'),
}


@pytest.mark.parametrize("case", sorted(REFUSED))
def test_what_is_no_ball_with_mechanisms_is_refused_by_name(case):
    before, after, sentence = REFUSED[case]
    assert before in FOREIGN
    with pytest.raises(MJCFError) as caught:
        from_mjcf(FOREIGN.replace(before, after, 1))
    assert sentence in str(caught.value)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("suslov", "Key `kind` must be a ball or a disk"),
        ("roboball", "Key `resistance.rolling` must be 0"),
        ("vibrating-plane", "Key `ground.motion` must be left out"),
        ("ellipse-and-eight", "Mass `masses[0]` must move by a schedule"),
    ],
)
def test_what_mjcf_cannot_express_is_refused_by_name(name, sentence):
    with pytest.raises(MJCFError) as caught:
        to_mjcf(load_scenario(name))
    assert sentence in str(caught.value)
