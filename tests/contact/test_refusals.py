"""What has no contact, or cannot have one, is refused with a sentence that says the way out."""

import jax
import jax.numpy as jnp
import pytest

import jaxball
from jaxball import Ball, BallState, Contact, Disk, DiskState, Status, simulate
from jaxball.physics import ReducedState, ReleasedState
from jaxball.simulation.ensemble import simulate_ensemble
from tests.support.sentences import refuses, said

TIMES = [0.0, 1.0]
BALL = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), radius=1.0, gravity=9.81)
DISK = Disk(mass=1.0, inertia=0.5)
LAW = Contact(friction=0.3)
THROWN = ReleasedState(BallState(), V=(1.0, 0.0, 0.0))
SENTENCES = {
    "negative friction": (lambda: Contact(friction=-0.1), "friction"),
    "a rebound that creates energy": (lambda: Contact(friction=0.3, restitution=1.2), "restitution"),
    "static friction below that of sliding": (lambda: Contact(friction=0.3, static_friction=0.2), "static_friction"),
    "bounces without end": (lambda: Contact(friction=0.3, slowest=0.0), "slowest"),
    "a function for friction": (lambda: Contact(friction=abs), "friction"),
    "a class for friction": (lambda: Contact(friction=jaxball.physics.SmoothedCoulomb), "friction"),
    "no capacity": (lambda: Contact(friction=0.3, capacity=0), "capacity"),
    "a slip without a law": (lambda: simulate(BALL, TIMES, THROWN), "contact"),
    "an ensemble of slips without a law": (lambda: simulate_ensemble(BALL, TIMES, THROWN), "contact"),
    "a coefficient for a law": (lambda: simulate(BALL, TIMES, THROWN, contact=0.3), "contact"),
    "many laws": (lambda: simulate(BALL, TIMES, THROWN, contact=jax.vmap(Contact)(jnp.array([0.1, 0.3]))), "contact"),
    "many throws": (
        lambda: simulate(BALL, TIMES, ReleasedState(BallState(), V=jnp.ones((2, 3))), contact=LAW),
        "state",
    ),
    "a state without a place": (lambda: simulate(BALL, TIMES, ReducedState(), contact=LAW), "state"),
    "another body's state": (lambda: simulate(DISK, TIMES, THROWN, contact=LAW), "state"),
    "a differential-algebraic form": (
        lambda: simulate(BALL, TIMES, BallState(), contact=LAW, dae=True, solver=jaxball.simulation.solvers.RadauIIA()),
        "dae",
    ),
    "a projection of a disk's state": (
        lambda: simulate(DISK, TIMES, ReleasedState(jaxball.DiskState(), V=(1.0, 0.0, 0.0)), contact=LAW, project=True),
        "project",
    ),
    "a rotor": (
        lambda: simulate(
            jaxball.physics.classical.FreeRigidBody(inertia=(1.0, 2.0, 3.0)),
            TIMES,
            jaxball.physics.classical.RigidBodyState(Omega=(1.0, 0.0, 0.0)),
            contact=LAW,
        ),
        "contact",
    ),
}


@pytest.mark.parametrize("name", SENTENCES)
@pytest.mark.usefixtures("no_type_checks")
def test_sentence(name):
    call, named = SENTENCES[name]
    with refuses((TypeError, ValueError), named):
        call()


@pytest.mark.thorough
def test_what_cannot_start_is_a_status():
    below = simulate(DISK, TIMES, ReleasedState(DiskState(), height=-0.1), contact=LAW)
    assert below.status == Status.IMPOSSIBLE
    said(below.message, "state.height")
    askew = simulate(DISK, TIMES, ReleasedState(DiskState(), V=(1.0, 0.5, 0.0)), contact=LAW)
    assert askew.status == Status.IMPOSSIBLE
    said(askew.message, "state.V")
