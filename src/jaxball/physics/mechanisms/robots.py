"""Mechanisms of rolling robots: pendulums, rotors, masses in tubes and on rails, and rigid bodies as point masses."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...interface.arguments import refusal, require_count
from ...interface.compat import is_traced
from ...numerics.arrays import Numbers, numbers
from ...numerics.vectors import cross, root
from ..conditions import real_inertia
from ..prescribed.frames import AbstractFrame, MatrixFrame
from ..prescribed.rails import AbstractRail
from .joints import Carriage, Drive, Hinge, Slider
from .mechanism import CarriedMass, Mechanism

CENTRE = (0.0, 0.0, 0.0)
DOWN = (0.0, 0.0, -1.0)
ROLLING = (0.0, 1.0, 0.0)  # the axis of rotation of a body that rolls along e1 from its default state
ROLLING_FIRST = (ROLLING, (1.0, 0.0, 0.0))
FEWEST_ON_RING = 3


def planar_pendulum(
    mass: Numbers,
    length: Numbers,
    *,
    axis: Numbers = ROLLING,
    direction: Numbers = DOWN,
    pivot: Numbers = CENTRE,
    drive: Drive = None,
) -> Mechanism:
    """Builds a planar pendulum: a mass on a massless rod, which turns about a hinge.

    **Arguments:**

    - ``mass``: in units of mass.
    - ``length``: from the pivot to the mass.
    - ``axis``: of the hinge, body axes, of any nonzero length, shape (3,).
    - ``direction``: from the pivot to the mass where θ is 0, body axes, of any nonzero length, shape (3,).
    - ``pivot``: from the geometric centre, body axes, length, shape (3,).
    - ``drive``: of the hinge, as for a :class:`~jaxball.Hinge`.

    **Example:**

    >>> from jaxball import Motor, planar_pendulum
    >>> planar_pendulum(0.5, 0.6, drive=Motor(0.1)).place
    Array([[ 0. ,  0. , -0.6]], dtype=float64)
    """
    pivot, direction = _vector("pivot", pivot), _unit("direction", direction)
    return Mechanism([Hinge(axis, pivot, drive)], [CarriedMass(mass, pivot + _number("length", length) * direction)])


def spherical_pendulum(
    mass: Numbers,
    length: Numbers,
    *,
    axes: Numbers = ROLLING_FIRST,
    direction: Numbers = DOWN,
    pivot: Numbers = CENTRE,
    drives: Sequence[Drive] = (None, None),
) -> Mechanism:
    """Builds a pendulum in a yoke: a mass on a massless rod, which two hinges at one pivot let swing in every
    direction.

    A hanging pendulum turns relative to the body by as much as the body rolls. So the axis of its first hinge should be
    the one about which the body rolls: the first hinge may turn without limit, while at θ = ±π/2 of the second the mass
    is on the axis of the first, whose θ̈ is then not determined.

    **Arguments:**

    - ``mass``: in units of mass.
    - ``length``: from the pivot to the mass.
    - ``axes``: of both hinges where both θ are 0, body axes, each of any nonzero length, shape (2, 3).
    - ``direction``: from the pivot to the mass where both θ are 0, body axes, of any nonzero length, shape (3,).
    - ``pivot``: from the geometric centre, body axes, length, shape (3,).
    - ``drives``: of both hinges, as for a :class:`~jaxball.Hinge`.

    **Raises:** ``ValueError`` unless there are two ``drives``.

    **Example:**

    >>> from jaxball import Ball, spherical_pendulum
    >>> Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), mechanisms=[spherical_pendulum(0.5, 0.6)]).coordinates
    ('mechanisms[0].joints[0]', 'mechanisms[0].joints[1]')
    """
    pivot, direction = _vector("pivot", pivot), _unit("direction", direction)
    mass_at_end = CarriedMass(mass, pivot + _number("length", length) * direction)
    return Mechanism(_yoke(axes, pivot, _of_each(drives, 2)), [mass_at_end])


def double_pendulum(
    masses: Numbers,
    lengths: Numbers,
    *,
    axis: Numbers = ROLLING,
    direction: Numbers = DOWN,
    pivot: Numbers = CENTRE,
    drives: Sequence[Drive] = (None, None),
) -> Mechanism:
    """Builds two masses on two massless rods, the second hinged to the first mass, with parallel hinges.

    **Arguments:**

    - ``masses``: the inner and the outer one, in units of mass, shape (2,).
    - ``lengths``: of the inner and of the outer rod, shape (2,).
    - ``axis``: of both hinges, body axes, of any nonzero length, shape (3,). The second θ is relative to the first rod.
    - ``direction``: of both rods where both θ are 0, body axes, of any nonzero length, shape (3,).
    - ``pivot``: of the first hinge, from the geometric centre, body axes, length, shape (3,).
    - ``drives``: of both hinges, as for a :class:`~jaxball.Hinge`.

    **Raises:** ``ValueError`` unless there are two ``drives``.

    **Example:**

    >>> from jaxball.physics import double_pendulum
    >>> print(double_pendulum((0.5, 0.2), (0.4, 0.3)).place)
    [[ 0.   0.  -0.4]
     [ 0.   0.  -0.7]]
    """
    m, l = numbers("masses", (2,))(masses), numbers("lengths", (2,))(lengths)
    pivot, direction = _vector("pivot", pivot), _unit("direction", direction)
    inner = pivot + l[0] * direction
    first, second = _of_each(drives, 2)
    return Mechanism(
        [Hinge(axis, pivot, first), Hinge(axis, inner, second)],
        [CarriedMass(m[0], inner, 0), CarriedMass(m[1], inner + l[1] * direction, 1)],
    )


def ring_rotor(
    mass: Numbers,
    radius: Numbers,
    *,
    axis: Numbers = (0.0, 0.0, 1.0),
    centre: Numbers = CENTRE,
    drive: Drive = None,
    count: int = FEWEST_ON_RING,
) -> Mechanism:
    """Builds a ring that spins about its own axis: a rotor, a reaction wheel.

    Any ``count`` of equal masses spaced evenly around a circle moves as the ring does, whose moments of inertia about
    its centre are mass radius² about the axis and half of that about a diameter.

    **Arguments:**

    - ``mass``: of the whole ring, in units of mass.
    - ``radius``: of the ring, length.
    - ``axis``: of the hinge and the ring, body axes, of any nonzero length, shape (3,).
    - ``centre``: of the ring, from the geometric centre, body axes, length, shape (3,).
    - ``drive``: of the hinge, as for a :class:`~jaxball.Hinge`.
    - ``count``: of the masses, 3 or more.

    **Raises:** ``ValueError`` for a ``count`` below 3.

    **Source:** three rotors in a ball roll it anywhere: Borisov, Kilin and Mamaev, *How to control Chaplygin's sphere
    using rotors*, Regular and Chaotic Dynamics 17 (2012), 258.

    **Example:**

    >>> from jaxball import Ball, Motor, ring_rotor
    >>> rotors = [ring_rotor(0.2, 0.5, axis=axis, drive=Motor(0.1)) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
    >>> len(Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), mechanisms=rotors).coordinates)
    3
    """
    axis, centre = _unit("axis", axis), _vector("centre", centre)
    return Mechanism([Hinge(axis, centre, drive)], _ring(mass, radius, axis, centre, count))


def gyroscopic_pendulum(
    mass: Numbers,
    length: Numbers,
    radius: Numbers,
    *,
    axes: Numbers = ROLLING_FIRST,
    direction: Numbers = DOWN,
    pivot: Numbers = CENTRE,
    drives: Sequence[Drive] = (None, None, None),
    count: int = FEWEST_ON_RING,
) -> Mechanism:
    """Builds a spherical pendulum whose mass is a ring that spins about the rod: a top hanging in a yoke.

    **Arguments:**

    - ``mass``: of the whole ring, in units of mass.
    - ``length``: from the pivot to the ring's centre.
    - ``radius``: of the ring, length.
    - ``axes``: of both hinges at the pivot where every θ is 0, as for :func:`~jaxball.spherical_pendulum`, shape (2,
      3).
    - ``direction``: from the pivot to the ring where every θ is 0, body axes, of any nonzero length, shape (3,).
    - ``pivot``: from the geometric centre, body axes, length, shape (3,).
    - ``drives``: of both hinges and of the ring, as for a :class:`~jaxball.Hinge`.
    - ``count``: of the masses on the ring, 3 or more.

    **Raises:** ``ValueError`` unless there are three ``drives``, and for a ``count`` below 3.

    **Source:** Kilin, Pivovarova and Ivanova, *Spherical robot of combined type: dynamics and control*, Regular and
    Chaotic Dynamics 20 (2015), 716.

    **Example:**

    >>> from jaxball import Motor
    >>> from jaxball.physics import gyroscopic_pendulum
    >>> robot = gyroscopic_pendulum(0.5, 0.4, 0.3, drives=(None, None, Motor(0.02)))
    >>> robot.n_joints, robot.mass.shape
    (3, (3,))
    """
    pivot, direction = _vector("pivot", pivot), _unit("direction", direction)
    *of_yoke, of_ring = _of_each(drives, 3)
    centre = pivot + _number("length", length) * direction
    joints = [*_yoke(axes, pivot, of_yoke), Hinge(direction, centre, of_ring)]
    return Mechanism(joints, _ring(mass, radius, direction, centre, count))


def mass_in_tube(mass: Numbers, axis: Numbers, *, centre: Numbers = CENTRE, drive: Drive = None) -> Mechanism:
    """Builds a mass that slides along a straight tube: a magnet moved by coils, or a weight on a spoke.

    The tube has no ends of its own: use :class:`~jaxball.EndStops`, or a :class:`~jaxball.Spring` that holds the mass.

    **Arguments:**

    - ``mass``: in units of mass.
    - ``axis``: of the tube, body axes, of any nonzero length, shape (3,).
    - ``centre``: the position of the mass at θ = 0, from the geometric centre, body axes, length, shape (3,).
    - ``drive``: along the tube, as for a :class:`~jaxball.Slider`.

    **Source:** weights on spokes: Mojabi, *Introducing August: a novel strategy for an omnidirectional spherical
    rolling robot*, ICRA 2002.

    **Example:**

    >>> from jaxball import Spring
    >>> from jaxball.physics import mass_in_tube
    >>> tubes = [mass_in_tube(0.1, axis, drive=Spring(2.0)) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
    >>> tubes[2].joints[0].axis
    Array([0., 0., 1.], dtype=float64)
    """
    return Mechanism([Slider(axis, drive)], [CarriedMass(mass, centre)])


def turning_rail(
    mass: Numbers,
    rail: AbstractRail,
    *,
    axis: Numbers = (0.0, 0.0, 1.0),
    pivot: Numbers = CENTRE,
    drives: Sequence[Drive] = (None, None),
) -> Mechanism:
    """Builds a mass on a rail that itself turns about an axis; the rail has no mass.

    **Arguments:**

    - ``mass``: in units of mass.
    - ``rail``: such as a :class:`~jaxball.Circle`, placed for the configuration where the first θ is 0.
    - ``axis``: about which the rail turns, body axes, of any nonzero length, shape (3,).
    - ``pivot``: a point on this axis, from the geometric centre, body axes, length, shape (3,).
    - ``drives``: of the rail, as for a :class:`~jaxball.Hinge`, and of the mass, as for a :class:`~jaxball.Carriage`.
      Where the mass passes through the axis, the θ̈ of a free rail is not determined.

    **Raises:** ``ValueError`` unless there are two ``drives``.

    **Example:**

    >>> from jaxball import Circle, ConstantRate
    >>> from jaxball.physics import turning_rail
    >>> robot = turning_rail(0.5, Circle(0.6), drives=(ConstantRate(0.0, rate=1.0), None))
    >>> robot.free  # the schedule moves the rail, and the mass moves freely
    (1,)
    """
    of_rail, of_mass = _of_each(drives, 2)
    return Mechanism([Hinge(axis, pivot, of_rail), Carriage(rail, of_mass)], [CarriedMass(mass)])


def rigid_body_masses(
    mass: Numbers,
    inertia: Numbers,
    *,
    centre: Numbers = CENTRE,
    frame: AbstractFrame | None = None,
    joint: int = -1,
) -> list[CarriedMass]:
    """Builds a rigid body as six point masses on its principal axes, which move as the body does.

    They are mass/6 each, at ±a_k from the centre along the k-th axis, a_k² = 3 (½ Σ d − d_k) / mass.

    **Arguments:**

    - ``mass``: of the body, in units of mass.
    - ``inertia``: its principal moments (d1, d2, d3) about its own centre of mass, mass length², shape (3,).
    - ``centre``: its centre of mass where every θ is 0, from the geometric centre, body axes, length, shape (3,).
    - ``frame``: a :class:`~jaxball.MatrixFrame` or another, whose columns are its principal axes in the body where
      every θ is 0; by default the body axes.
    - ``joint``: the index of the joint that carries it; by default the last one.

    **Raises:** ``ValueError`` for impossible moments, one of which exceeds the sum of the other two. Where they are
    traced, the positions are NaN instead.

    **Example:**

    >>> from jaxball import Hinge, Mechanism, rigid_body_masses
    >>> bar = rigid_body_masses(0.6, (0.02, 0.02, 0.0), centre=(0.0, 0.0, -0.5))
    >>> pendulum = Mechanism([Hinge((0.0, 1.0, 0.0))], bar)
    >>> print(pendulum.place[-2:].round(3))
    [[ 0.     0.    -0.184]
     [ 0.     0.    -0.816]]
    """
    m, d = _number("mass", mass), numbers("inertia", (3,))(inertia)
    centre = _vector("centre", centre)
    real = real_inertia(d)
    if not is_traced(d):
        for problem in real.problems():
            raise ValueError(problem.sentence())
    distances = jnp.where(real.holds, root(3 * (jnp.sum(d) / 2 - d) / m), jnp.nan)
    axes = (MatrixFrame() if frame is None else frame).matrix().T
    return [
        CarriedMass(m / 6, centre + sign * distance * axis, joint)
        for distance, axis in zip(distances, axes, strict=True)
        for sign in (1.0, -1.0)
    ]


def _yoke(axes: Numbers, pivot: Float[Array, "3"], drives: Sequence[Drive]) -> list[Hinge]:
    return [Hinge(axis, pivot, drive) for axis, drive in zip(numbers("axes", (2, 3))(axes), drives, strict=True)]


def _ring(
    mass: Numbers, radius: Numbers, axis: Float[Array, "3"], centre: Float[Array, "3"], count: int
) -> list[CarriedMass]:
    if count < FEWEST_ON_RING:
        raise ValueError(
            f"Argument `count` must be {FEWEST_ON_RING} or more, because fewer masses do not move as a ring does, but "
            f"it is {count}."
        )
    m, R = _number("mass", mass), _number("radius", radius)
    across = _unit("across", cross(axis, jnp.eye(3, dtype=axis.dtype)[jnp.argmin(jnp.abs(axis))]))
    beside = cross(axis, across)
    angles = 2 * np.pi / count * np.arange(count)
    places = [centre + R * (float(np.cos(a)) * across + float(np.sin(a)) * beside) for a in angles]
    return [CarriedMass(m / count, place) for place in places]


def _of_each(drives: Sequence[Drive], count: int) -> Sequence[Drive]:
    if not isinstance(drives, list | tuple):
        raise refusal("drives", f"a list of {count}, one for each joint", drives)
    require_count("Argument `drives`", len(drives), count, "joint")
    return drives


def _number(name: str, value: Numbers) -> Float[Array, ""]:
    return numbers(name)(value)


def _vector(name: str, value: Numbers) -> Float[Array, "3"]:
    return numbers(name, (3,))(value)


def _unit(name: str, value: Numbers) -> Float[Array, "3"]:
    vector = _vector(name, value)
    return vector / jnp.sqrt(jnp.sum(vector**2))
