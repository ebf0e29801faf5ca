"""Extremes of the contact force of runs whose modes change, against closed forms.

Where a bound has no reason of its own, 1e-9 is ten times the tolerance, as errors of a few steps add up.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import jaxball
from jaxball import (
    Ball,
    BallState,
    Contact,
    Disk,
    DiskState,
    Free,
    Ground,
    JointFriction,
    Resistance,
    contact_extremes,
    simulate,
)
from jaxball.physics import ReleasedState
from jaxball.simulation.ensemble import REDUCTIONS, simulate_ensemble

G, M, R = 9.81, 2.0, 0.5
SOLID = 0.4 * M * R**2
TIGHT: dict[str, Any] = {"rtol": 1e-10, "atol": 1e-10}


def ball(**others):
    return Ball(mass=M, inertia=(SOLID,) * 3, radius=R, gravity=G, **others)


def sliding(mu, speed=3.0):
    start = ReleasedState(BallState(), V=jnp.stack([speed, 0.0, 0.0]), height=0.0)
    return simulate(ball(), [0.0, 2.0], start, contact=Contact(mu), dense=True, **TIGHT)


@pytest.mark.thorough
def test_a_ball_that_slides_and_then_rolls():
    """|f| = μN until the slip ends, at 2v/(7μg), and 0 from then on."""
    mu, speed = 0.2, 3.0
    found = contact_extremes(sliding(mu))
    np.testing.assert_allclose(found.largest_friction, mu * M * G, rtol=1e-9)
    np.testing.assert_allclose(found.friction_needed, mu, rtol=1e-12)
    np.testing.assert_allclose(found.least_normal_force, M * G, rtol=1e-12)
    assert found.largest_friction_time <= 2 * speed / (7 * mu * G) + 1e-9
    np.testing.assert_array_equal(found.constant, [True, False, False])
    slopes = jax.jvp(
        lambda mu: (lambda e: (e.largest_friction, e.friction_needed))(contact_extremes(sliding(mu))), (mu,), (1.0,)
    )[1]
    np.testing.assert_allclose(slopes, [M * G, 1.0], rtol=1e-9)


@pytest.mark.thorough
def test_nothing_presses_a_ball_in_flight():
    """It falls, lands without a bounce and a spin, and stays."""
    start = ReleasedState(BallState(), V=(0.0, 0.0, 0.0), height=0.3)
    found = contact_extremes(simulate(ball(), [0.0, 1.0], start, contact=Contact(0.4), dense=True))
    assert found.least_normal_force == 0
    assert found.least_normal_force_time < np.sqrt(0.6 / G)
    assert not found.holds
    assert found.friction_needed == 0
    assert str(found).startswith("least normal force 0 at t = ")


@pytest.mark.long
def test_a_shaken_plate():
    """N = m (g − a ω² sin ωt), a body on a plate that stays below what would throw it off."""
    omega = 8.0

    def least(a):
        motion = Free(lambda t, a: jnp.stack([0.0 * t, 0.0 * t, a * jnp.sin(omega * t)]), a)
        run = simulate(ball(ground=Ground(motion=motion)), [0.0, 3.0], BallState(), dense=True, **TIGHT)
        found = contact_extremes(run)
        return found.least_normal_force, found.least_normal_force_time

    (value, time), (slope, _) = jax.jvp(least, (0.05,), (1.0,))
    np.testing.assert_allclose(value, M * (G - 0.05 * omega**2), rtol=1e-12)
    np.testing.assert_allclose(slope, -M * omega**2, rtol=1e-9)
    np.testing.assert_allclose(np.sin(omega * time), 1, rtol=1e-9)


BLOCK, DRY, RATE, HEIGHT = 0.5, 8.0, 3.0, 0.04


def guide(height=0.0):
    """A block in a tube that stands upright in a disk, on a plate that rises as X = −h sin ωt."""
    tube = jaxball.physics.mass_in_tube(BLOCK, (0.0, 0.0, 1.0), drive=JointFriction(DRY))
    motion = Free(lambda t, h: jnp.stack([0.0 * t, 0.0 * t, -h * jnp.sin(RATE * t)]), jnp.asarray(height))
    return Disk(mass=M, inertia=SOLID, radius=R, gravity=G, mechanisms=[tube], ground=Ground(motion=motion))


def extremes(speed, height):
    """The least normal force, when it is, and the largest friction, with a block that sets out at a speed."""
    start = DiskState(theta=[0.0], thetadot=jnp.stack([speed]))
    found = contact_extremes(simulate(guide(height), [0.0, 0.4], start, dense=True, **TIGHT))
    return found.least_normal_force, found.least_normal_force_time, found.largest_friction


@jaxball.jit
def extremes_and_rates(speed, height):
    """These, and their derivatives by the speed."""
    return jax.jvp(lambda speed: extremes(speed, height), (speed,), (1.0,))


@pytest.mark.long
def test_a_block_that_rises_in_its_tube_and_sticks():
    """N = M g − F while it slips upwards, which no state tells at the moment where it stops: then N = (M + m) g."""
    speed = 0.9
    stop = speed / (G + DRY / BLOCK)
    (force, time, friction), _ = extremes_and_rates(speed, 0.0)
    np.testing.assert_allclose(force, M * G - DRY, rtol=1e-9)
    assert time <= stop + 1e-9
    assert friction < 1e-9
    starts = jax.vmap(lambda v: DiskState(theta=v[None] * 0, thetadot=v[None]))(jnp.array([speed, -speed]))
    least = {"least_normal_force": REDUCTIONS["least_normal_force"]}
    many = simulate_ensemble(guide(), [0.0, 0.4], starts, in_axes=(None, 0), reductions=least, **TIGHT)
    # One that sinks presses with M g + F until it sticks.
    found = many.reductions["least_normal_force"]
    np.testing.assert_allclose(found, [M * G - DRY, (M + BLOCK) * G], rtol=1e-9)


@pytest.mark.long
def test_the_derivative_of_an_extreme_at_the_end_of_a_mode():
    """A block sinks until it sticks, at the time τ; then N = (M + m)(g + Ẍ), which grows with the time.

    Its speed falls at the rate F/m − g − Ẍ, and Ẍ = h ω² sin ωt.
    """

    def closed(speed):
        brake = DRY / BLOCK - G
        stop = float(brentq(lambda t: brake * t - HEIGHT * RATE * (1 - np.cos(RATE * t)) - speed, 0.0, 0.3, xtol=1e-15))  # pyright: ignore[reportArgumentType]
        push, jerk = HEIGHT * RATE**2 * np.sin(RATE * stop), HEIGHT * RATE**3 * np.cos(RATE * stop)
        return stop, (M + BLOCK) * (G + push), (M + BLOCK) * jerk / (brake - push)

    stop, value, slope = closed(0.9)
    (force, time, _), (rate, *_) = extremes_and_rates(-0.9, HEIGHT)
    np.testing.assert_allclose(time, stop, rtol=1e-9)
    np.testing.assert_allclose(force, value, rtol=1e-9)
    np.testing.assert_allclose(rate, -slope, rtol=1e-8)


@pytest.mark.long
@pytest.mark.parametrize("law", [None, pytest.param(Contact(0.5), marks=pytest.mark.slow)])
def test_dry_rolling_needs_friction_until_the_ball_rests(law):
    """Of a solid ball 5/7 of c m g, as its centre brakes at 5/7 of c g; none at rest."""
    c, speed = 0.06, 1.2
    rolling = ball(resistance=Resistance(dry=c, exact=True))
    start = BallState(Omega=(0.0, speed / R, 0.0))
    rest = speed / (5 / 7 * c * G)
    found = contact_extremes(simulate(rolling, [0.0, 2 * rest], start, contact=law, dense=True, **TIGHT))
    np.testing.assert_allclose(found.largest_friction, 5 / 7 * c * M * G, rtol=1e-9)
    np.testing.assert_allclose(found.friction_needed, 5 / 7 * c, rtol=1e-9)
    assert found.largest_friction_time <= rest + 1e-8
    np.testing.assert_array_equal(found.constant, [True, False, False])
