"""Random systems: few structures, so that little is compiled, with numbers stacked for ``jax.vmap``."""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.physics.dynamics.moments import kinematics, point_mass_values


def spiral(theta, shape):
    """A rail that is not closed."""
    radius, pitch = shape
    return jnp.stack([radius * jnp.cos(theta), radius * jnp.sin(theta), pitch * theta])


def swing(t, shape):
    """A schedule: a swing that grows from rest."""
    amplitude, rate = shape
    return amplitude * jnp.tanh(rate * t) * jnp.sin(t)


def loop(t, shape):
    """A free motion on an ellipsoid's surface."""
    a, b, c = shape
    azimuth, elevation = 0.7 * t, 0.4 * jnp.sin(1.3 * t)
    return jnp.stack(
        [
            a * jnp.cos(elevation) * jnp.cos(azimuth),
            b * jnp.cos(elevation) * jnp.sin(azimuth),
            c * jnp.sin(elevation),
        ]
    )


def spring(t, state, gains):
    """A feedback law that knows the angles, their rates, the ball's spin and the time."""
    stiffness, damping, coupling = gains
    return -stiffness * jnp.sin(state.theta) - damping * state.thetadot + coupling * state.Omega[0] * jnp.cos(t)


def rails(rng: np.random.Generator) -> list[jaxball.AbstractRail]:
    """One rail of every family, with random numbers."""
    frames = [
        jaxball.SphericalFrame(*rng.uniform(-1.5, 1.5, 2)),
        jaxball.physics.VersorFrame(rng.normal(size=4)),
        jaxball.SphericalFrame(*rng.uniform(-1.5, 1.5, 2)),
        jaxball.physics.VersorFrame(rng.normal(size=4)),
    ]
    centres = rng.uniform(-0.1, 0.1, (6, 3))
    return [
        jaxball.Circle(rng.uniform(0.3, 0.9), centres[0], frames[0]),
        jaxball.Ellipse(rng.uniform(0.3, 0.9, 2), centres[1], frames[1]),
        jaxball.physics.GeronoEight(rng.uniform(0.3, 0.9, 2), centres[2], frames[2]),
        jaxball.physics.BernoulliEight(rng.uniform(0.3, 0.9), centres[3], frames[3]),
        jaxball.Tube(rng.normal(size=3), centres[4]),
        jaxball.FourierRail(0.3 * rng.normal(size=(2, 3)), 0.3 * rng.normal(size=(2, 3)), centres[5]),
        jaxball.SplineRail(rng.uniform(-0.6, 0.6, (5, 3))),
        jaxball.FunctionRail(spiral, jnp.asarray(rng.uniform(0.1, 0.5, 2))),
    ]


def schedules(rng: np.random.Generator) -> list[jaxball.AbstractSchedule]:
    """One schedule of every family, and two more, with random numbers."""
    theta = rng.uniform(-3, 3, 8)
    return [
        jaxball.Pulse(theta[0], height=rng.normal(), rate=rng.normal(), hold=0.4, end=0.9),
        jaxball.ConstantRate(theta[1], rng.normal()),
        jaxball.Sinusoids(theta[2], rng.normal(size=2), rng.uniform(0.5, 2, 2), rng.normal(size=2), rng.normal()),
        jaxball.PiecewiseAcceleration(theta[3], np.array([0.0, 0.3, 1.1]), rng.normal(size=(2, 3)), rng.normal()),
        jaxball.Waypoints(np.array([0.0, 0.5, 1.2, 2.0]), 0.3 * rng.normal(size=4), 0.3 * rng.normal(size=2)),
        jaxball.FunctionSchedule(swing, jnp.asarray(rng.uniform(0.5, 1.5, 2)), theta[5]),
        jaxball.ConstantRate(theta[6], rng.normal()),
        jaxball.ConstantRate(theta[7], rng.normal()),
    ]


def shell(rng: np.random.Generator) -> dict:
    """Random parameters of a shell, with a force."""
    force = jaxball.physics.HarmonicForce(
        0.3 * rng.normal(size=3), 0.3 * rng.normal(size=(2, 3)), rng.uniform(0.5, 3, 2), rng.normal(size=2)
    )
    return {
        "mass": rng.uniform(0.5, 2),
        "inertia": rng.uniform(0.5, 1, 3),
        "radius": rng.uniform(1, 2),
        "offset": rng.uniform(-0.2, 0.2, 3),
        "gravity": rng.uniform(0.5, 10),
        "force": force,
    }


# A circle with a pulse, a figure eight with sinusoids, a Fourier rail with a function.
FEW = (0, 2, 5)


def every_motion(rng: np.random.Generator) -> jaxball.Ball:
    """A ball under a force: a mass on a rail of every family, a free one of each kind and a fixed one."""
    return scheduled_ball(rng, range(8))


def scheduled_ball(rng: np.random.Generator, families: Sequence[int] = FEW) -> jaxball.Ball:
    """A ball under a force: masses on rails of some families, a free one of each kind and a fixed one."""
    pairs = list(zip(rails(rng), schedules(rng), strict=True))
    motions = [jaxball.OnRail(*pairs[family]) for family in families]
    path = jaxball.HarmonicSeries(
        0.1 * rng.normal(size=3), 0.2 * rng.normal(size=(2, 3)), rng.uniform(0.5, 3, 2), rng.normal(size=2)
    )
    motions += [
        jaxball.Oscillating(path),
        jaxball.Free(loop, jnp.asarray(rng.uniform(0.2, 0.8, 3))),
        jaxball.Fixed(rng.uniform(-0.5, 0.5, 3)),
    ]
    return jaxball.Ball(**shell(rng), masses=[jaxball.PointMass(rng.uniform(0.1, 1), motion) for motion in motions])


def driven_ball(rng: np.random.Generator) -> jaxball.Ball:
    """A ball under a force whose three masses follow a feedback law."""
    chosen = rails(rng)
    motions = [jaxball.Driven(chosen[0]), jaxball.Driven(chosen[3]), jaxball.Driven(chosen[5])]
    law = jaxball.FunctionLaw(spring, jnp.asarray(rng.uniform(0.1, 1, 3)))
    masses = [jaxball.PointMass(rng.uniform(0.1, 1), motion) for motion in motions]
    return jaxball.Ball(**shell(rng), masses=masses, law=law)


def static_ball(rng: np.random.Generator) -> jaxball.Ball:
    """A ball under a force whose one mass is fixed in it."""
    mass = jaxball.PointMass(rng.uniform(0.1, 1), jaxball.Fixed(rng.uniform(-0.5, 0.5, 3)))
    return jaxball.Ball(**shell(rng), masses=[mass])


def moving_disk(rng: np.random.Generator) -> jaxball.Disk:
    """A disk under a force in its plane, with masses on two families of planar rails."""
    in_plane = np.array([1.0, 0.0, 1.0])
    parameters = shell(rng)
    series = parameters["force"].series
    parameters["force"] = jaxball.physics.HarmonicForce(
        series.constant * in_plane, series.amplitude * in_plane[None], series.frequency, series.phase
    )
    parameters["inertia"] = parameters["inertia"][1]
    parameters["offset"] = parameters["offset"] * in_plane
    centres = rng.uniform(-0.2, 0.2, (3, 3)) * in_plane
    chosen = [
        jaxball.Circle(rng.uniform(0.3, 0.9), centres[0]),
        jaxball.Ellipse(rng.uniform(0.3, 0.9, 2), centres[1]),
        jaxball.Tube(rng.normal(size=3) * in_plane, centres[2]),
    ]
    motions = [jaxball.OnRail(rail, schedule) for rail, schedule in zip(chosen, schedules(rng), strict=False)]
    return jaxball.Disk(**parameters, masses=[jaxball.PointMass(rng.uniform(0.1, 1), motion) for motion in motions])


def ball_state(rng: np.random.Generator, driven: int = 0) -> jaxball.BallState:
    """A random state of a ball with ``driven`` driven masses."""
    q = rng.normal(size=4)
    return jaxball.BallState(
        q / np.linalg.norm(q),
        rng.normal(size=3),
        rng.normal(size=2),
        rng.uniform(-3, 3, driven),
        rng.normal(size=driven),
    )


def disk_state(rng: np.random.Generator) -> jaxball.DiskState:
    """A random state of a disk whose masses are scheduled."""
    return jaxball.DiskState(*rng.normal(size=3))


def stacked(make: Callable[[np.random.Generator], object], count: int, seed: int):
    """``count`` random objects of one structure, with a leading axis."""
    rng = np.random.default_rng(seed)
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *(make(rng) for _ in range(count)))


def all_masses(system, t, angles):
    """m, χ, χ̇ and χ̈ of the shell (first) and the point masses, as the paper's sums over i = 0 … n run."""
    points = kinematics(system, t, angles)
    still = jnp.zeros((1, 3))
    m = jnp.concatenate([system.mass[None], point_mass_values(system)])
    chi = jnp.concatenate([system.offset[None], points.chi])
    return m, chi, jnp.concatenate([still, points.chidot]), jnp.concatenate([still, points.chiddot])


BALLS = {
    "every motion": (every_motion, lambda rng: ball_state(rng)),
    "scheduled": (scheduled_ball, lambda rng: ball_state(rng)),
    "driven": (driven_ball, lambda rng: ball_state(rng, driven=3)),
    "static": (static_ball, lambda rng: ball_state(rng)),
}
KINDS = [pytest.param(kind, marks=pytest.mark.slow) if kind == "every motion" else kind for kind in sorted(BALLS)]
COUNT = 20


def random_cases(kind: str, seed: int = 7):
    """``COUNT`` stacked balls of one kind, times between and after the kinks, and states."""
    make_ball, make_state = BALLS[kind]
    times = jnp.asarray(np.random.default_rng(seed).uniform(0.01, 2.0, COUNT))
    return stacked(make_ball, COUNT, seed + 1), times, stacked(make_state, COUNT, seed + 2)


def random_disks(seed: int = 7):
    """``COUNT`` stacked disks, times and states."""
    times = jnp.asarray(np.random.default_rng(seed).uniform(0.01, 2.0, COUNT))
    return stacked(moving_disk, COUNT, seed + 1), times, stacked(disk_state, COUNT, seed + 2)
