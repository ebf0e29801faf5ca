"""Random unbalanced balls, set down or thrown on a plane so that they slide, roll and bounce."""

from math import cos, radians, sin

import numpy as np
from scipy.spatial.transform import Rotation

from tests.support.time_stepping import Circle, Driven, Fixed, State, System, Uniform

STARTS = ("slips", "falls", "spins back")
STEEPEST = radians(20)


def random_case(rng):
    """A system, its state at t = 0 and a duration, with lengths and times of about 1.

    One to three masses are fixed or run around circles. Half of the planes are tilted. The ball slips, falls, or slips
    and spins against its motion.
    """
    shell = rng.uniform(1.0, 2.0)
    masses = [_mass(rng) for _ in range(rng.integers(1, 4))]
    tilt, heading = rng.choice([0.0, 1.0]) * rng.uniform(0.0, STEEPEST), rng.uniform(-np.pi, np.pi)
    system = System(
        mass=shell,
        inertia=shell * rng.uniform(0.4, 0.6, size=3),
        radius=1.0,
        offset=0.1 * rng.normal(size=3),
        mu=rng.uniform(0.05, 0.8),
        restitution=float(rng.choice([0.0, 0.3, 0.7])),
        masses=tuple(masses),
        g_space=np.array([sin(tilt) * cos(heading), sin(tilt) * sin(heading), -cos(tilt)]),
    )
    return system, _state(rng), rng.uniform(1.5, 3.0)


def _circle(rng):
    """A circle that lies within the shell."""
    plane = Rotation.random(rng=rng).as_matrix()
    radius = rng.uniform(0.2, 0.6)
    return Circle(0.15 * rng.normal(size=3), radius * plane[0], radius * plane[1])


def _mass(rng):
    mass = rng.uniform(0.2, 0.6)
    curve, phase = _circle(rng), rng.uniform(-np.pi, np.pi)
    if rng.random() < 0.3:
        return Fixed(mass, curve.at(phase)[0])
    return Driven(mass, Uniform(curve, phase, rng.uniform(-6.0, 6.0)))


def _state(rng):
    start = rng.choice(STARTS)
    V, omega, height = rng.normal(size=3) * [1, 1, 0], 0.7 * rng.normal(size=3), 0.0
    if start == "falls":
        height, V[2] = rng.uniform(0.02, 0.3), rng.uniform(-0.3, 0.3)
    if start == "spins back":
        omega = omega + rng.uniform(1.0, 2.5) * np.array([V[1], -V[0], 0.0])
    turn = Rotation.random(rng=rng)
    return State(turn.as_matrix(), omega, V, np.zeros(2), height)
