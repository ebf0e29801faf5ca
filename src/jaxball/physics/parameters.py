"""The parameters of a rolling body: a shell, gravity, a force, and the point masses that it carries.

The equations of motion (``moments``, ``dynamics``, ``locked``) are functions of these; ``body`` has the systems.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..interface.arguments import require, require_each, require_function
from ..interface.printing import Printed, entry, shown, shown_fields
from ..numerics.arrays import Numbers, a_number, is_traced, numbers
from .feedback import AbstractLaw
from .force import AbstractForce, FunctionForce, HarmonicForce
from .motion import AbstractMotion, Driven
from .rails import AbstractRail
from .schedules import AbstractSchedule

MOST_PRINTED = 12


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


class BodyParameters(Printed):
    """The parameters that a ball and a disk share; :class:`~jaxball.Ball` says what each is.

    Masses whose motions have the same structure are stacked into one group with a leading axis, so
    that the cost of compiling does not grow with their number. ``point_masses`` undoes it; ``order``
    holds the indices of each group's masses, and ``driven`` those whose θ and θ̇ belong to the state.

    ``inertia_shape`` is (3,) for three principal moments, () for the one of a ``planar`` body, which lies in the plane
    of E1 and E3.
    """

    inertia_shape: ClassVar[tuple[int, ...]] = (3,)
    planar: ClassVar[bool] = False

    mass: Float[Array, "*group"]
    inertia: Float[Array, "..."]
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
        self.mass, self.radius, self.gravity = (
            numbers(name)(x) for name, x in (("mass", mass), ("radius", radius), ("gravity", gravity))
        )
        self.inertia = numbers("inertia", self.inertia_shape)(inertia)
        self.offset = numbers("offset", (3,))(offset)
        self.force, self.law = force, law
        self.groups, self.order, self.driven = _grouped(masses)
        _require_force(force)
        _require_law(law, self.driven)

    def __repr__(self) -> str:
        own = [field for field in dataclasses.fields(self) if field.name not in ("groups", "order", "driven")]
        lines: dict[int, str] = {}
        for group, indices in zip(vars(self).get("groups", ()), vars(self).get("order", ()), strict=True):
            axis = max(np.ndim(group.mass) - 1, 0)  # the axes before it are those of a batch
            for k, index in enumerate(indices):
                item = jax.tree.map(lambda leaf, k=k, axis=axis: entry(leaf, axis, k), group)
                lines[index] = f"  masses[{index}]: {shown(item)}"
        masses = [lines[index] for index in sorted(lines)]
        if len(masses) > MOST_PRINTED:
            masses = [*masses[:MOST_PRINTED], f"  and {len(masses) - MOST_PRINTED} masses more"]
        return "\n".join([shown_fields(self, own), *masses])

    @property
    def point_masses(self) -> tuple[PointMass, ...]:
        """The masses one by one, in the order in which they were given."""
        masses: dict[int, PointMass] = {}
        for group, indices in zip(self.groups, self.order, strict=True):
            for k, index in enumerate(indices):
                masses[index] = jax.tree.map(lambda leaf, k=k: _entry(leaf, k), group)
        return tuple(masses[i] for i in range(self.n_masses))

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments that make this body, by name."""
        names = ("mass", "inertia", "radius", "offset", "gravity", "force", "law")
        return {name: getattr(self, name) for name in names} | {"masses": self.point_masses}

    @property
    def n_masses(self) -> int:
        """The number n of point masses."""
        return sum(len(indices) for indices in self.order)

    @property
    def total_mass(self) -> Float[Array, ""]:
        """M = Σ m_i, the shell included."""
        return self.mass + sum(jnp.sum(group.mass) for group in self.groups)


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
        jax.tree.map(lambda *leaves: _stacked(leaves), *(masses[index] for index in indices)) for indices in order
    )
    driven = tuple(index for index, item in enumerate(masses) if isinstance(item.motion, Driven))
    return groups, order, driven


def _stacked(leaves: Sequence[Any]) -> Array:
    """Known numbers are stacked by NumPy, for which nothing is compiled."""
    if any(map(is_traced, leaves)):
        return jnp.stack(leaves)
    stacked = np.stack([np.asarray(leaf) for leaf in leaves])
    return jnp.asarray(stacked, dtype=stacked.dtype)  # with a type, because without one JAX compiles a copy


def _entry(leaf: Any, index: int) -> Any:
    """An entry along the first axis, taken by NumPy where it is known, for which nothing is compiled."""
    known = isinstance(leaf, jax.Array) and not is_traced(leaf)
    return jnp.asarray(np.asarray(np.asarray(leaf)[index]), dtype=leaf.dtype) if known else leaf[index]


def _require_force(force: AbstractForce | None) -> None:
    if force is None:
        return
    given = isinstance(force, list | tuple | jax.Array | np.ndarray)
    require("force", force, AbstractForce, "a force or None", "HarmonicForce(constant) is one" if given else "")
    if not isinstance(force, HarmonicForce | FunctionForce):  # which have been checked when they were made
        require_function("force", force, (3,), t=a_number())


def _require_law(law: AbstractLaw | None, driven: tuple[int, ...]) -> None:
    if law is None:
        if driven:
            raise ValueError(
                f"Argument `law` must be a feedback law, because the masses {list(driven)} are driven by "
                "one, but it is None; give a law, or put those masses on a rail with a schedule."
            )
        return
    remedy = "FunctionLaw(function) is one" if callable(law) else ""
    require("law", law, AbstractLaw, "a feedback law or None", remedy)
    if not driven:
        raise ValueError("Argument `law` must be None, because no mass is driven by it; use `Driven(rail)`.")
    law.require_driven(len(driven))
