"""Robots whose linear equations are known in closed form."""

import jax
import numpy as np
from scipy.linalg import expm

import jaxball

MASS, INERTIA, RADIUS, GRAVITY, WEIGHT, LENGTH = 1.0, 0.5, 1.0, 2.0, 0.5, 0.6
WHEEL, WHEEL_RADIUS = 0.3, 0.4


def with_pendulum(drive=None, **changes):
    """A disk with a pendulum on a hinge at its centre."""
    parameters = {"mass": MASS, "inertia": INERTIA, "gravity": GRAVITY} | changes
    drive = jaxball.Motor(0.0) if drive is None else drive
    return jaxball.Disk(**parameters, mechanisms=[jaxball.planar_pendulum(WEIGHT, LENGTH, drive=drive)])


def with_wheel():
    """A disk with a wheel on its axis: a torque between them turns both in proportion to it."""
    wheel = jaxball.ring_rotor(WHEEL, WHEEL_RADIUS, axis=(0.0, 1.0, 0.0), drive=jaxball.Motor(0.0))
    return jaxball.Disk(mass=MASS, inertia=INERTIA, gravity=GRAVITY, mechanisms=[wheel])


def ball_with_pendulum(drives, **changes):
    """A ball with a pendulum in a yoke."""
    parameters = {"mass": 1.0, "inertia": (0.4, 0.35, 0.45), "gravity": 9.81} | changes
    pendulum = jaxball.spherical_pendulum(0.5, 0.6, drives=drives)
    return jaxball.Ball(**parameters, mechanisms=[pendulum], resistance=jaxball.Resistance(rolling=0.01))


def held(rate, control, h):
    """A and B of ẋ = rate x + control u over h, with u held, by the matrix exponential."""
    n, m = control.shape
    whole = expm(h * np.block([[rate, control], [np.zeros((m, n + m))]]))
    return whole[:n, :n], whole[:n, n:]


def small_oscillations():
    """ẋ = rate x + control u of (φ, φ̇, z, θ, θ̇) for small oscillations of the disk with a pendulum.

    The pendulum leans by β = θ − φ: with I = m0 r² + d, the energies are T = ½ I φ̇² + ½ m (r φ̇ + l β̇)² and
    V = ½ m g l β², and the torque u has the power u θ̇ = u (β̇ + φ̇).
    """
    m, l, r = WEIGHT, LENGTH, RADIUS
    inertia = np.array([[MASS * r**2 + INERTIA + m * r**2, m * r * l], [m * r * l, m * l**2]])
    by_beta = np.linalg.solve(inertia, [0.0, -m * GRAVITY * l])
    by_u = np.linalg.solve(inertia, [1.0, 1.0])
    rate, control = np.zeros((5, 5)), np.zeros((5, 1))
    rate[0, 1], rate[2, 1], rate[3, 4] = 1.0, -r, 1.0
    rate[1, 3], rate[1, 0] = by_beta[0], -by_beta[0]
    rate[4, 3], rate[4, 0] = by_beta.sum(), -by_beta.sum()
    control[1, 0], control[4, 0] = by_u[0], by_u.sum()
    return rate, control


def entry(states, k):
    """The state at one time of a run."""
    return jax.tree.map(lambda leaf: leaf[k], states)
