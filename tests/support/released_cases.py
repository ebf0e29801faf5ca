"""Random unbalanced balls and disks, set down or thrown on a plane so that they slide, roll and bounce."""

from math import cos, radians, sin

import numpy as np
from scipy.spatial.transform import Rotation

from tests.support.time_stepping import Circle, Driven, Fixed, Free, State, System, Uniform

STARTS = ("slips", "falls", "spins back")
STEEPEST = radians(20)


def random_case(rng, planar=False, free=False):
    """A system, its state at t = 0 and a duration, with lengths and times of about 1.

    One to three masses are fixed or run around circles; with ``free`` one more is a pendulum with a spring. Half of the
    planes are tilted. The ball slips, falls, or slips and spins against its motion; ``planar`` makes it a disk.
    """
    shell = rng.uniform(1.0, 2.0)
    masses: list[Fixed | Driven | Free] = [_mass(rng, planar) for _ in range(rng.integers(1, 4))]
    if free:
        curve = _circle(rng, planar)
        masses.append(
            Free(rng.uniform(0.1, 0.3), curve, stiffness=rng.uniform(0.0, 0.2), damping=rng.uniform(0.0, 0.05))
        )
    tilt, heading = rng.choice([0.0, 1.0]) * rng.uniform(0.0, STEEPEST), rng.uniform(-np.pi, np.pi)
    if planar:
        heading = 0.0
    system = System(
        mass=shell,
        inertia=shell * rng.uniform(0.4, 0.6, size=3),
        radius=1.0,
        offset=_flat(0.1 * rng.normal(size=3), planar),
        mu=rng.uniform(0.05, 0.8),
        restitution=float(rng.choice([0.0, 0.3, 0.7])),
        masses=tuple(masses),
        g_space=np.array([sin(tilt) * cos(heading), sin(tilt) * sin(heading), -cos(tilt)]),
        planar=planar,
    )
    return system, _state(rng, planar, free), rng.uniform(1.5, 3.0)


def _flat(v, planar):
    """The vector, or what a disk leaves of it."""
    return v * [1, 0, 1] if planar else v


def _circle(rng, planar):
    """A circle that lies within the shell."""
    plane = np.eye(3)[[0, 2, 1]] if planar else Rotation.random(rng=rng).as_matrix()
    radius = rng.uniform(0.2, 0.6)
    return Circle(_flat(0.15 * rng.normal(size=3), planar), radius * plane[0], radius * plane[1])


def _mass(rng, planar):
    mass = rng.uniform(0.2, 0.6)
    curve, phase = _circle(rng, planar), rng.uniform(-np.pi, np.pi)
    if rng.random() < 0.3:
        return Fixed(mass, curve.at(phase)[0])
    return Driven(mass, Uniform(curve, phase, rng.uniform(-6.0, 6.0)))


def _state(rng, planar, free):
    start = rng.choice(STARTS)
    V, omega, height = rng.normal(size=3) * [1, 1, 0], 0.7 * rng.normal(size=3), 0.0
    if start == "falls":
        height, V[2] = rng.uniform(0.02, 0.3), rng.uniform(-0.3, 0.3)
    if start == "spins back":
        omega = omega + rng.uniform(1.0, 2.5) * np.array([V[1], -V[0], 0.0])
    if planar:
        V, omega = V * [1, 0, 1], omega * [0, 1, 0]
        turn = Rotation.from_rotvec([0.0, rng.uniform(-np.pi, np.pi), 0.0])
    else:
        turn = Rotation.random(rng=rng)
    theta = rng.normal(size=int(free))
    return State(turn.as_matrix(), omega, V, np.zeros(2), height, theta, rng.normal(size=int(free)))
