"""Robots in URDF have the accelerations of the same robots in Python, in MJCF, and as MuJoCo itself reads them."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from jaxball import BallState, read_scenario, write_scenario
from jaxball.files.mjcf import read_mjcf, to_mjcf
from jaxball.files.urdf import read_urdf

from .robots import INSIDE_OUT, MJCF, URDF, added, in_python, rotation, turned

START = jnp.array(0.0)
RNG = np.random.default_rng(3)


def states(n, count=5):
    for _ in range(count):
        q = RNG.normal(size=4)
        q /= np.linalg.norm(q)
        yield BallState(
            q=q, Omega=RNG.normal(size=3), z=(0.1, 0.2), theta=0.3 * RNG.normal(size=n), thetadot=RNG.normal(size=n)
        )


def accelerations(system, state):
    rates = jax.jit(type(system).field)(system, START, state)
    return np.concatenate([rates.Omega, rates.thetadot])


@pytest.mark.thorough
def test_the_robot_is_that_of_python_and_that_of_mjcf():
    read, mjcf, python = read_urdf(URDF).scenario.system, read_mjcf(MJCF).scenario.system, in_python()
    for state in states(3):
        expected = accelerations(python, state)
        assert np.max(np.abs(expected)) > 1.0
        np.testing.assert_allclose(accelerations(read, state), expected, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(accelerations(mjcf, state), expected, rtol=1e-12, atol=1e-12)


def of_mujoco(text, scenario):
    """Accelerations of the joints by MuJoCo's own reader, and of what is written of the scenario, in free flight.

    Both move alike: the shell of one is the link with its own axes, and that of the other the ball with principal ones.
    """
    own, written = (mujoco.MjModel.from_xml_string(one) for one in (text, to_mjcf(scenario).text))
    np.testing.assert_allclose(np.sum(own.body_mass), np.sum(written.body_mass), rtol=1e-12)
    return own, mujoco.MjData(own), written, mujoco.MjData(written)


@pytest.mark.thorough
def test_the_robot_is_as_mujoco_reads_it():
    """MuJoCo needs a world in which the shell floats; friction is a constraint there and not compared."""
    free = '<joint name="free" type="floating"><parent link="world"/><child link="shell"/></joint>'
    text = added(URDF, '<link name="world"/>', free).replace('<mesh filename="package://robot/shell.stl"/>', BOX)
    own, ours, written, theirs = of_mujoco(text, read_urdf(text).scenario)
    for state in states(3):
        for data in (ours, theirs):
            data.qpos[:] = np.concatenate([(0.0, 0.0, 9.0), state.q, state.theta])
            data.qvel[:] = np.concatenate([(0.1, -0.2, 0.3), state.Omega, state.thetadot])
        mujoco.mj_forward(own, ours)
        mujoco.mj_forward(written, theirs)
        # Links of the writer have a mass of 1e-15 of their own.
        np.testing.assert_allclose(theirs.qacc_smooth, ours.qacc_smooth, rtol=1e-9, atol=1e-9)


BOX = '<box size="0.1 0.1 0.1"/>'


@pytest.mark.thorough
def test_a_robot_whose_root_is_inside_is_as_mujoco_reads_it():
    """MuJoCo moves the root, the frame, and not the shell: both have the same motion, and the same accelerations."""
    scenario = read_urdf(INSIDE_OUT).scenario
    own, ours, written, theirs = of_mujoco(INSIDE_OUT, scenario)
    axes = rotation(np.asarray(scenario.state.q))  # principal axes of shell and plate where the root is upright
    for numbers in np.random.default_rng(5).normal(size=(4, 2)):
        theta, rate = numbers
        ours.qpos[:] = [0.0, 0.0, 9.0, 0.6, 0.0, 0.8, 0.0, theta]
        ours.qvel[:] = [0.1, -0.2, 0.3, 0.5, 0.7, -0.4, rate]
        mujoco.mj_forward(own, ours)
        shell = mujoco.mj_name2id(own, mujoco.mjtObj.mjOBJ_BODY, "shell")
        link, at_zero = ours.xmat[shell].reshape(3, 3), own_turn()
        turn = link @ at_zero.T @ axes
        velocity = np.zeros(6)
        mujoco.mj_objectVelocity(own, ours, mujoco.mjtObj.mjOBJ_XBODY, shell, velocity, 0)
        quat = np.zeros(4)
        mujoco.mju_mat2Quat(quat, turn.reshape(9))
        theirs.qpos[:] = [*ours.xpos[shell], *quat, theta]
        theirs.qvel[:] = [*velocity[3:], *(turn.T @ velocity[:3]), rate]
        mujoco.mj_forward(written, theirs)
        np.testing.assert_allclose(theirs.qacc_smooth[6], ours.qacc_smooth[6], rtol=1e-9, atol=1e-9)


def own_turn():
    """The shell's link in the root where θ is 0."""
    return turned(0.2, -0.1, 0.4)


def test_the_root_is_upright_at_the_start():
    shell = read_urdf(INSIDE_OUT.replace('name="bolts" type="fixed"', 'name="bolts" type="continuous"')).scenario
    np.testing.assert_allclose(rotation(np.asarray(shell.state.q)), own_turn(), rtol=0, atol=1e-15)


@pytest.mark.thorough
def test_what_is_read_runs_and_is_written_as_a_scenario():
    scenario = read_urdf(URDF, times=np.array([0.0, 0.2])).scenario
    again = read_scenario(write_scenario(scenario))
    run = again.simulate(throw=True)
    assert again.title == "pendulum robot"
    np.testing.assert_allclose(run.state.theta, scenario.simulate(throw=True).state.theta, rtol=1e-9)


def test_notes_name_what_was_not_read():
    lid = '<link name="lid"><visual><geometry><sphere radius="0.1"/></geometry></visual></link>'
    bolts = '<joint name="bolts" type="fixed"><parent link="shell"/><child link="lid"/></joint>'
    text = added(URDF, lid, bolts, '<gazebo/><transmission name="t"/>')
    text = text.replace('<cylinder radius="0.03" length="0.08"/>', '<mesh filename="bob.stl"/>')
    assert read_urdf(text).notes == (
        'The limits of <joint name="swing">, -1 and 1.2, were not imported, because URDF gives them no stiffness; add '
        "`end-stops` to the joint in the scenario.",
        'The limits of <joint name="slide">, -0.05 and 0.05, were not imported, because URDF gives them no stiffness; '
        "add `end-stops` to the joint in the scenario.",
        'The `effort` and `velocity` of <joint name="swing"> and <joint name="slide"> were not imported, because URDF '
        "has no motors; give them to those that you add.",
        'The meshes of <link name="pendulum"> were not read; they are taken to be inside the shell.',
        'The mass of <link name="lid"> is 0, because there is no <inertial>.',
        "<gazebo> and <transmission> in <robot> were not read.",
    )
    assert read_urdf(INSIDE_OUT).notes == ()


def test_notes_name_attributes_and_elements_that_move_nothing_here():
    text = INSIDE_OUT.replace('<link name="plate">', '<link name="plate" kind="a"><sensor/><self_collide/>')
    assert read_urdf(text).notes == (
        '`kind` of <link name="plate"> was not read.',
        '<sensor> and <self_collide> in <link name="plate"> were not read.',
    )
