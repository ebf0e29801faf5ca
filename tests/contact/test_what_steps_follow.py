"""What is known of a body with modes before a solve: what moves within a mode, and what varies with time alone.

The truth is the field, and the guards, in each mode and at several times.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import Ball, BallState, Circle, ConstantRate, Contact, Disk, DiskState, OnRail, PointMass, Resistance
from jaxball.physics import HarmonicForce, Mode, ParametricSurface, ReleasedState, TiltingPlane
from jaxball.physics.contact.body_on_plane import BodyOnPlane
from jaxball.physics.hybrid import Accuracy

SOLID = {"mass": 1.0, "inertia": (0.4, 0.45, 0.5), "gravity": 9.81, "offset": (0.1, 0.05, -0.1)}
FLAT = {"mass": 1.0, "inertia": 0.4, "gravity": 9.81, "offset": (0.1, 0.0, 0.05)}
LAW = Contact(friction=0.3, restitution=0.5)
ACCURACY = Accuracy(jnp.asarray(1e-6), jnp.asarray(1e-6), 8.0, 0.5)
TIMES = 0.0, 0.7, 11.3
BALL = ReleasedState(BallState(q=(0.8, 0.6, 0.0, 0.0), Omega=(0.3, 2.0, -1.0)), V=(0.4, 1.1, 0.0))
DISK = ReleasedState(DiskState(phi=0.3, phidot=2.0), V=(0.7, 0.0, 0.0))
CIRCLING = [PointMass(0.2, OnRail(Circle(0.5), ConstantRate(0.0, 3.0)))]
STILL = {"ball": (Ball(**SOLID), BALL), "disk": (Disk(**FLAT), DISK)}
HELD = {"held ball": (Ball(**SOLID, resistance=Resistance(dry=0.1, dry_spinning=0.01, exact=True)), BALL)}
DRIVEN = {
    "a mass on a rail": Ball(**SOLID, masses=CIRCLING),
    "a force": Ball(**SOLID, force=HarmonicForce((0.0, 0.0, 0.0), [(0.0, 0.0, 0.3)], [5.0])),
    "a plane that tilts": Ball(**SOLID, ground=TiltingPlane(about_e2=ConstantRate(0.0, 0.2))),
}


def in_mode(body, state, mode):
    """The body that is solved, and a packed state in a mode, no slip of which has just begun."""
    plane = BodyOnPlane(body, LAW).prepare()
    started = plane.start(jnp.asarray(0.0), state)
    return plane, plane.to_packed(jnp.asarray(0.0), dataclasses.replace(started, mode=jnp.asarray(float(mode))))


def follows(plane, packed):
    reference = plane.step_reference(jnp.asarray(0.0), plane.from_packed(jnp.asarray(0.0), packed), ACCURACY)
    return reference, plane.guards_follow_motion(jnp.asarray(0.0), packed, reference)


def guards_at_times(plane, packed, reference):
    return np.array([plane.guards_in_step(t, plane.from_packed(t, packed), reference) for t in map(jnp.asarray, TIMES)])


@pytest.mark.parametrize("mode", [Mode.ROLLING, Mode.SLIDING, Mode.FLIGHT])
@pytest.mark.parametrize(("body", "state"), [*STILL.values(), *HELD.values()], ids=[*STILL, *HELD])
def test_fields_that_modes_keep_are_the_last_and_have_no_rate(body, state, mode):
    plane, packed = in_mode(body, state, mode)
    rates = plane.field_of_packed(jnp.asarray(0.1), packed)
    for values in jax.tree.leaves(plane.kept_in_modes(rates)):
        np.testing.assert_array_equal(values, 0.0)
    # In the vector, they come behind all that moves.
    still, leaves = jax.tree.leaves(plane.kept_in_modes(packed)), jax.tree.leaves(packed)
    assert all(a is b for a, b in zip(leaves[-len(still) :], still, strict=True))
    assert any(np.any(values != 0) for values in jax.tree.leaves(rates)[: -len(still)])


@pytest.mark.parametrize("mode", [Mode.ROLLING, Mode.SLIDING, Mode.FLIGHT])
@pytest.mark.parametrize(("body", "state"), STILL.values(), ids=STILL)
def test_guards_follow_the_motion_where_they_are_the_same_at_all_times(body, state, mode):
    plane, packed = in_mode(body, state, mode)
    reference, follow = follows(plane, packed)
    assert follow
    values = guards_at_times(plane, packed, reference)
    np.testing.assert_array_equal(values, values[:1].repeat(len(TIMES), axis=0))


@pytest.mark.parametrize("body", DRIVEN.values(), ids=DRIVEN)
def test_guards_that_vary_with_time_alone_do_not_follow_the_motion(body):
    plane, packed = in_mode(body, BALL, Mode.ROLLING)
    reference, follow = follows(plane, packed)
    assert not follow
    assert np.ptp(guards_at_times(plane, packed, reference), axis=0).max() > 1e-3


def test_guards_over_a_surface_do_not_follow_the_motion():
    def hills(t, u1, u2):
        return jnp.stack([u1, u2, 0.01 * jnp.sin(3 * u1)])

    plane, packed = in_mode(Ball(**SOLID, ground=ParametricSurface(hills)), BALL, Mode.FLIGHT)
    assert not follows(plane, packed)[1]
