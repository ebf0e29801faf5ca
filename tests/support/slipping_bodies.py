"""Bodies that slip, stick, fly and bounce, each of another kind; every one with what it needs for a run.

Their contacts are such that friction gives way again and again, with a static coefficient as large as that of sliding,
so that slips begin with no acceleration, and with a larger one.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp

import jaxball
from jaxball import Ball, BallState, Circle, ConstantRate, Damper, Disk, Ground, Motor, OnRail, PointMass

UPRIGHT, SIDE = jaxball.SphericalFrame(0.0, 0.0), jaxball.SphericalFrame(1.2, 0.4)


class Case(NamedTuple):
    """A body, how it starts, and until when it is simulated."""

    body: Any
    state: Any
    end: float


def round_and_round(mass, radius, frame, rate):
    return PointMass(mass, OnRail(Circle(radius, frame=frame), ConstantRate(0.3, rate=rate)))


def masses_on_a_slope(resistance=None):
    masses = [round_and_round(0.3, 0.7, UPRIGHT, 1.7), round_and_round(0.2, 0.6, SIDE, -2.3)]
    body = Ball(
        mass=1.0,
        inertia=(0.4, 0.45, 0.5),
        offset=(0.05, 0.02, -0.1),
        masses=masses,
        ground=Ground(0.3, 0.4),
        resistance=resistance,
    )
    return Case(body, BallState(), 8.0)


def free_pendulum():
    pendulum = jaxball.spherical_pendulum(0.5, 0.6, drives=(Damper(0.02), None))
    body = Ball(
        mass=1.0, inertia=(0.4, 0.45, 0.5), offset=(0.0, 0.0, -0.05), mechanisms=[pendulum], ground=Ground(0.25)
    )
    return Case(body, BallState(theta=(0.9, 0.7), thetadot=(0.0, 1.5)), 6.0)


def motors():
    signal = jaxball.Sinusoids(0.0, amplitude=(0.2, 0.06), frequency=(0.7, 2.0))
    pendulum = jaxball.spherical_pendulum(0.8, 0.5, drives=(Motor(signal), Motor(0.1, limit=1.0)))
    body = Ball(mass=1.0, inertia=(0.4, 0.45, 0.5), mechanisms=[pendulum])
    return Case(body, BallState(theta=(0.1, 0.2), thetadot=(0.0, 0.0)), 4.0)


def all_resistances():
    return masses_on_a_slope(
        jaxball.Resistance(rolling=0.02, spinning=0.03, drag=0.02, rotational_drag=0.01, dry=0.02, smoothing=0.05)
    )


def shaken(t, size):
    return size * jnp.stack([jnp.sin(3.0 * t), 0.5 * jnp.sin(2.0 * t + 0.4), 0.1 * jnp.sin(5.0 * t)])


def shaken_turning_plane():
    ground = Ground(
        0.1,
        motion=jaxball.Free(shaken, jnp.array(0.12)),
        turntable=jaxball.Turntable(ConstantRate(0.0, rate=0.5), (0.3, -0.2)),
    )
    body = Ball(mass=1.0, inertia=(0.4, 0.45, 0.5), offset=(0.1, 0.05, -0.2), ground=ground)
    return Case(body, BallState(z=(0.5, 0.2), Omega=(0.3, 0.1, 0.5)), 6.0)


def disk():
    masses = [round_and_round(0.4, 0.6, UPRIGHT, 2.0)]
    return Case(Disk(mass=1.0, inertia=0.5, masses=masses), jaxball.DiskState(phidot=0.5), 6.0)
