"""A law of contact, exact dry resistance and joints that stick, all at once.

Against an independent event-driven model: seven linear equations for the accelerations, the friction, the dry torque,
the friction in the joint and the normal force, where what is held is found by trying all sets.
"""

from typing import Any, cast

import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Ball, BallState, Contact, Disk, DiskState, JointFriction, Resistance, simulate
from jaxball.physics import FunctionJointForce, ReleasedState
from tests.support import event_driven_wheel
from tests.support.event_driven_wheel import Wheel

TIMES = jnp.array([0.0, 2.0, 4.0, 6.0])
START = np.array([0.0, 0.0, 0.4, 1.2, -0.5, 0.9])  # x, forward turn a, θ and their rates


def push(t, theta, thetadot, state, torque):
    return torque * jnp.sin(1.7 * t)


# Of slip, rolling and the joint.
WHEELS = {
    "no more at rest": Wheel(kinetic=(0.12, 0.03, 0.8), static=(0.12, 0.03, 0.8)),
    "more at rest": Wheel(kinetic=(0.12, 0.03, 0.8), static=(0.13, 0.06, 1.2)),
    "slippery": Wheel(kinetic=(0.05, 0.02, 0.8), static=(0.09, 0.03, 1.1), torque=3.0),
}
ALIKE = WHEELS["no more at rest"]


def run(times=TIMES, kind=Disk, of=ALIKE, **settings):
    slip, rolling, joint = zip(of.kinetic, of.static, strict=True)
    drive = JointFriction(*joint) + FunctionJointForce(push, of.torque)
    resistance = Resistance(dry=rolling[0], static_dry=rolling[1], exact=True)
    pendulum = jaxball.planar_pendulum(0.6, 0.7, drive=drive)
    inertia = 0.5 if kind is Disk else (0.5, 0.5, 0.5)
    wheel = kind(mass=1.0, inertia=inertia, gravity=9.81, resistance=resistance, mechanisms=[pendulum])
    turns: Any = DiskState(phidot=0.5) if kind is Disk else BallState(Omega=(0.0, -0.5, 0.0))
    start = type(turns)(**vars(turns) | {"theta": [0.4], "thetadot": [0.9]})
    return simulate(wheel, times, ReleasedState(start, V=(1.2, 0.0, 0.0)), contact=Contact(*slip), **settings)


def motion(done):
    """Returns x, a, θ and their rates."""
    state = done.state
    turns = state.theta[:, 0], done.history.V[:, 0], -state.phidot, state.thetadot[:, 0]
    return np.stack([state.z, -state.phi, *turns], axis=1)


def assert_changed(done, changes, bound):
    """When, and of what the slip and the joint do afterwards."""
    switches, count = cast(Any, done.history).switches, len(changes)
    assert int(switches.count) == count
    np.testing.assert_allclose(switches.times[:count], [change.time for change in changes], atol=bound)
    np.testing.assert_array_equal(switches.directions_after[:count, 0], [change.signs[2] for change in changes])
    slides = np.asarray(switches.target[:count]) == jaxball.physics.Mode.SLIDING
    np.testing.assert_array_equal(slides, [change.signs[0] != 0 for change in changes])


@pytest.mark.long
@pytest.mark.parametrize("of", WHEELS.values(), ids=WHEELS.keys())
def test_a_wheel_that_slips_rests_and_has_a_joint_that_sticks(of):
    """1e-8 is a hundred times the tolerance, as errors grow over some dozen changes."""
    done = run(of=of, rtol=1e-10, atol=1e-10)
    rows, changes = event_driven_wheel.run(of, START, np.asarray(TIMES))
    assert done.ok
    assert len(changes) > 10
    np.testing.assert_allclose(motion(done), rows, atol=1e-8)
    np.testing.assert_array_equal(motion(done)[rows[:, 5] == 0, 5], 0.0)  # what sticks
    assert_changed(done, changes, 1e-8)


@pytest.mark.thorough
def test_a_ball_in_the_plane_of_the_wheel_does_the_same():
    times = jnp.array([0.0, 1.2])
    done = run(times, Ball, rtol=1e-9, atol=1e-9)
    assert done.ok
    _, changes = event_driven_wheel.run(ALIKE, START, np.asarray(times))
    assert len(changes) == 7
    assert_changed(done, changes, 1e-7)
