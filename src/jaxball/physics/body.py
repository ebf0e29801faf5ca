"""The rolling bodies: a ball or a disk with point masses inside. Parameters only; see ``state``."""

import dataclasses
from collections.abc import Sequence
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..interface.arguments import require, require_each, require_function
from ..interface.printing import Printed, entry, shown, shown_fields
from ..numerics.arrays import Numbers, a_number, numbers, to_array
from .feedback import AbstractLaw, FollowSchedules
from .force import AbstractForce, FunctionForce, HarmonicForce
from .motion import AbstractMotion, Driven, OnRail
from .rails import AbstractRail
from .schedules import AbstractSchedule

MOST_PRINTED = 12
AnyBody = TypeVar("AnyBody", bound="AbstractBody")


class PointMass(Printed):
    """A point mass m_i and its motion in the ball.

    **Arguments:**

    - ``mass``: m_i, in units of mass.
    - ``motion``: where it is in the ball: an :class:`~jaxball.OnRail`, :class:`~jaxball.Driven`,
      :class:`~jaxball.Fixed`, :class:`~jaxball.Oscillating` or :class:`~jaxball.Free`.

    **Example:**

    >>> from jaxball import Fixed, PointMass
    >>> PointMass(0.5, Fixed((0.0, 0.0, -0.5)))
    PointMass(mass=0.5, motion=Fixed(position=(0.0, 0.0, -0.5)))
    """

    mass: Float[Array, "*group"] = eqx.field(converter=numbers("mass"))
    motion: AbstractMotion

    def __check_init__(self):
        on_rail = isinstance(self.motion, AbstractRail | AbstractSchedule)
        remedy = "OnRail(rail, schedule) is one, and Driven(rail) for a feedback law" if on_rail else ""
        require("motion", self.motion, AbstractMotion, "a motion, such as OnRail(...)", remedy)


class AbstractBody(Printed):
    """What a ball and a disk share: a shell, gravity, a force, and masses.

    Masses whose motions have the same structure are stacked into one group with a leading axis, so
    that the cost of compiling does not grow with their number. ``point_masses`` undoes it; ``order``
    holds the indices of each group's masses, and ``driven`` those whose θ and θ̇ belong to the state.
    """

    mass: eqx.AbstractVar[Float[Array, "*group"]]
    radius: eqx.AbstractVar[Float[Array, "*group"]]
    offset: eqx.AbstractVar[Float[Array, "*group 3"]]
    gravity: eqx.AbstractVar[Float[Array, "*group"]]
    force: eqx.AbstractVar[AbstractForce | None]
    groups: eqx.AbstractVar[tuple[PointMass, ...]]
    order: eqx.AbstractVar[tuple[tuple[int, ...], ...]]
    driven: eqx.AbstractVar[tuple[int, ...]]
    law: eqx.AbstractVar[AbstractLaw | None]

    def __repr__(self) -> str:
        own = [field for field in dataclasses.fields(self) if field.name not in ("groups", "order", "driven")]
        lines: dict[int, str] = {}
        for group, indices in zip(vars(self).get("groups", ()), vars(self).get("order", ()), strict=True):
            axis = max(np.ndim(group.mass) - 1, 0)  # the axes before it are those of a batch
            for k, index in enumerate(indices):
                item = jax.tree.map(lambda leaf, k=k, axis=axis: entry(leaf, axis, k), group)
                lines[index] = f"  masses[{index}]: {shown(item)}"
        found = [lines[index] for index in sorted(lines)]
        if len(found) > MOST_PRINTED:
            found = [*found[:MOST_PRINTED], f"  and {len(found) - MOST_PRINTED} masses more"]
        return "\n".join([shown_fields(self, own), *found])

    @property
    def point_masses(self) -> tuple[PointMass, ...]:
        """The masses one by one, in the order in which they were given."""
        found: dict[int, PointMass] = {}
        for group, indices in zip(self.groups, self.order, strict=True):
            for k, index in enumerate(indices):
                found[index] = jax.tree.map(lambda leaf, k=k: leaf[k], group)
        return tuple(found[i] for i in range(self.n_masses))

    @property
    def n_masses(self) -> int:
        """The number n of point masses."""
        return sum(len(indices) for indices in self.order)

    @property
    def total_mass(self) -> Float[Array, ""]:
        """M = Σ m_i, the shell included."""
        return self.mass + sum(jnp.sum(group.mass) for group in self.groups)

    def prepare(self: AnyBody) -> AnyBody:
        """The same body with splines solved and frames turned to matrices: once a solve, not once a step."""
        groups = tuple(
            eqx.tree_at(lambda g: g.motion, group, eqx.filter_vmap(lambda motion: motion.prepare())(group.motion))
            for group in self.groups
        )
        law = None if self.law is None else self.law.prepare()
        return eqx.tree_at(lambda body: (body.groups, body.law), self, (groups, law), is_leaf=lambda x: x is None)

    def motion_kinks(self) -> Float[Array, " kinks"]:
        """The times, in no order, at which χ̈ of a prescribed motion jumps or bends."""
        found = [
            jnp.ravel(eqx.filter_vmap(lambda motion: motion.kinks())(group.motion))
            for group in self.groups
            if not isinstance(group.motion, Driven)
        ]
        return jnp.concatenate(found) if found else jnp.zeros((0,), dtype=self.mass.dtype)

    def driving_kinks(self) -> Float[Array, " kinks"]:
        """The times, in no order, at which the feedback law or the force jumps or bends."""
        found = [source.kinks() for source in (self.law, self.force) if source is not None]
        return jnp.concatenate(found) if found else jnp.zeros((0,), dtype=self.mass.dtype)


class Ball(AbstractBody):
    """A ball with point masses inside, rolling without slipping on a horizontal plane (section 2).

    **Arguments:**

    - ``mass``: m_0, of the shell with its static internal structure, in units of mass.
    - ``inertia``: the principal moments (d1, d2, d3) about the shell's own centre of mass, mass length², shape (3,).
    - ``radius``: r, length.
    - ``offset``: χ_0 = ζ_0, from the geometric centre to the shell's centre of mass, body axes, length, shape (3,).
    - ``gravity``: g, length/time².
    - ``force``: Fe(t) at the geometric centre, or None.
    - ``masses``: the point masses, in any number.
    - ``law``: the feedback law that drives the :class:`~jaxball.Driven` masses, if there are any.

    Any consistent units will do; the paper rescales so that m = r = g = 1.

    **Raises:** ``ValueError`` when a shape is wrong, or when there are driven masses and no law, or
    a law and no driven mass. Values are not checked here, so that they may be traced; see
    :func:`jaxball.problems`.

    **Example:**

    >>> from jaxball import Ball, Circle, OnRail, PointMass, Pulse
    >>> ball = Ball(mass=1.0, inertia=(0.9, 1.0, 1.1), masses=[PointMass(0.5, OnRail(Circle(0.9), Pulse(0.8)))])
    >>> ball
    Ball(mass=1.0, inertia=(0.9, 1.0, 1.1), radius=1.0, offset=(0.0, 0.0, 0.0), gravity=1.0)
      masses[0]: PointMass(mass=0.5, motion=OnRail(rail=Circle(radius=0.9), schedule=Pulse(theta=0.8)))
    >>> float(ball.total_mass)
    1.5
    """

    mass: Float[Array, "*group"]
    inertia: Float[Array, "*group 3"]
    radius: Float[Array, "*group"]
    offset: Float[Array, "*group 3"]
    gravity: Float[Array, "*group"]
    force: AbstractForce | None
    groups: tuple[PointMass, ...]
    order: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    driven: tuple[int, ...] = eqx.field(static=True)
    law: AbstractLaw | None

    def __init__(
        self,
        *,
        mass: Numbers,
        inertia: Numbers,
        radius: Numbers = 1.0,
        offset: Numbers = (0.0, 0.0, 0.0),
        gravity: Numbers = 1.0,
        force: AbstractForce | None = None,
        masses: Sequence[PointMass] = (),
        law: AbstractLaw | None = None,
    ):
        _fill(self, (3,), mass, inertia, radius, offset, gravity, force, masses, law)


class Disk(AbstractBody):
    """A disk with point masses in its plane, rolling on a line: the ball's planar case (section 3.3).

    **Arguments:**

    - ``inertia``: the one moment d2, about the shell's own centre of mass, mass length².
    - ``offset``: as of a :class:`Ball`, length, shape (3,), in the plane of E1 and E3, as are the rails and the free
      motions of the masses.
    - ``mass``, ``radius``, ``gravity``, ``force``, ``masses``, ``law``: as of a :class:`Ball`.

    **Raises:** as :class:`Ball`.

    **Example:**

    >>> from jaxball import Disk, Fixed, PointMass
    >>> Disk(mass=1.0, inertia=0.5, masses=[PointMass(0.5, Fixed((0.0, 0.0, -0.5)))])
    Disk(mass=1.0, inertia=0.5, radius=1.0, offset=(0.0, 0.0, 0.0), gravity=1.0)
      masses[0]: PointMass(mass=0.5, motion=Fixed(position=(0.0, 0.0, -0.5)))
    """

    mass: Float[Array, "*group"]
    inertia: Float[Array, "*group"]
    radius: Float[Array, "*group"]
    offset: Float[Array, "*group 3"]
    gravity: Float[Array, "*group"]
    force: AbstractForce | None
    groups: tuple[PointMass, ...]
    order: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    driven: tuple[int, ...] = eqx.field(static=True)
    law: AbstractLaw | None

    def __init__(
        self,
        *,
        mass: Numbers,
        inertia: Numbers,
        radius: Numbers = 1.0,
        offset: Numbers = (0.0, 0.0, 0.0),
        gravity: Numbers = 1.0,
        force: AbstractForce | None = None,
        masses: Sequence[PointMass] = (),
        law: AbstractLaw | None = None,
    ):
        _fill(self, (), mass, inertia, radius, offset, gravity, force, masses, law)

    def embedded(self) -> Ball:
        """The disk as a ball of three equal moments that rolls in the plane of e1 and e3."""
        return Ball(
            mass=self.mass,
            inertia=jnp.stack([self.inertia] * 3),
            radius=self.radius,
            offset=self.offset,
            gravity=self.gravity,
            force=self.force,
            masses=self.point_masses,
            law=self.law,
        )


System = Ball | Disk


def with_masses(system: System, masses: Sequence[PointMass], law: AbstractLaw | None = None) -> System:
    """The same shell, gravity and force with other point masses, and the law that drives them.

    **Arguments:**

    - ``system``: a :class:`~jaxball.Ball` or a :class:`~jaxball.Disk`.
    - ``masses``: the point masses, in any number.
    - ``law``: the feedback law of those that are :class:`~jaxball.Driven`, or None.

    **Example:**

    >>> from jaxball import Disk, Fixed, PointMass, with_masses
    >>> empty = Disk(mass=1.0, inertia=0.5)
    >>> with_masses(empty, [PointMass(0.5, Fixed((0.0, 0.0, -0.5)))]).n_masses
    1
    """
    return type(system)(
        mass=system.mass,
        inertia=system.inertia,
        radius=system.radius,
        offset=system.offset,
        gravity=system.gravity,
        force=system.force,
        masses=masses,
        law=law,
    )


def with_integrated_angles(system: System, t0: Numbers = 0.0) -> tuple[System, dict[str, Array]]:
    """The same system in the paper's own form, with θ and θ̇ of the scheduled masses in the state.

    **Arguments:**

    - ``system``: a :class:`~jaxball.Ball` or a :class:`~jaxball.Disk`.
    - ``t0``: the time of the state.

    **Returns:** the system whose :class:`~jaxball.OnRail` masses have become driven ones that
    follow θ̈(t) of their schedules, and the entries ``theta`` and ``thetadot`` of its state at ``t0``.

    **Raises:** ``ValueError`` when the system has a feedback law already.

    **Example:**

    >>> from jaxball import Circle, ConstantRate, Disk, DiskState, OnRail, PointMass, with_integrated_angles
    >>> disk = Disk(mass=1.0, inertia=0.5, masses=[PointMass(0.5, OnRail(Circle(0.9), ConstantRate(0.0, rate=2.0)))])
    >>> driven, angles = with_integrated_angles(disk, t0=1.0)
    >>> DiskState(**angles)
    DiskState(phi=0.0, phidot=0.0, z=0.0, theta=(2.0,), thetadot=(2.0,))
    """
    if system.law is not None:
        raise ValueError("Argument `system` must have prescribed motions only, but it has a feedback law already.")
    masses, schedules = [], []
    for item in system.point_masses:
        if isinstance(item.motion, OnRail):
            schedules.append(item.motion.schedule)
            item = PointMass(item.mass, Driven(item.motion.rail))
        masses.append(item)
    rates = [schedule.derivatives(to_array(t0)) for schedule in schedules]
    angles = {
        "theta": to_array([rate[0] for rate in rates]),
        "thetadot": to_array([rate[1] for rate in rates]),
    }
    law = FollowSchedules(tuple(schedules)) if schedules else None
    return with_masses(system, masses, law), angles


def _fill(body, inertia_shape, mass, inertia, radius, offset, gravity, force, masses, law) -> None:
    """Sets the fields of a ball or a disk in its constructor, and checks what does not depend on values."""
    body.mass, body.radius, body.gravity = (
        numbers(name)(x) for name, x in (("mass", mass), ("radius", radius), ("gravity", gravity))
    )
    body.inertia, body.offset = numbers("inertia", inertia_shape)(inertia), numbers("offset", (3,))(offset)
    body.force, body.law = force, law
    body.groups, body.order, body.driven = _grouped(masses)
    _require_force(force)
    _require_law(body)


def _grouped(
    masses: Sequence[PointMass],
) -> tuple[tuple[PointMass, ...], tuple[tuple[int, ...], ...], tuple[int, ...]]:
    """The masses stacked by structure, the indices of each group's masses, and those of the driven ones."""
    require_each("masses", masses, PointMass, "a PointMass")
    members: dict[Any, list[int]] = {}
    for index, item in enumerate(masses):
        leaves, structure = jax.tree.flatten(item)
        members.setdefault((structure, tuple(np.shape(leaf) for leaf in leaves)), []).append(index)
    order = tuple(tuple(indices) for indices in members.values())
    groups = tuple(
        jax.tree.map(lambda *leaves: jnp.stack(leaves), *(masses[index] for index in indices)) for indices in order
    )
    driven = tuple(index for index, item in enumerate(masses) if isinstance(item.motion, Driven))
    return groups, order, driven


def _require_force(force: AbstractForce | None) -> None:
    if force is None:
        return
    given = isinstance(force, list | tuple | jax.Array | np.ndarray)
    require("force", force, AbstractForce, "a force or None", "HarmonicForce(constant) is one" if given else "")
    if not isinstance(force, HarmonicForce | FunctionForce):  # which have been checked when they were made
        require_function("force", force, (3,), t=a_number())


def _require_law(body: AbstractBody) -> None:
    if body.law is not None:
        remedy = "FunctionLaw(function) is one" if callable(body.law) else ""
        require("law", body.law, AbstractLaw, "a feedback law or None", remedy)
    if body.driven and body.law is None:
        raise ValueError(
            f"Argument `law` must be a feedback law, because the masses {list(body.driven)} are driven by "
            "one, but it is None; give a law, or put those masses on a rail with a schedule."
        )
    if body.law is not None and not body.driven:
        raise ValueError("Argument `law` must be None, because no mass is driven by it; use `Driven(rail)`.")
    if body.law is not None:
        body.law.require_driven(len(body.driven))
