"""Runs through XLA's compiler have the switches and states of those through jaxball's own.

Where steps end at zeros of guards, rounding decides how many more are tried: parameters moved by one rounding change
their number by as much.
"""

import jax
import numpy as np
import pytest

import jaxball
from jaxball import Ball, BallState, Bowl, Contact, Disk, DiskState, JointFriction, Resistance, simulate
from jaxball.physics import ReleasedState, SignedDistance
from tests.support.signed_distances import inside_sphere

G = 9.81
ROUNDED_APART = 1e-11
FINE = {"rtol": 1e-11, "atol": 1e-11}


def sticking_joint():
    arm = jaxball.planar_pendulum(0.7, 0.2, drive=JointFriction(kinetic=0.1, static=0.3))
    disk = Disk(mass=2.0, inertia=0.072, radius=0.3, gravity=G, mechanisms=[arm])
    tossed = ReleasedState(DiskState(theta=[0.6], thetadot=[0.0]), V=(1.5, 0.0, 0.0), height=0.1)
    return simulate(disk, np.linspace(0.0, 1.0, 5), tossed, contact=Contact(0.2), **FINE)


def rest_in_a_bowl():
    felt = Resistance(dry=0.12, dry_spinning=0.01, exact=True)
    ball = Ball(mass=2.0, inertia=(0.072,) * 3, radius=0.3, gravity=G, ground=Bowl(2.0), resistance=felt)
    thrown = ReleasedState(BallState(), V=(0.9, 1.2, 0.0))
    return simulate(ball, np.linspace(0.0, 4.0, 5), thrown, contact=Contact(0.3), **FINE)


def bounce_on_a_signed_distance():
    ground = SignedDistance(inside_sphere, 1.0, centre=(0.0, 0.0, 1.0), guess=1.0)
    ball = Ball(mass=1.0, radius=0.1, inertia=(0.004,) * 3, gravity=G, ground=ground)
    thrown = ReleasedState(BallState(z=(0.3, 0.1), Omega=(1.0, 2.0, 3.0)), V=(0.2, 0.5, 0.0), height=0.3)
    return simulate(ball, np.linspace(0.0, 0.8, 5), thrown, contact=Contact(0.3, restitution=0.7), **FINE)


@pytest.mark.slow
@pytest.mark.parametrize("run", [sticking_joint, rest_in_a_bowl, bounce_on_a_signed_distance])
def test_switches_and_states_are_the_same(run):
    with jaxball.compiler("native"):
        ours = run()
    with jaxball.compiler("xla"):
        theirs = run()
    count = int(ours.switches.count)
    assert count == int(theirs.switches.count) > 0
    assert ours.status == theirs.status
    for field in ("target", "cause"):
        here, there = (getattr(of.contact.switches, field)[:count] for of in (ours, theirs))
        np.testing.assert_array_equal(here, there, err_msg=field)
    np.testing.assert_allclose(ours.switches.times[:count], theirs.switches.times[:count], atol=ROUNDED_APART)
    for here, there in zip(jax.tree.leaves(ours.state), jax.tree.leaves(theirs.state), strict=True):
        np.testing.assert_allclose(here, there, atol=ROUNDED_APART)
