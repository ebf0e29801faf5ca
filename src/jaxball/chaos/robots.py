"""Builders of two bodies whose chaotic rolling has been studied: examples for users, which nothing else here uses."""

import math

import jax.numpy as jnp

from ..numerics.arrays import Numbers, to_array
from ..physics.body import Ball
from ..physics.dynamics.parameters import PointMass
from ..physics.prescribed.motion import OnRail
from ..physics.prescribed.rails import Circle
from ..physics.prescribed.schedules import ConstantRate


def rolling_robot(
    orbit: Numbers = 0.6, *, rate: Numbers = 1.5, mass: Numbers = 1.0, inertia: Numbers = 2 / 3, gravity: Numbers = 1.0
) -> Ball:
    """Builds the rolling robot of Ilin, Moffatt & Vladimirov (2017, PNAS 114, 12858): a point mass driven around in a
    shell.

    The shell has mass 1 and radius 1. The mass moves on the circle of radius ``orbit`` about the centre, in the plane
    of E1 and E3, at the constant ``rate``, and starts at −E3. These four numbers and the choice of the unit of time are
    the paper's four dimensionless parameters.

    **Arguments:**

    - ``orbit``: the radius of the orbit, in radii of the shell.
    - ``rate``: θ̇, in rad per time.
    - ``mass``: of the point mass, in masses of the shell.
    - ``inertia``: d1 = d2 = d3 of the shell; 2/3 for a thin shell.
    - ``gravity``: g; with 1, times are in √(r/g).

    **Example:**

    >>> from jaxball.chaos import rolling_robot
    >>> robot = rolling_robot(orbit=0.5)
    >>> robot.point_masses[0].motion.rail
    Circle(radius=0.5, centre=(0.0, 0.0, 0.0), frame=MatrixFrame())
    """
    moment = to_array(inertia)
    circle = OnRail(Circle(radius=orbit), ConstantRate(-math.pi / 2, rate))
    return Ball(mass=1.0, inertia=jnp.stack([moment] * 3), gravity=gravity, masses=[PointMass(mass, circle)])


def chaplygin_top(
    offset: Numbers = (0.2, 0.3, 0.4), *, inertia: Numbers = (0.2, 0.6, 0.7), gravity: Numbers = 1.0
) -> Ball:
    """Builds Chaplygin's top: a ball with unequal moments whose centre of mass is off the centre and off all axes.

    It has mass 1 and radius 1. Energy is its only integral, and much of its motion is chaotic (Borisov, Kazakov &
    Sataev 2014, Regular and Chaotic Dynamics 19, 718).

    **Arguments:**

    - ``offset``: from the geometric centre to the centre of mass, in radii.
    - ``inertia``: d1, d2, d3 about the centre of mass.
    - ``gravity``: g; with 1, times are in √(r/g).

    **Example:**

    >>> from jaxball.chaos import chaplygin_top
    >>> chaplygin_top()
    Ball(mass=1.0, inertia=(0.2, 0.6, 0.7), radius=1.0, offset=(0.2, 0.3, 0.4), gravity=1.0)
    """
    return Ball(mass=1.0, inertia=inertia, offset=offset, gravity=gravity)
