"""What has no contact, or cannot have one, is refused with a sentence that says the way out."""

import jax
import jax.numpy as jnp
import pytest

import jaxball
from jaxball import Ball, BallState, Contact, Disk, DiskState, ReducedState, ReleasedState, Status, simulate
from jaxball.ensemble import simulate_ensemble

TIMES = [0.0, 1.0]
BALL = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), radius=1.0, gravity=9.81)
DISK = Disk(mass=1.0, inertia=0.5)
LAW = Contact(friction=0.3)
THROWN = ReleasedState(BallState(), V=(1.0, 0.0, 0.0))
SENTENCES = {
    "negative friction": (
        lambda: Contact(friction=-0.1),
        "Argument `friction` must be 0 or positive, but it is -0.1.",
    ),
    "a rebound that creates energy": (
        lambda: Contact(friction=0.3, restitution=1.2),
        "Argument `restitution` must be from 0 to 1, or impacts would create energy, but it is 1.2.",
    ),
    "static friction below that of sliding": (
        lambda: Contact(friction=0.3, static_friction=0.2),
        "Argument `static_friction` must be no less than the coefficient `friction`, because friction cannot be larger "
        "on a body that slips, but it is 0.2.",
    ),
    "bounces without end": (
        lambda: Contact(friction=0.3, slowest=0.0),
        "Argument `slowest` must be a positive number, or bounces would never end, but it is 0.0.",
    ),
    "a function for friction": (
        lambda: Contact(friction=abs),
        "Argument `friction` must be a coefficient, or a law of friction such as SmoothedCoulomb(0.3, 0.01), but it is "
        "the function abs; a function of the slip speed is a subclass of AbstractFriction.",
    ),
    "a class for friction": (
        lambda: Contact(friction=jaxball.SmoothedCoulomb),
        "Argument `friction` must be a coefficient, or a law of friction such as SmoothedCoulomb(0.3, 0.01), but it is "
        "the class SmoothedCoulomb; make one with SmoothedCoulomb(...).",
    ),
    "no capacity": (lambda: Contact(friction=0.3, capacity=0), "Argument `capacity` must be 1 or more, but it is 0."),
    "a slip without a law": (
        lambda: simulate(BALL, TIMES, THROWN),
        "Argument `contact` must be given where `state` is a ReleasedState, because a body that may slip or fly needs "
        "a law of friction and impact, such as Contact(friction=0.3), but it is None.",
    ),
    "an ensemble of slips without a law": (
        lambda: simulate_ensemble(BALL, TIMES, THROWN),
        "Argument `contact` must be given where `state` is a ReleasedState, because a body that may slip or fly needs "
        "a law of friction and impact, such as Contact(friction=0.3), but it is None.",
    ),
    "a coefficient for a law": (
        lambda: simulate(BALL, TIMES, THROWN, contact=0.3),
        "Argument `contact` must be a Contact, such as Contact(friction=0.3), but it is 0.3.",
    ),
    "many laws": (
        lambda: simulate(BALL, TIMES, THROWN, contact=jax.vmap(Contact)(jnp.array([0.1, 0.3]))),
        "Argument `contact` must be one law, with `friction` of shape (), but its shape is (2,); for many runs use "
        "jax.vmap or jaxball.ensemble.simulate_ensemble.",
    ),
    "many throws": (
        lambda: simulate(BALL, TIMES, ReleasedState(BallState(), V=jnp.ones((2, 3))), contact=LAW),
        "Argument `state` must be one state, with `V` of shape (3,), but its shape is (2, 3); for many runs use "
        "jax.vmap or jaxball.ensemble.simulate_ensemble.",
    ),
    "a state without a place": (
        lambda: simulate(BALL, TIMES, ReducedState(), contact=LAW),
        "Argument `state` must be a BallState, a RotationState, a DiskState or a ReleasedState with `contact`, because "
        "a body that may slip has a velocity and a position, but it is a ReducedState.",
    ),
    "another body's state": (
        lambda: simulate(DISK, TIMES, THROWN, contact=LAW),
        "Argument `state` must be a DiskState for a Disk, but it is a BallState.",
    ),
    "a differential-algebraic form": (
        lambda: simulate(BALL, TIMES, BallState(), contact=LAW, dae=True, solver=jaxball.solvers.RadauIIA()),
        "Argument `dae` must be False for a body with a law of contact or dry friction, whose modes are differential "
        "equations, but it is True.",
    ),
    "a rotor": (
        lambda: simulate(
            jaxball.classical.FreeRigidBody(inertia=(1.0, 2.0, 3.0)),
            TIMES,
            jaxball.classical.RigidBodyState(Omega=(1.0, 0.0, 0.0)),
            contact=LAW,
        ),
        "Argument `contact` must be None for a FreeRigidBody, which is neither a Ball nor a Disk, but it is a Contact.",
    ),
}


@pytest.mark.parametrize("name", SENTENCES)
@pytest.mark.usefixtures("no_type_checks")
def test_sentence(name):
    call, sentence = SENTENCES[name]
    with pytest.raises((TypeError, ValueError)) as caught:
        call()
    assert str(caught.value) == sentence


@pytest.mark.thorough
def test_what_cannot_start_is_a_status():
    below = simulate(DISK, TIMES, ReleasedState(DiskState(), height=-0.1), contact=LAW)
    assert below.status == Status.IMPOSSIBLE
    assert "`state.height` must be 0 or positive, the body over the plane, but it is -0.1" in below.message
    askew = simulate(DISK, TIMES, ReleasedState(DiskState(), V=(1.0, 0.5, 0.0)), contact=LAW)
    assert askew.status == Status.IMPOSSIBLE
    assert "`state.V` must be in the plane of the disk, with 0 for its second entry" in askew.message
