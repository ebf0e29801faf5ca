"""Derivatives with respect to times at which users' functions jump, though nobody declared these as kinks.

A disk of effective mass 1 + 0.5, or a ball, that is pushed by F until p is at z = F (p T − p²/2) / 1.5, so that dz/dp
is F (T − p) / 1.5. A bound of 1e-8 is ten times what runs at the default tolerance err by.
"""

import warnings

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

import jaxball
from jaxball.physics import classical
from tests.support.sentences import said

F, T, P = 0.7, 3.0, 1.3
BOUND = 1e-8
FORWARD = diffrax.ForwardMode()
ALONG = np.array([1.0, 0.0, 0.0])


def until(t, p):
    return jnp.where(t < p, F, 0.0) * ALONG


def pushed(force, adjoint=None, **options):
    disk = jaxball.Disk(mass=1.0, inertia=0.5, force=force)
    chosen = {} if adjoint is None else {"adjoint": adjoint}
    return jaxball.simulate(disk, (0.0, T), **chosen, **options)


def place(function, p, adjoint=None):
    return pushed(jaxball.FunctionForce(function, p), adjoint).state.z[-1]


@pytest.fixture(autouse=True)
def _no_warnings():
    with warnings.catch_warnings():
        warnings.simplefilter("error", jaxball.simulation.KinkWarning)
        yield


@pytest.mark.thorough
def test_a_ball():
    def reached(p):
        ball = jaxball.Ball(mass=1.0, inertia=(0.5, 0.5, 0.5), force=jaxball.FunctionForce(until, p))
        return jaxball.simulate(ball, (0.0, T)).state.z[-1, 0]

    value, slope = jaxball.jit(jax.value_and_grad(reached))(P)
    assert abs(value - F * (P * T - P**2 / 2) / 1.5) < BOUND
    assert abs(slope - F * (T - P) / 1.5) < BOUND


@pytest.mark.thorough
def test_in_a_batch_and_compiled_by_xla():
    """numerics/test_time_comparisons has the many ways in which a function may compare the time."""
    many = jnp.array([0.4, P, 2.9, 3.5])  # the last after the end of the run
    reverse = jax.jit(jax.vmap(jax.grad(lambda p: place(until, p))))(many)
    np.testing.assert_allclose(reverse, F * np.maximum(T - many, 0.0) / 1.5, atol=BOUND)


@pytest.mark.thorough
def test_a_captured_number_and_a_traced_one():
    def captured(p):
        return pushed(jaxball.FunctionForce(lambda t, _: until(t, p)), FORWARD).state.z[-1]

    assert abs(jax.jit(jax.jacfwd(captured))(P) - F * (T - P) / 1.5) < BOUND
    undeclared = pushed(jaxball.FunctionForce(lambda t, _: until(t, P)))
    declared = pushed(jaxball.FunctionForce(lambda t, _: until(t, P), kink_times=[P]))
    assert undeclared.steps == declared.steps
    np.testing.assert_array_equal(undeclared.state.z, declared.state.z)


@pytest.mark.thorough
def test_a_declared_time_is_one_kink():
    """The same run to the last bit, and one derivative, whichever of the two the numbers come from."""

    def declared(p, kink_time, adjoint=FORWARD):
        return pushed(jaxball.FunctionForce(until, p, kink_times=kink_time[None]), adjoint).state.z[-1]

    p = jnp.asarray(P)
    np.testing.assert_array_equal(declared(p, p), place(until, p, FORWARD))
    for kink_time in (lambda p: p, lambda p: jax.lax.stop_gradient(p), lambda p: (p + 0.3) - 0.3):
        slope = jax.jit(jax.jacfwd(lambda p, of=kink_time: declared(p, of(p))))(p)
        assert abs(slope - F * (T - P) / 1.5) < BOUND


class Ending(jaxball.physics.AbstractForce):
    end: Float[Array, ""] = eqx.field(converter=jnp.asarray)
    size: float = eqx.field(static=True, default=F)

    def __call__(self, t):
        return jnp.where(t < self.end, self.size, 0.0) * ALONG


class EndingWrench(jaxball.physics.AbstractWrench):
    end: Float[Array, ""] = eqx.field(converter=jnp.asarray)

    def wrench(self, t, motion):
        return jaxball.Wrench(until(t, self.end) + 0.0 * motion.velocity)


def ending(t, motion, p):
    return until(t, p) + 0.0 * motion.velocity


@pytest.mark.long
def test_a_wrench():
    slope = jaxball.jit(jax.jacfwd(lambda p: pushed(jaxball.FunctionWrench(ending, p)).state.z[-1]))(P)
    assert abs(slope - F * (T - P) / 1.5) < BOUND


@pytest.mark.thorough
def test_a_ramp_ends_steps_where_it_begins():
    """z = ∫∫ (t − p)₊ / 1.5 = (T − p)³ / 9."""
    ramp = jaxball.FunctionForce(lambda t, p: jnp.maximum(t - p, 0.0) * ALONG, P)
    run = pushed(ramp)
    assert abs(run.state.z[-1] - (T - P) ** 3 / 9) < BOUND
    assert run.steps == pushed(jaxball.FunctionForce(lambda t, p: jnp.maximum(t - p, 0.0) * ALONG, P, [P])).steps


def braked(t, state, p):
    return jnp.where(t < p, F, 0.0) + 0.0 * state.theta


class Braked(jaxball.AbstractLaw):
    end: Float[Array, ""] = eqx.field(converter=jnp.asarray)

    def __call__(self, t, state):
        return braked(t, state, self.end)


def driven(law):
    mass = jaxball.PointMass(0.3, jaxball.Driven(jaxball.Circle(0.5)))
    return jaxball.Disk(mass=1.0, inertia=0.4, masses=[mass], law=law)


@pytest.mark.long
def test_a_law():
    """θ = F (p T − p²/2)."""

    def angle(p):
        disk, state = driven(jaxball.FunctionLaw(braked, p)), jaxball.DiskState(theta=[0.0], thetadot=[0.0])
        return jaxball.simulate(disk, (0.0, T), state).state.theta[-1, 0]

    assert abs(jaxball.jit(jax.jacfwd(angle))(P) - F * (T - P)) < BOUND


class Step(jaxball.physics.AbstractSignal):
    end: Float[Array, ""] = eqx.field(converter=jnp.asarray)

    def __call__(self, t):
        return jnp.where(t < self.end, F, 0.0)


class Torque(jaxball.physics.AbstractJointForce):
    end: Float[Array, ""] = eqx.field(converter=jnp.asarray)

    def __call__(self, t, theta, thetadot, state):
        return jnp.where(t < self.end, F, 0.0)


def torque(t, theta, thetadot, state, p):
    return jnp.where(t < p, F, 0.0)


def swinging(drive):
    pendulum = jaxball.planar_pendulum(0.5, 0.6, drive=drive)
    return jaxball.Disk(mass=1.0, inertia=0.4, mechanisms=[pendulum])


@pytest.mark.long
def test_a_joint():
    """The same derivative as of the motor whose impulse is known, which needs no kink for it."""

    def angle(drive):
        return jaxball.simulate(swinging(drive), (0.0, T), rtol=1e-10, atol=1e-10).state.theta[-1, 0]

    def known(p):
        return jaxball.Motor(jaxball.PiecewiseSignal(jnp.stack([jnp.zeros_like(p), p]), [F]))

    found, expected = (jaxball.jit(jax.jacfwd(lambda p, of=of: angle(of(p))))(P) for of in (Torque, known))
    assert abs(found - expected) < BOUND
    assert abs(found) > 0.1


# All parts of bodies whose functions may compare the time.
BODIES = {
    "AbstractForce": lambda p: jaxball.Disk(mass=1.0, inertia=0.5, force=Ending(p)),
    "AbstractWrench": lambda p: jaxball.Disk(mass=1.0, inertia=0.5, force=EndingWrench(p)),
    "AbstractLaw": lambda p: driven(Braked(p)),
    "AbstractSignal": lambda p: swinging(jaxball.Motor(Step(p))),
    "FunctionJointForce": lambda p: swinging(jaxball.physics.FunctionJointForce(torque, p)),
    "sum": lambda p: swinging(Torque(p) + jaxball.Damper(0.0)),
    "schedule as a signal": lambda p: swinging(
        jaxball.Motor(jaxball.FunctionSchedule(lambda t, p: jnp.where(t < p, F, 0.0), p))
    ),
}


@pytest.mark.parametrize("name", BODIES)
def test_parts_of_a_body_have_their_kinks(name):
    """With their derivatives, as those have whose runs are differentiated above."""
    times, moved = jax.jvp(lambda p: BODIES[name](p).driving_kinks(), (jnp.asarray(P),), (jnp.asarray(1.0),))
    np.testing.assert_array_equal(times, [P])
    np.testing.assert_array_equal(moved, [1.0])


def test_motions_and_axes():
    def bent(t, p):
        return 0.25 * jnp.maximum(t - p, 0.0) ** 2

    class Bent(jaxball.AbstractSchedule):
        start: Float[Array, ""] = eqx.field(converter=jnp.asarray)

        def __call__(self, t):
            return bent(t, self.start)

        def shift(self, by):
            raise NotImplementedError

    for kinked in (
        Bent(P),
        jaxball.FunctionSchedule(bent, P),
        jaxball.OnRail(jaxball.Circle(0.5), Bent(P)),
        jaxball.Free(lambda t, p: bent(t, p) * ALONG, P),
        classical.FunctionAxis(lambda t, p: bent(t, p) * ALONG + 1.0, P),
    ):
        np.testing.assert_array_equal(kinked.kinks(), [P])


class Point(jaxball.physics.AbstractState):
    x: Float[Array, ""] = eqx.field(converter=jnp.asarray, default=0.0)


class Moved(jaxball.AbstractSystem[Point]):
    end: Float[Array, ""] = eqx.field(converter=jnp.asarray)
    state_type = Point

    def field(self, t, state):
        return Point(jnp.where(t < self.end, F, 0.0) + 0.0 * state.x)


@pytest.mark.thorough
def test_a_system():
    """x = F p."""
    slope = jaxball.jit(jax.grad(lambda p: jaxball.simulate(Moved(p), (0.0, T)).state.x[-1]))(P)
    assert abs(slope - F) < BOUND


@pytest.mark.long
def test_while_a_body_slides():
    """A disk on ice is pushed until p: z = F (p T − p²/2) / m."""

    def reached(p):
        disk = jaxball.Disk(mass=1.0, inertia=0.5, force=jaxball.FunctionForce(until, p))
        start = jaxball.physics.ReleasedState(jaxball.DiskState(), V=(1.0, 0.0, 0.0))
        return jaxball.simulate(disk, (0.0, T), start, contact=jaxball.Contact(friction=0.0)).state.z[-1]

    assert abs(jaxball.jit(jax.grad(reached))(P) - F * (T - P)) < BOUND


def periodic(t, p):
    return jnp.where(jnp.sin(t) > p, F, 0.0) * ALONG


@pytest.mark.thorough
def test_a_warning_where_times_are_not_known():
    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("default")
        pushed(jaxball.FunctionForce(periodic, 0.1))
        pushed(jaxball.FunctionForce(periodic, 0.1), dense=True)
    (warning,) = shown  # once, although the function was traced several times
    assert warning.category is jaxball.simulation.KinkWarning
    assert warning.filename == __file__
    said(str(warning.message), "kink_times")


@pytest.mark.thorough
def test_no_warning_where_times_are_given():
    pushed(jaxball.FunctionForce(periodic, 0.1, kink_times=[jnp.arcsin(0.1), jnp.pi - jnp.arcsin(0.1)]), max_steps=500)


@pytest.mark.thorough
def test_a_class_that_declares_its_kinks_is_believed():
    class Declared(Ending):
        def __call__(self, t):
            return jnp.where(jnp.sin(t) > 0.5, F, 0.0) * ALONG

        def kinks(self):
            return jnp.zeros(0)

    class Undeclared(Declared):
        kinks = jaxball.physics.AbstractForce.kinks

    pushed(Declared(0.0))
    with pytest.warns(
        jaxball.simulation.KinkWarning, match=r"Undeclared compares .* return the times from its method `kinks`"
    ):
        pushed(Undeclared(0.0))


def drag(t, motion, p):
    speed = jnp.linalg.norm(motion.velocity)
    square = jnp.sum(motion.velocity**2)
    return -p * jnp.where(speed > 0.5, 1.0, 2.0) * jnp.sqrt(jnp.where(square > 0, square, 1.0)) * motion.velocity


def test_no_warning_of_states_that_are_compared():
    assert jaxball.FunctionWrench(drag, 0.1).kinks().size == 0
    ball = jaxball.Ball(mass=1.0, inertia=(0.5, 0.5, 0.5), force=jaxball.FunctionWrench(drag, 0.1))
    assert ball.kinks().size == 0


def test_forces_of_jaxball_gain_no_kinks():
    push = jaxball.control.Push((0.3, 0.0, 0.0), start=1.0, duration=0.5)
    waves = jaxball.physics.HarmonicForce((0.1, 0.0, 0.0), [(0.1, 0.0, 0.0)], [2.0])
    for force, times in ((push, [1.0, 1.5]), (waves, [])):
        ball = jaxball.Ball(mass=1.0, inertia=(0.5, 0.5, 0.5), force=force)
        np.testing.assert_array_equal(ball.driving_kinks(), times)
