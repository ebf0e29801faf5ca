"""A law of contact, exact dry resistance and joints that stick, all at once.

The numbers are those of an independent event-driven model: seven linear equations for the accelerations, the friction,
the dry torque, the friction in the joint and the normal force, where what is held is found by trying all sets.
"""

from typing import Any, cast

import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import (
    Ball,
    BallState,
    Contact,
    Disk,
    DiskState,
    FunctionJointForce,
    JointFriction,
    ReleasedState,
    Resistance,
    simulate,
)

TIMES = jnp.array([0.0, 2.0, 4.0, 6.0])
# x, forward turn a, θ and their rates.
SOLVED = [
    [0.2705513381, -0.2050473371, 0.3411264639, -0.3888116019, -0.3888116019, -0.1054120827],
    [0.6451632439, 0.1695645688, -0.0932226974, 0.5301384500, 0.5301384500, 0.0],
    [0.4471676023, -0.0284310728, -0.0448989279, -0.3453109233, -0.3453109233, -0.3447466501],
]
# When, and the signs of slip, turn and joint afterwards; 0 for what is held.
CHANGES = [
    (0.047293518, 1, -1, -1),
    (0.157755789, 1, 1, -1),
    (0.166499319, 1, 0, -1),
    (0.466169167, 1, 1, 0),
    (0.729232143, 1, 1, 1),
    (0.887487437, 0, 1, 1),
    (1.024569372, 0, -1, 1),
    (1.455598304, 0, -1, 0),
    (1.829087668, 0, -1, -1),
    (2.677971649, 0, 1, -1),
    (3.009202923, 0, 1, 0),
    (4.104910053, 0, 1, 1),
    (4.639808441, 0, -1, 1),
    (4.997088442, 0, -1, 0),
    (5.628252938, 0, -1, -1),
]


def push(t, theta, thetadot, state, torque):
    return torque * jnp.sin(1.7 * t)


def run(times=TIMES, kind=Disk, **settings):
    drive = JointFriction(0.8) + FunctionJointForce(push, 2.2)
    resistance = Resistance(dry=0.03, exact=True)
    pendulum = jaxball.planar_pendulum(0.6, 0.7, drive=drive)
    inertia = 0.5 if kind is Disk else (0.5, 0.5, 0.5)
    wheel = kind(mass=1.0, inertia=inertia, gravity=9.81, resistance=resistance, mechanisms=[pendulum])
    turns: Any = DiskState(phidot=0.5) if kind is Disk else BallState(Omega=(0.0, -0.5, 0.0))
    start = type(turns)(**vars(turns) | {"theta": [0.4], "thetadot": [0.9]})
    return simulate(wheel, times, ReleasedState(start, V=(1.2, 0.0, 0.0)), contact=Contact(0.12), **settings)


@pytest.mark.long
def test_a_wheel_that_slips_rests_and_has_a_joint_that_sticks():
    done = run(rtol=1e-10, atol=1e-10)
    assert done.ok
    state, history = done.state, cast(Any, done.history)
    rows = np.stack(
        [state.z, -state.phi, state.theta[:, 0], history.V[:, 0], -state.phidot, state.thetadot[:, 0]], axis=1
    )
    np.testing.assert_allclose(rows[1:], SOLVED, atol=1e-8)
    assert state.thetadot[2, 0] == 0
    switches, count = history.switches, len(CHANGES)
    assert int(switches.count) == count
    np.testing.assert_allclose(switches.times[:count], [change[0] for change in CHANGES], atol=1e-8)
    np.testing.assert_array_equal(switches.directions_after[:count, 0], [change[3] for change in CHANGES])
    slides = np.asarray(switches.target[:count]) == jaxball.Mode.SLIDING
    np.testing.assert_array_equal(slides, [change[1] != 0 for change in CHANGES])


@pytest.mark.thorough
def test_a_ball_in_the_plane_of_the_wheel_does_the_same():
    done, count = run(jnp.array([0.0, 1.2]), Ball, rtol=1e-9, atol=1e-9), 7
    history = cast(Any, done.history)
    assert done.ok
    assert int(history.switches.count) == count
    np.testing.assert_allclose(history.switches.times[:count], [change[0] for change in CHANGES[:count]], atol=1e-7)
    np.testing.assert_array_equal(
        history.switches.directions_after[:count, 0], [change[3] for change in CHANGES[:count]]
    )
    slides = np.asarray(history.switches.target[:count]) == jaxball.Mode.SLIDING
    np.testing.assert_array_equal(slides, [change[1] != 0 for change in CHANGES[:count]])
