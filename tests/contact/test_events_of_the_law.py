"""Leaving the plane and slipping as events of a run with a law of contact, by which the body then flies and slips."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Ball, BallState, Contact, Detachment, Disk, DiskState, Free, PointMass, Slip, Status, simulate
from jaxball.physics import ReleasedState, SwitchCause
from jaxball.simulation.ensemble import simulate_ensemble
from tests.support.differences import slope

WHEEL = Disk(mass=1.0, inertia=0.3, offset=(0.0, 0.0, -0.4))
BALL = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), radius=1.0, gravity=9.81)
TIMES = np.linspace(0.0, 2.0, 21)
FINE = {"rtol": 1e-12, "atol": 1e-12, "max_steps": 256}
SLIDING, STATIC = 0.25, 0.3


def slip_of_wheel(speed, friction, contact=None):
    return simulate(WHEEL, TIMES, DiskState(phidot=speed), events={"slip": Slip(friction)}, contact=contact, **FINE)


@jaxball.jit
@jax.grad
def slope_of_time(speed, static):
    law = Contact(SLIDING, static_friction=static)
    return slip_of_wheel(speed, STATIC, law).events["slip"].times[0]


@pytest.mark.thorough
@pytest.mark.parametrize("static", [STATIC, 2 * STATIC])
def test_a_slip_is_when_it_is_without_the_law(static):
    """Whether the law lets go then, or would hold the wheel by more friction: the time, and its derivative."""
    law = Contact(SLIDING, static_friction=static)
    alone, ruled = (slip_of_wheel(4.0, STATIC, contact) for contact in (None, law))
    assert alone.status == ruled.status == Status.SLIPPED
    assert float(ruled.reached) == pytest.approx(float(alone.reached), abs=1e-9)
    np.testing.assert_allclose(ruled.events["slip"].state.phi[0], alone.events["slip"].state.phi[0], atol=1e-9)
    np.testing.assert_array_equal(np.isfinite(ruled.state.phi), ruled.reached >= TIMES)
    causes = ruled.contact.switches.cause[: int(ruled.contact.switches.count)].tolist()
    assert causes == ([SwitchCause.GIVES_WAY] if static == STATIC else [])

    found = slope_of_time(4.0, static)
    expected = slope(lambda speed: float(slip_of_wheel(speed, STATIC).reached), 4.0, 1e-3)
    assert float(found) == pytest.approx(expected, rel=1e-7)


def swing(t, amplitude):
    return amplitude * jnp.sin(6.0 * t) * jnp.array([0.0, 0.0, 1.0])


@pytest.mark.thorough
@pytest.mark.parametrize("speed", [0.0, 9.0])
def test_a_run_ends_where_the_body_lifts(speed):
    """A mass that swings up and down in a ball at rest: N = M g − m a w² sin wt. One that slides lifts, too."""
    a, m = 0.8, 0.8
    ball = Ball(
        mass=1.0, inertia=(0.4, 0.4, 0.4), radius=1.0, gravity=9.81, masses=[PointMass(m, Free(swing, jnp.array(a)))]
    )
    start = ReleasedState(BallState(), V=(speed, 0.0, 0.0))
    run = simulate(ball, TIMES[:11], start, contact=Contact(0.3), events={"lift": Detachment()}, **FINE)
    assert run.status == Status.DETACHED
    last = int(run.contact.switches.count) - 1
    assert run.contact.switches.cause[last] == SwitchCause.LIFTS
    assert float(run.reached) == float(run.contact.switches.times[last]) == float(run.events["lift"].times[0])
    if speed == 0.0:
        assert float(run.reached) == pytest.approx(np.arcsin(1.8 * 9.81 / (m * a * 36.0)) / 6.0, abs=1e-9)
    np.testing.assert_array_equal(np.isfinite(run.contact.height), run.reached >= TIMES[:11])


@pytest.mark.thorough
def test_a_ball_that_comes_down_slips_from_then_on():
    """A bounce is neither event; flight at the start counts as having left, and a slip at the start as a slip."""
    events = {"lift": Detachment(terminal=False), "slip": Slip(0.2, terminal=False), "more": Slip(0.21, terminal=False)}
    thrown = ReleasedState(BallState(), V=(2.0, 0.0, 0.0), height=0.3)
    run = simulate(BALL, TIMES, thrown, contact=Contact(0.2), events=events, **FINE)
    assert run.status == Status.SUCCESS
    assert [int(run.events[name].count) for name in ("lift", "slip", "more")] == [1, 1, 0]
    assert float(run.events["lift"].times[0]) == 0.0
    assert float(run.events["slip"].times[0]) == pytest.approx(np.sqrt(0.6 / 9.81), abs=1e-9)
    bounces = Contact(0.2, restitution=0.5, slowest=0.1)
    run = simulate(BALL, TIMES, thrown, contact=bounces, events=events, **FINE)
    assert int(run.contact.switches.count) >= 3
    assert int(run.events["lift"].count) == 1
    sliding = ReleasedState(BallState(), V=(2.0, 0.0, 0.0))
    run = simulate(BALL, TIMES, sliding, contact=Contact(0.2), events={"slip": Slip(0.2)}, **FINE)
    assert (int(run.status), float(run.reached)) == (Status.SLIPPED, 0.0)


@pytest.mark.thorough
def test_many_runs_end_as_each_of_them():
    """At their own times, or, held by enough friction, not at all."""
    law, slip = Contact(SLIDING, static_friction=STATIC), {"slip": Slip(STATIC)}
    speeds = jnp.array([0.2, 4.0, 5.0])
    systems, states = jax.vmap(lambda speed: (WHEEL, DiskState(phidot=speed)))(speeds)
    many = simulate_ensemble(systems, TIMES, states, events=slip, contact=law, **FINE)
    for k, speed in enumerate(speeds):
        alone = slip_of_wheel(speed, STATIC, law)
        assert many[k].status == alone.status
        assert float(many[k].reached) == pytest.approx(float(alone.reached), abs=1e-9)
    assert len({*np.asarray(many.trajectory.status).tolist()}) == 2
