"""Where robots come from and go to: paths and texts, deep files, bombs, bodies and runs, and what a file keeps."""

import dataclasses
import functools
import re

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from jaxball import (
    Ball,
    CarriedMass,
    Contact,
    Disk,
    DiskState,
    Hinge,
    Mechanism,
    Motor,
    PDServo,
    PiecewiseSignal,
    load_scenario,
    simulate,
)
from jaxball.files.mjcf import MJCFError, read_mjcf, to_mjcf
from jaxball.files.urdf import URDFError, read_urdf
from jaxball.physics import ReleasedState, SpeedLimitedMotor
from jaxball.physics.classical import FreeRigidBody
from tests.mjcf.robots import SWAY, free_ball, free_disk, loaded, prescribed_ball, random_state, scenario, simple_ball
from tests.mjcf.test_corpus import saved_by_mujoco
from tests.mjcf.test_round_trip import BY_GEOMS, FOREIGN
from tests.support.sentences import refuses
from tests.urdf.robots import URDF

BUILTIN = ("disk", "bouncing-ball")
READERS = [(read_mjcf, FOREIGN, MJCFError, "an MJCF file"), (read_urdf, URDF, URDFError, "a URDF file")]


@pytest.mark.parametrize(("read", "text", "error", "kind"), READERS, ids=["mjcf", "urdf"])
def test_a_path_is_read_as_its_text_is(read, text, error, kind, tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text("\ufeff" + text, encoding="utf-8")  # with the mark that some editors put first
    expected = float(read(text).scenario.system.mass)
    assert float(read(path).scenario.system.mass) == float(read(str(path)).scenario.system.mass) == expected
    with refuses(error, "source"):
        read(tmp_path / "none.xml")
    path.write_bytes(b"\xff\xfe<")
    with refuses(error, "source"):
        read(path)


@pytest.mark.parametrize(("read", "text", "error", "kind"), READERS, ids=["mjcf", "urdf"])
def test_a_file_that_would_grow_is_refused(read, text, error, kind):
    """A billion laughs: each entity is ten of the one before."""
    entities = '<!ENTITY a "ha">' + "".join(
        f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip("abcdefgh", "bcdefghi", strict=True)
    )
    root = text.index("<mujoco") if "<mujoco" in text else text.index("<robot")
    with refuses(error, "The file"):
        read(f"{text[:root]}<!DOCTYPE robot [{entities}]>{text[root:]}")


def test_a_text_that_is_no_xml_says_so():
    with refuses(MJCFError, "The file"):
        read_mjcf("<mujoco>")


def test_moments_that_no_body_has_are_refused_and_small_ones_are_kept():
    """Negative ones had been taken for none. Those of a link of URDF may be below the least that MuJoCo requires."""
    with refuses(MJCFError, "arm"):
        text = """<mujoco><worldbody><geom type="plane" size="1 1 1"/>
          <body pos="0 0 1"><freejoint/><geom size="1" mass="1"/>
            <body name="arm"><joint/><inertial pos="0 0 0.1" mass="0.5" diaginertia="-0.01 -0.01 -0.01"/></body>
          </body></worldbody></mujoco>"""
        read_mjcf(text)
    small = 1e-17
    text = f"""<robot name="small">
      <link name="shell"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1"/></inertial>
        <collision><geometry><sphere radius="0.5"/></geometry></collision></link>
      <link name="arm">
        <inertial><mass value="1e-9"/><inertia ixx="{small}" iyy="{small}" izz="{small}"/></inertial></link>
      <joint name="turns" type="continuous"><parent link="shell"/><child link="arm"/><axis xyz="0 1 0"/></joint>
    </robot>"""
    masses = read_urdf(text).scenario.system.mechanisms[0].masses
    squares = sum(float(item.mass) * np.outer(item.place, item.place) for item in masses)
    np.testing.assert_allclose(np.trace(squares) * np.eye(3) - squares, small * np.eye(3), rtol=1e-12, atol=1e-30)


def nested(count, joint="", default=""):
    body = f'<body pos="0 0 1e-5">{joint}<inertial pos="0 0 0" mass="0.001" diaginertia="0 0 0"/>'
    inner = body * count + "</body>" * count
    return f"""<mujoco>{default}<worldbody><geom type="plane" size="1 1 1"/>
      <body pos="0 0 1"><freejoint/><geom size="1" mass="1"/>{inner}</body></worldbody></mujoco>"""


def test_a_file_may_be_nested_deeply():
    """2,000 bodies in each other, whose places add up, and 3,000 classes, of which the last has what all gave."""
    masses = read_mjcf(nested(2000)).scenario.system.point_masses
    assert len(masses) == 2000
    np.testing.assert_allclose(masses[-1].motion.position, [0.0, 0.0, 0.02], rtol=1e-10)  # 2,000 roundings
    opening = "".join(f'<default class="c{k}"><joint damping="{k + 1}"/>' for k in range(3000))
    default = f"<default>{opening}{'</default>' * 3000}</default>"
    read = read_mjcf(nested(1, '<joint class="c2999" axis="0 1 0"/>', default)).scenario
    assert float(read.system.mechanisms[0].drives[0].coefficient) == 3000.0
    count = 150  # of joints, each on the one before
    chain = read_mjcf(nested(count, '<joint axis="0 1 0"/>')).scenario.system.mechanisms[0]
    assert chain.n_joints == count
    assert chain.carriers(count - 1) == tuple(range(count))


def test_a_chain_of_links_in_urdf_may_be_long():
    inertial = '<inertial><mass value="0.001"/><inertia ixx="0" iyy="0" izz="0"/></inertial>'
    count = 1200  # more than calls may be nested; fixed links are one body
    links = "".join(f'<link name="l{k}">{inertial}</link>' for k in range(count))
    kinds = ["continuous" if k in (0, count - 1) else "fixed" for k in range(count)]
    joints = "".join(
        f'<joint name="j{k}" type="{kind}"><origin xyz="0.0001 0 0"/><parent link="{f"l{k - 1}" if k else "shell"}"/>'
        f'<child link="l{k}"/><axis xyz="0 1 0"/></joint>'
        for k, kind in enumerate(kinds)
    )
    read = read_urdf(URDF.replace("</robot>", f"{links}{joints}</robot>")).scenario
    assert [mechanism.n_joints for mechanism in read.system.mechanisms] == [3, 2]
    many = "".join(joints.replace('type="fixed"', 'type="continuous"').splitlines())
    few = 120
    text = URDF.replace(
        "</robot>", links + "".join(part + "</joint>" for part in many.split("</joint>")[:few]) + "</robot>"
    )
    for k in range(few, count):
        text = text.replace(f'<link name="l{k}">{inertial}</link>', "")
    assert [mechanism.n_joints for mechanism in read_urdf(text).scenario.system.mechanisms] == [3, few]


def test_an_exported_file_keeps_its_times_and_controls():
    """To the chords of a motor's signal, (0.1 s)² / 8 of its second derivative, and to a spline of a target's."""
    times = np.linspace(1.5, 4.5, 31)
    drives = [
        Motor(SWAY),
        SpeedLimitedMotor(SWAY, stall=0.4, free_speed=6.0),
        PDServo(SWAY, stiffness=2.0, damping=0.3, limit=0.5),
        PDServo(SWAY, stiffness=0.0, damping=0.3),  # which is the law of a motor with a limited speed
        PDServo(SWAY, stiffness=0.0, damping=0.3, limit=0.5),
        SWAY,
        Motor(0.3),
    ]
    mechanisms = [
        Mechanism([Hinge((0.0, 1.0, 0.2), drive=drive)], [CarriedMass(0.5, (0.1, 0.0, -0.5))]) for drive in drives
    ]
    system = Ball(mass=1.0, inertia=(0.5, 0.4, 0.45), mechanisms=mechanisms)
    exported = to_mjcf(dataclasses.replace(scenario(system), times=times))
    read = read_mjcf(exported.text)
    assert read.notes == ()
    np.testing.assert_array_equal(read.scenario.times, times)
    again = to_mjcf(read.scenario)
    assert again.controls == exported.controls
    linear = [0, 1, 3, 6]
    middle = (times[1:] + times[:-1]) / 2
    second = 0.4 * 1.7**3  # of the rate of SWAY
    for at, close in ((times, 1e-4), (middle, second * 0.1**2 / 8 * 1.01)):
        np.testing.assert_allclose(again.controls_at(at), exported.controls_at(at), rtol=0, atol=close)
    np.testing.assert_allclose(again.controls_at(times)[:, linear], exported.controls_at(times)[:, linear], rtol=1e-14)
    np.testing.assert_array_equal(read_mjcf(exported.text, times=[0.0, 1.0]).scenario.times, [0.0, 1.0])


def test_a_file_of_many_times_opens_in_mujoco_and_comes_back():
    """MuJoCo takes at most 500 numbers in an element."""
    times = np.linspace(0.0, 4.0, 1001)
    pendulum = Mechanism([Hinge((0.0, 1.0, 0.0), drive=Motor(SWAY))], [CarriedMass(0.5, (0.1, 0.0, -0.5))])
    system = Ball(mass=1.0, inertia=(0.5, 0.4, 0.45), mechanisms=[pendulum])
    exported = to_mjcf(dataclasses.replace(scenario(system), times=times))
    model, _ = loaded(exported.text)
    assert int(model.numeric_size.sum()) == 2002
    read = read_mjcf(exported.text).scenario
    np.testing.assert_array_equal(read.times, times)
    np.testing.assert_allclose(to_mjcf(read).controls_at(times), exported.controls_at(times), rtol=1e-14)


def test_a_signal_that_jumps_comes_back_without_ringing():
    steps = Motor(PiecewiseSignal(times=[0.0, 0.5, 1.0], values=[0.5, -0.5]))
    pendulum = Mechanism([Hinge((0.0, 1.0, 0.0), drive=steps)], [CarriedMass(0.5, (0.1, 0.0, -0.5))])
    system = Ball(mass=1.0, inertia=(0.5, 0.4, 0.45), mechanisms=[pendulum])
    case = dataclasses.replace(scenario(system), times=np.linspace(0.0, 1.0, 11))
    (motor,) = read_mjcf(to_mjcf(case).text).scenario.system.mechanisms[0].drives
    assert np.max(np.abs([motor.signal(jnp.asarray(t)) for t in np.linspace(0.0, 0.99, 50)])) <= 0.5


def test_times_of_a_file_that_do_not_increase_are_refused():
    numbers = '<custom><numeric name="jaxball.times" data="0 1 1"/></custom></mujoco>'
    text = FOREIGN.replace("</mujoco>", numbers)
    with refuses(MJCFError, "jaxball.times"):
        read_mjcf(text)
    control = '<numeric name="jaxball.control aim" data="0 1 1"/></custom>'
    other = text.replace("0 1 1", "0 1").replace("</custom>", control)
    with refuses(MJCFError, "data"):
        read_mjcf(other)


def test_the_time_of_a_keyframe_is_that_of_the_start():
    text = FOREIGN.replace("</mujoco>", '<keyframe><key time="2.5"/></keyframe></mujoco>')
    np.testing.assert_allclose(read_mjcf(text).scenario.times[[0, -1]], [2.5, 12.5])


def written(make):
    system = make()
    return to_mjcf(scenario(system, random_state(np.random.default_rng(3), system))).text


FILES = {
    **{make.__name__: functools.partial(written, make) for make in (free_ball, free_disk, prescribed_ball)},
    **{name: functools.partial(lambda name: to_mjcf(load_scenario(name)).text, name) for name in BUILTIN},
    "foreign": lambda: FOREIGN,
    "by geoms": lambda: BY_GEOMS.replace('<geom type="mesh" mesh="none" mass="0"/>', ""),
}


@pytest.mark.long
@pytest.mark.parametrize("name", FILES)
def test_a_file_that_mujoco_saved_is_the_same_robot(name, tmp_path):
    """Written again, it has MuJoCo's accelerations of the file, in the axes of space, to the six digits it saves.

    The links of exported files, of 1e-15, are saved as 0, which MuJoCo refuses and which is the same here.
    """
    text = FILES[name]()
    read, again = read_mjcf(text), read_mjcf(saved_by_mujoco(text, tmp_path / "saved.xml"))
    # Every actuator is saved as a <general>.
    assert again.notes == tuple(re.sub("<(motor|position) ", "<general ", note) for note in read.notes)
    one, other = read.scenario, again.scenario
    assert set(one.sensors) == set(other.sensors)
    assert type(one.state) is type(other.state), name
    assert (one.contact is None) == (other.contact is None)
    np.testing.assert_allclose(one.times, other.times, rtol=1e-5)
    accelerations = []
    for case in (one, other):
        model, data = loaded(to_mjcf(case).text)
        data.qpos[1 if isinstance(case.system, Disk) else 2] += 5.0
        mujoco.mj_forward(model, data)
        assert data.ncon == 0
        shell = np.array([])
        if not isinstance(case.system, Disk):
            turned = data.body("shell").xmat.reshape(3, 3) @ data.qacc[3:6]
            shell = np.concatenate([data.qacc[:3], turned])
        accelerations.append(np.concatenate([shell, data.qacc[3 if isinstance(case.system, Disk) else 6 :]]))
    scale = np.max(np.abs(accelerations[0]))
    # Servos of prescribed motions multiply the rounding of angles, 1e-6, by the square of their rate, 100.
    close = 1e-3 if name == "prescribed_ball" else 1e-4
    assert np.max(np.abs(accelerations[1] - accelerations[0])) <= close * scale


def test_a_body_and_a_run_are_written_as_their_scenario_is():
    system, state = simple_ball(), simple_ball().default_state()
    times = np.linspace(0.0, 10.0, 101)
    alone = dataclasses.replace(scenario(system), title="ball", times=times)
    assert to_mjcf(system).text == to_mjcf(alone).text
    assert to_mjcf(Disk(mass=1.0, inertia=0.5)).notes[0].startswith("The body always rolls here")
    run = simulate(system, [0.0, 0.1], state)
    assert to_mjcf(run).text == to_mjcf(dataclasses.replace(alone, times=np.array([0.0, 0.1]))).text
    of_scenario = load_scenario("three-rotors")
    short = dataclasses.replace(of_scenario, times=np.array([0.0, 0.1]))
    assert to_mjcf(short.simulate()).text == to_mjcf(short).text
    with refuses(MJCFError, "kind"):
        to_mjcf(FreeRigidBody(inertia=(1.0, 2.0, 3.0)))


@pytest.mark.thorough
def test_a_run_that_slips_has_its_law_in_the_file_and_a_batch_is_refused():
    ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4))
    state = ReleasedState(ball.default_state(), V=(1.0, 0.0, 0.0))
    run = simulate(ball, [0.0, 0.1], state, contact=Contact(friction=0.3))
    assert float(read_mjcf(to_mjcf(run).text).scenario.contact.friction) == 0.3
    disk = Disk(mass=1.0, inertia=0.5)
    batch = jax.vmap(lambda phidot: simulate(disk, [0.0, 0.1], DiskState(phidot=phidot)))(jnp.array([-1.0, -2.0]))
    with refuses(ValueError, "to_mjcf"):
        to_mjcf(batch)
