"""Hybrid systems by the contract alone: events, resets and derivatives through them, compared with closed forms.

Events are met to rounding, and within modes the motions are polynomials of the time that the solver integrates exactly,
or exponentials, for which 1e-9 is ten times the tolerance.
"""

from typing import ClassVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float, Int

import jaxball
from jaxball import Status
from jaxball.analysis.chaos import lyapunov_spectrum
from jaxball.simulation.ensemble import simulate_ensemble
from tests.support.sentences import refuses, said

TIMES = np.linspace(0.0, 4.0, 17)
EXACT = {"rtol": 0, "atol": 1e-13}
# A step ends so near a zero, in lengths of the step, and derivatives are those there.
NEXT_TO = {"rtol": 1e-10, "atol": 1e-10}


def number(default):
    return eqx.field(converter=jnp.asarray, default=default)


class Moving(jaxball.physics.AbstractState):
    x: Float[Array, "*batch"] = number(1.0)
    v: Float[Array, "*batch"] = number(0.0)


class Bouncing(jaxball.AbstractSystem[Moving]):
    """A point that falls on a floor, from which it rebounds with −e times its speed."""

    g: Float[Array, "*batch"] = number(2.0)
    e: Float[Array, "*batch"] = number(0.8)

    state_type: ClassVar[type[Moving]] = Moving
    max_switches: ClassVar[int] = 5

    def field(self, t, state):
        return Moving(state.v, -self.g)

    def guards(self, t, state):
        return state.x[None]

    def reset(self, t, state, which):
        return Moving(jnp.zeros_like(state.x), -self.e * state.v)


def bounces(x, g, e, count):
    """The times of the first bounces of a point that is dropped from x: a geometric series."""
    first, speed = jnp.sqrt(2 * x / g), jnp.sqrt(2 * g * x)
    return first + jnp.concatenate([jnp.zeros(1), jnp.cumsum(2 * e ** jnp.arange(1.0, count) * speed / g)])


def after(x, e, g=2.0, count=3, t=4.0):
    """Place and speed after so many bounces."""
    speed, since = e**count * jnp.sqrt(2 * g * x), t - bounces(x, g, e, count)[-1]
    return jnp.stack([speed * since - g * since**2 / 2, speed - g * since])


def times_and_end(p, adjoint=None):
    """The times of the first three bounces, and place and speed at the end."""
    x, g, e = p
    run = jaxball.simulate(Bouncing(g, e), TIMES, Moving(x, 0.0), adjoint=adjoint)
    return jnp.concatenate([run.switches.times[:3], jnp.stack([run.state.x[-1], run.state.v[-1]])])


def in_closed_form(p):
    x, g, e = p
    return jnp.concatenate([bounces(x, g, e, 3), after(x, e, g)])


P = jnp.array([1.0, 2.0, 0.8])


@pytest.mark.thorough
def test_bounces_are_a_geometric_series():
    run = jaxball.simulate(Bouncing(), TIMES, dense=True, throw=True)
    times, speeds = bounces(1.0, 2.0, 0.8, 3), 2.0 * 0.8 ** np.arange(4)
    np.testing.assert_allclose(run.switches.times[:3], times, **EXACT)
    np.testing.assert_allclose(run.switches.before.v[:3], -speeds[:3], **EXACT)
    np.testing.assert_allclose(run.switches.after.v[:3], speeds[1:], **EXACT)
    np.testing.assert_allclose([run.state.x[-1], run.state.v[-1]], after(1.0, 0.8), **EXACT)
    np.testing.assert_allclose(run.at(1.5).v, speeds[1] - 2 * 0.5, **EXACT)
    assert int(run.switches.count) == 3
    assert not run.switches.grazing.any()
    assert run.switches.event.tolist() == [0, 0, 0, -1, -1]
    assert np.isnan(run.switches.times[3:]).all()
    assert "its mode switched 3 times\n    t = 1: event 0" in repr(run)
    assert run.contact is None


@pytest.mark.parametrize(
    ("jit", "differentiate", "adjoint"),
    [
        pytest.param(jax.jit, jax.jacfwd, diffrax.ForwardMode(), id="xla-forward", marks=pytest.mark.thorough),
        pytest.param(jaxball.jit, jax.jacrev, None, id="native-reverse", marks=pytest.mark.long),
    ],
)
def test_derivatives_go_through_the_times_of_events(jit, differentiate, adjoint):
    """They are those of the closed form, in which each time depends on the start, gravity and restitution."""
    found = jit(differentiate(lambda p: times_and_end(p, adjoint)))(P)
    np.testing.assert_allclose(found, jax.jacfwd(in_closed_form)(P), **NEXT_TO)


ORDERS = {
    "forward over forward": lambda f: jax.jacfwd(jax.jacfwd(f)),
    "forward over reverse": pytest.param(jax.hessian, marks=pytest.mark.long),
    "reverse over forward": pytest.param(lambda f: jax.jacrev(jax.jacfwd(f)), marks=pytest.mark.slow),
    "reverse over reverse": pytest.param(lambda f: jax.jacrev(jax.jacrev(f)), marks=pytest.mark.slow),
}


@pytest.mark.thorough
@pytest.mark.parametrize("twice", list(ORDERS.values()), ids=list(ORDERS))
def test_second_derivatives_go_through_the_times_of_events(twice):
    """Of three bounces and of what follows, by place, gravity and restitution."""
    expected = jax.jacfwd(jax.jacfwd(in_closed_form))(P)
    np.testing.assert_allclose(jax.jit(twice(times_and_end))(P), expected, **NEXT_TO)


@pytest.mark.long
def test_third_derivatives_are_refused():
    """The state at an event is moved along its field to second order only."""
    thrice = jax.jacfwd(jax.jacfwd(jax.jacfwd(lambda p: times_and_end(p, diffrax.ForwardMode()))))
    with refuses(TypeError):
        thrice(P)


@pytest.mark.thorough
def test_many_at_once():
    e = np.array([0.5, 0.6, 0.8, 0.9])
    many = simulate_ensemble(Bouncing(np.full(4, 2.0), e), (0.0, 2.4), Moving(), in_axes=(0, None)).trajectory
    speed = e * 2.0  # with e = 1/2 the third bounce is at t = 2.5
    landed = 1 + speed  # the second bounce
    height = np.where(landed > 2.4, speed * 1.4 - 1.4**2, np.nan)
    single = [jaxball.simulate(Bouncing(2.0, one), (0.0, 2.4)) for one in e]
    assert many.switches.count.tolist() == [int(run.switches.count) for run in single] == [2, 2, 1, 1]
    np.testing.assert_allclose(many.switches.times[:, 0], 1.0, **EXACT)
    np.testing.assert_allclose(many.state.x[2:, -1], height[2:], **EXACT)
    np.testing.assert_allclose(many.state.x[:, -1], [run.state.x[-1] for run in single], **EXACT)


@pytest.mark.long
def test_derivatives_of_many():
    """Of the state after the events, with respect to each run's own restitution."""
    e = jnp.array([0.7, 0.8])

    def ends(e):
        run = simulate_ensemble(Bouncing(jnp.full(2, 2.0), e), (0.0, 4.0), Moving(), in_axes=(0, None)).trajectory
        return run.state.x[:, -1]

    expected = [jax.jacfwd(lambda e: after(1.0, e)[0])(one) for one in e]
    np.testing.assert_allclose(jnp.diag(jax.jacfwd(ends)(e)), expected, **NEXT_TO)


@pytest.mark.thorough
def test_bounces_without_end_are_a_status():
    """With e = 1/2 infinitely many bounces end at t = 3; the time of each of the last hundred is rounded."""
    run = jaxball.simulate(Bouncing(2.0, 0.5), TIMES)
    assert run.status == Status.CHATTERED
    said(run.message, "static_friction")
    np.testing.assert_allclose(run.reached, 3.0, rtol=0, atol=1e-12)
    assert "more, which a larger `max_switches` of the system would keep" in repr(run.switches)


@pytest.mark.thorough
def test_a_guard_that_only_touches_zero_grazes():
    """Under a ceiling at the height that the point just reaches, |slope| at the event is that of rounding."""

    class Thrown(Bouncing):
        def guards(self, t, state):
            return (1.0 - state.x)[None]

        def reset(self, t, state, which):
            return state

    run = jaxball.simulate(Thrown(), TIMES, Moving(0.0, 2.0 * (1 + 1e-15)))
    assert int(run.switches.count) == 0 or bool(run.switches.grazing[0])


class Caught(jaxball.physics.AbstractState):
    x: Float[Array, ""] = number(0.0)
    v: Float[Array, ""] = number(1.0)
    caught: Int[Array, ""] = eqx.field(converter=jnp.asarray, default=0)


class Latch(jaxball.AbstractSystem[Caught]):
    """A mass that slides without force until a latch at 1 ties it to a spring, and slides on when it comes back."""

    omega: Float[Array, ""] = number(2.0)

    state_type: ClassVar[type[Caught]] = Caught

    def field(self, t, state):
        pull = jnp.where(state.caught == 1, -(self.omega**2) * (state.x - 1.0), 0.0)
        return Caught(state.v, pull, jnp.zeros_like(state.caught))

    def guards(self, t, state):
        free = jnp.where(state.caught == 0, 1.0 - state.x, 1.0)
        return jnp.stack([free, jnp.where(state.caught == 1, state.x - 1.0, 1.0)])

    def reset(self, t, state, which):
        return Caught(jnp.ones_like(state.x), state.v, which + 1)


@pytest.mark.thorough
def test_modes_are_integers_that_only_resets_change():
    """The mass is on the spring for half a period, and goes back as fast as it came."""
    run = jaxball.simulate(Latch(), TIMES, throw=True)
    released = 1 + np.pi / 2
    free, caught = TIMES < 1.0, released > TIMES
    assert run.state.caught.dtype == jnp.arange(1).dtype
    assert run.switches.event[:3].tolist() == [0, 1, -1]
    np.testing.assert_array_equal(
        run.state.caught[TIMES != 1.0], np.where(free, 0, np.where(caught, 1, 2))[TIMES != 1.0]
    )
    on_spring = np.where(caught, 1 + np.sin(2 * (TIMES - 1)) / 2, 1 + released - TIMES)
    expected = np.where(free, TIMES, on_spring)
    np.testing.assert_allclose(run.state.x, expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.switches.times[:2], [1.0, released], rtol=0, atol=1e-9)


@pytest.mark.thorough
def test_the_time_of_a_mode_has_derivatives():
    def end(omega):  # 1 + (1 + π/ω) − t, so that the derivatives are −π/ω² and 2π/ω³
        return jaxball.simulate(Latch(omega), TIMES).state.x[-1]

    np.testing.assert_allclose(jax.grad(end)(2.0), -np.pi / 4, rtol=0, atol=1e-9)
    np.testing.assert_allclose(jax.hessian(end)(2.0), np.pi / 4, rtol=0, atol=1e-8)


class Held(jaxball.physics.AbstractState):
    x: Float[Array, ""] = number(1.0)
    input: Float[Array, ""] = number(0.0)
    tick: Float[Array, ""] = number(0.5)


class Sampled(jaxball.AbstractSystem[Held]):
    """ẋ = u, where a controller sets u = −gain x at every tick of its clock, and holds it."""

    gain: Float[Array, ""] = number(0.6)
    period: Float[Array, ""] = number(0.5)

    state_type: ClassVar[type[Held]] = Held

    def field(self, t, state):
        none = jnp.zeros_like(state.x)
        return Held(state.input, none, none)

    def time_event(self, t, state):
        return state.tick

    def reset(self, t, state, which):
        return Held(state.x, -self.gain * state.x, t + self.period)


@pytest.mark.long
def test_time_events_are_those_of_a_sampled_controller():
    """x is multiplied by 1 − gain·period from tick to tick; at t = 4 the ninth has just not happened."""
    run = jaxball.simulate(Sampled(), TIMES, throw=True)
    assert run.switches.event[:7].tolist() == [0] * 7  # the number of guards
    np.testing.assert_allclose(run.switches.times[:7], 0.5 * np.arange(1, 8), **EXACT)
    np.testing.assert_allclose(run.state.x[-1], 0.7**7, **EXACT)

    def end(period):  # the last, shorter interval ends at t = 4
        return jaxball.simulate(Sampled(0.6, period), TIMES, Held(1.0, 0.0, period)).state.x[-1]

    def exact(period):
        return (1 - 0.6 * period) ** 7 * (1 - 0.6 * (4 - 8 * period))

    np.testing.assert_allclose(jax.grad(end)(0.47), jax.grad(exact)(0.47), rtol=0, atol=1e-12)


class Plane(jaxball.physics.AbstractState):
    x: Float[Array, "2"] = number((0.0, 0.0))
    v: Float[Array, "2"] = number((1.0, 1.0))


class Box(jaxball.AbstractSystem[Plane]):
    """A point in the plane that is reflected by two walls, at x = 1 and at y = 1."""

    state_type: ClassVar[type[Plane]] = Plane

    def field(self, t, state):
        return Plane(state.v, jnp.zeros_like(state.v))

    def guards(self, t, state):
        return 1.0 - state.x

    def reset(self, t, state, which):
        return Plane(state.x, jnp.where(jnp.arange(2) == which, -state.v, state.v))


@pytest.mark.thorough
def test_two_guards_that_vanish_together_are_two_events():
    """In a corner both walls reflect; elsewhere each in its turn."""
    corner = jaxball.simulate(Box(), TIMES, Plane(), throw=True)
    np.testing.assert_allclose(corner.state.x[-1], [-2.0, -2.0], rtol=0, atol=1e-12)
    assert sorted(corner.switches.event[:2].tolist()) == [0, 1]
    assert int(corner.switches.count) == 2
    turns = jaxball.simulate(Box(), TIMES, Plane(v=(1.0, 0.4)), throw=True)
    np.testing.assert_allclose(turns.switches.times[:2], [1.0, 2.5], **EXACT)
    np.testing.assert_allclose(turns.state.x[-1], [-2.0, 0.4], **EXACT)


def test_what_needs_a_smooth_system_refuses_others():
    with refuses(TypeError, "system"):
        lyapunov_spectrum(Bouncing(), (0.0, 4.0), Moving())
    with refuses(TypeError, "dae"):
        jaxball.simulate(Bouncing(), TIMES, dae=True)


def test_a_reset_that_returns_something_else():
    class Wrong(Bouncing):
        def reset(self, t, state, which):
            return -state.v

    with refuses(TypeError, "reset"):
        jaxball.simulate(Wrong(), TIMES)


@pytest.mark.thorough
def test_a_smooth_system_has_no_switches():
    run = jaxball.simulate(jaxball.Disk(mass=1.0, inertia=0.5), TIMES)
    assert int(run.switches.count) == 0
    assert run.switches.times.size == 0
    assert run.history.lines == []


@pytest.mark.thorough
@pytest.mark.parametrize("suffix", ["npz", "nc"])
def test_switches_are_saved_and_read_back(suffix, tmp_path):
    run = jaxball.simulate(Bouncing(), TIMES)
    again = jaxball.load_run(run.save(tmp_path / f"run.{suffix}"), system=Bouncing())
    np.testing.assert_array_equal(again.switches.times, run.switches.times)
    np.testing.assert_array_equal(again.switches.after.v, run.switches.after.v)
    assert repr(again.switches) == repr(run.switches)
