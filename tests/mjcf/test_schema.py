"""No attribute of a file is passed over: the table of them is MuJoCo's, and what acts there acts here or is refused."""

import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from jaxball.files.mjcf import MJCFError, read_mjcf
from jaxball.files.mjcf.schema import ACTUATORS, TABLE, UNREAD
from tests.support.sentences import refuses

ROBOT = """
<mujoco>
  <compiler angle="radian"/>
  {top}
  <worldbody>
    <geom name="floor" type="plane" size="1 1 0.1"/>
    <body name="hull" pos="0 0 0.2">
      <freejoint/>
      <geom name="skin" size="0.2" mass="2"/>
      <body name="arm" pos="0.05 0 0">
        <joint name="swing" axis="0 1 0" {joint}/>
        <geom type="capsule" size="0.02 0.05" pos="0 0 -0.08" mass="0.5" contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
  <actuator>{actuator}</actuator>
  <keyframe><key {key}/></keyframe>
</mujoco>
"""
THETA, THETADOT, CONTROL = 0.3, 0.4, 0.7
MOTOR = '<motor name="m" joint="swing"/>'


def robot(top="", joint="", actuator=""):
    return ROBOT.format(top=top, joint=joint, actuator=actuator, key=f'ctrl="{CONTROL}"' if actuator else "")


def attributes_of_mujoco():
    """The attributes of each element by the tags around it, from what MuJoCo prints of its own schema."""
    found, around = {}, []
    for line in mujoco.mj_printSchema(False, False).splitlines():
        words = line.split()
        depth = (len(line) - len(line.lstrip())) // 3
        if len(words) > 1 and words[1].startswith("(") and depth <= len(around):
            tag = words[0].removeprefix("(world)")
            around = [*around[:depth], tag]
            found[tuple(around)] = set(words[2:])
        elif words:
            found[tuple(around)].update(words)
    return found


@pytest.mark.skipif(not mujoco.__version__.startswith("3.17."), reason="the table is that of MuJoCo 3.17")
def test_the_table_has_the_attributes_that_mujoco_has():
    """But for a world with a frame of its own, which MuJoCo refuses as it compiles."""
    found = attributes_of_mujoco()
    compared = 0
    for parent, elements in TABLE.items():
        for tag, element in elements.items():
            path = [path for path in found if path[-1] == tag and (len(path) < 2 or path[-2] == parent)]
            if element is UNREAD or not path or (parent, tag) in (("mujoco", "worldbody"), ("default", "default")):
                continue
            assert set(element.names) == found[path[0]], (parent, tag)
            compared += 1
    assert compared > 25


def force_of_mujoco(text):
    """The forces of a joint's own springs and dampers, and of its actuators, at some angle and rate."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[2], data.qpos[7], data.qvel[6] = 9.0, THETA, THETADOT
    mujoco.mj_forward(model, data)
    return model, data.qfrc_passive[6] + data.qfrc_actuator[6]


def force(text):
    read = read_mjcf(text)
    (drive,) = read.scenario.system.mechanisms[0].drives
    numbers = map(jnp.asarray, (0.0, THETA, THETADOT))
    return read, 0.0 if drive is None else float(drive(*numbers, None))


DISABLED = 'No force of <motor name="m"> was imported, because the <option> of the file disables it.'
SPRING = 'stiffness="3" damping="0.1" springref="0.2"'
ACTING = {
    "gravity": (robot('<option><flag gravity="disable"/></option>', SPRING), ()),
    "actuation": (robot('<option><flag actuation="disable"/></option>', SPRING, MOTOR), (DISABLED,)),
    "spring": (robot('<option><flag spring="disable"/></option>', SPRING, MOTOR), ()),
    "damper": (robot('<option><flag damper="disable"/></option>', SPRING, '<motor joint="swing" damping="2"/>'), ()),
    "a flag of a later option": (
        robot('<option><flag spring="disable"/></option><option><flag spring="enable"/></option>', SPRING, MOTOR),
        (),
    ),
    "clampctrl": (
        robot('<option><flag clampctrl="disable"/></option>', "", '<motor joint="swing" ctrlrange="-0.1 0.1"/>'),
        (),
    ),
    "limit": (robot('<option><flag limit="disable"/></option>', f'range="-0.1 0.1" {SPRING}'), ()),
    "springdamper": (robot("", 'springdamper="0.5 1" stiffness="7"'), ()),
    "no springdamper": (robot("", 'springdamper="0 0" stiffness="7"'), ()),
    "a group": (
        robot('<option actuatorgroupdisable="2 3"/>', "", '<motor name="m" joint="swing" group="3" damping="0.2"/>'),
        (DISABLED,),
    ),
    "another group": (robot('<option actuatorgroupdisable="2 3"/>', "", '<motor joint="swing" group="1"/>'), ()),
    "the damper of a motor": (robot("", "", '<motor joint="swing" damping="0.3" gear="2"/>'), ()),
    "samples without a delay": (robot("", "", '<motor joint="swing" nsample="4" interp="linear"/>'), ()),
    "no limit": (robot("", "", '<velocity joint="swing" kv="2" ctrlrange="0 0"/>'), ()),
    "six gears": (robot("", "", '<motor gear="3 0 0 0 0 0" joint="swing"/>'), ()),
    "the gear of a saved motor": (robot("", "", '<general joint="swing" gear="-42"/>'), ()),
    "the gear of a servo": (
        robot("", "", '<position joint="swing" gear="-4" kp="3" kv="0.1" forcerange="-1 1"/>'),
        (),
    ),
    "the gear of a velocity": (robot("", "", '<velocity joint="swing" gear="-4" kv="0.1"/>'), ()),
    "no gear": (robot("", "", '<position joint="swing" gear="0" kp="3" kv="0.1"/>'), ()),
    "a ratio": (robot("", "", '<position joint="swing" kp="3" dampratio="0.7" gear="2"/>'), ()),
    "a ratio as it is saved": (
        robot("", "", '<general joint="swing" biastype="affine" gainprm="3" biasprm="0 -3 0.7"/>'),
        (),
    ),
    "negative damping": (
        robot("", "", '<general joint="swing" biastype="affine" gainprm="2" biasprm="0 -3 0.7"/>'),
        (),
    ),
    "the last class": (
        robot('<default><motor gear="2"/><general gear="3"/></default>', "", '<motor joint="swing"/>'),
        (),
    ),
}


@pytest.mark.parametrize(("text", "notes"), ACTING.values(), ids=ACTING)
def test_what_acts_in_mujoco_acts_here(text, notes):
    model, expected = force_of_mujoco(text)
    read, exerted = force(text)
    assert exerted == pytest.approx(expected, rel=1e-13, abs=1e-15)  # ratios of damping through an inverse
    assert read.notes == notes
    disabled = model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
    assert float(read.scenario.system.gravity) == (0.0 if disabled else 9.81)


ALONE = """
<mujoco>
  <worldbody>
    <geom type="plane" size="1 1 0.1"/>
    <body pos="0 0 0.2"><freejoint align="true"/><geom size="0.2"/></body>
  </worldbody>
  <keyframe><key qpos="0 0 0.2 0.9 0.1 0 0"/></keyframe>
</mujoco>
"""
REFUSED = {
    "stiffness": (robot("", 'stifness="3"'), "stifness"),
    "mass": (robot().replace('mass="2"', 'masss="2"'), "masss"),
    "in a class": (robot('<default><joint dampng="1"/></default>'), "dampng"),
    "an element in a class": (robot("<default><jiont/></default>"), "Element <jiont> in <default>"),
    "an element in a joint": (
        robot().replace('axis="0 1 0" />', 'axis="0 1 0"><plugin/></joint>'),
        '<joint name="swing">',
    ),
    "a flag": (robot('<option><flag gravitty="disable"/></option>'), "gravitty"),
    "the word of a flag": (robot('<option><flag spring="off"/></option>'), "spring"),
    "contact": (robot('<option><flag contact="disable"/></option>'), "contact"),
    "coordinate": (robot('<compiler coordinate="global"/>'), "coordinate"),
    "a rotor": (robot("", "", '<motor joint="swing" armature="0.1"/>'), "armature"),
    "a delay": (robot("", "", '<motor joint="swing" delay="0.1" nsample="3"/>'), "delay"),
    "a tendon": (robot("", "", '<motor tendon="t"/>'), "tendon"),
    "seven gears": (robot("", "", '<motor joint="swing" gear="1 0 0 0 0 0 0"/>'), "gear"),
    "a cubic spring": (robot("", 'stiffness="1 0 2"'), "stiffness"),
    "a range alone": (robot('<compiler autolimits="false"/>', 'range="-1 1"'), "limited"),
    "a falling range": (robot("", "", '<motor joint="swing" ctrllimited="true" ctrlrange="1 -1"/>'), "ctrlrange"),
    "bits": (robot().replace('type="plane"', 'type="plane" contype="2" conaffinity="4"'), "conaffinity"),
    "excluded": (robot('<contact><exclude body1="world" body2="hull"/></contact>'), "Element <exclude>"),
    "excluding nothing": (robot('<contact><exclude body1="hull" body2="arn"/></contact>'), "arn"),
    "a moving surface": (robot().replace('type="plane"', 'type="plane" surfacevel="1 0 0 0 0 0"'), "surfacevel"),
    "an activation": (robot().replace("<key ", '<key act="1" '), "act"),
    "two joints of one name": (
        robot().replace('<geom type="capsule"', '<joint name="swing" axis="1 0 0"/><geom type="capsule"'),
        "swing",
    ),
    "an aligned ball": (ALONE, "align"),
    "half a springdamper": (robot("", 'springdamper="0.5 0"'), "springdamper"),
    "a sequence": (robot('<compiler eulerseq="xyw"/>'), "eulerseq"),
}


@pytest.mark.parametrize(("text", "named"), REFUSED.values(), ids=REFUSED)
def test_what_is_unknown_or_cannot_act_here_is_refused_by_name(text, named):
    with refuses(MJCFError, named):
        read_mjcf(text)


@pytest.mark.parametrize("actuator", ACTUATORS)
@pytest.mark.parametrize("name", ["ctrlrnge", "stiffness", "kd"])
def test_no_kind_of_actuator_has_other_attributes(actuator, name):
    with refuses(MJCFError, name):
        read_mjcf(robot("", "", f'<{actuator} joint="swing" {name}="1 1"/>'))


def test_what_only_softens_contacts_is_told():
    text = robot("", 'frictionloss="0.1" solreffriction="0.01 1"').replace(
        '0.1"/>', '0.1" solref="0.01 1" gap="0.1"/>', 1
    )
    assert read_mjcf(text).notes == (
        'The `solref` and `gap` of <geom name="floor"> were not imported, because contacts are rigid here.',
        'The `solreffriction` of <joint name="swing"> was not imported, because dry friction holds without creeping '
        "here.",
    )


def test_contacts_inside_that_are_excluded_and_looks_move_nothing():
    text = robot('<contact><exclude body1="hull" body2="arm"/></contact><visual><map znear="0.1"/></visual>')
    text = text.replace('name="skin"', 'name="skin" rgba="1 0 0 1" group="3" user="1"')
    assert read_mjcf(text).notes == ()


def test_orientations_and_sites_between_points_are_those_of_mujoco():
    """A site between two points has its axis from the second to the first; z may be turned to any direction."""
    sites = '<site name="a" type="capsule" fromto="0 0 0.1 0.1 0.05 0"/>'
    sites += '<site name="b" zaxis="0 0 -2"/><site name="c" zaxis="1 2 -3"/>'
    sensors = "".join(f'<gyro name="{name}" site="{name}"/>' for name in "abc")
    text = (
        robot()
        .replace("<freejoint/>", f"<freejoint/>{sites}")
        .replace("</mujoco>", f"<sensor>{sensors}</sensor></mujoco>")
    )
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scenario = read_mjcf(text).scenario
    for name in "abc":
        own = np.asarray(scenario.sensors[name].frame.matrix())
        np.testing.assert_allclose(own, data.site(name).xmat.reshape(3, 3), rtol=0, atol=1e-15)
