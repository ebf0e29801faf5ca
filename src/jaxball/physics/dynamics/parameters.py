"""The parameters of a rolling body: a shell, what acts on it, and the point masses and mechanisms that it carries.

The equations of motion (``moments``, ``equations``, ``locked``) are functions of these; ``body`` has the systems.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...interface.arguments import require, require_each
from ...interface.compat import is_traced
from ...interface.printing import Printed, entry, format_fields, format_value
from ...interface.wording import all_of
from ...numerics.arrays import Numbers
from ...numerics.declare import FINITE, LENGTH, OF_GRAVITY, OF_INERTIA, OF_MASS, POSITIVE, number
from ..feedback import AbstractLaw
from ..forces.force import AbstractWrench, FunctionForce, HarmonicForce, require_wrench
from ..forces.resistance import AbstractResistance
from ..grounds.ground import AbstractGround
from ..mechanisms import AbstractMechanism
from ..own_states import OwnStates
from ..prescribed.motion import AbstractMotion, Driven, OnRail, rail_of, schedule_of
from ..prescribed.rails import AbstractRail
from ..prescribed.schedules import AbstractSchedule
from ..shape import AbstractShape

MOST_PRINTED = 12


class PointMass(Printed):
    """A point mass m_i and its motion in the ball.

    **Arguments:**

    - ``mass``: m_i, in units of mass.
    - ``motion``: how it moves in the ball: an :class:`~jaxball.OnRail`, :class:`~jaxball.Driven`,
      :class:`~jaxball.Fixed`, :class:`~jaxball.Oscillating` or :class:`~jaxball.Free`.

    **Example:**

    >>> from jaxball import Fixed, PointMass
    >>> PointMass(0.5, Fixed((0.0, 0.0, -0.5)))
    PointMass(mass=0.5, motion=Fixed(position=(0.0, 0.0, -0.5)))
    """

    mass: Float[Array, "*group"] = eqx.field(converter=number(OF_MASS, POSITIVE))
    motion: AbstractMotion

    def __check_init__(self):
        on_rail = isinstance(self.motion, AbstractRail | AbstractSchedule)
        remedy = "OnRail(rail, schedule) is one, and Driven(rail) for a feedback law" if on_rail else ""
        require("motion", self.motion, AbstractMotion, "a motion, such as OnRail(...)", remedy)

    @property
    def schedule(self) -> AbstractSchedule | None:
        """The schedule of θ on its rail; None where a law moves it, and without a rail."""
        return schedule_of(self.motion)

    @property
    def rail(self) -> AbstractRail | None:
        """Its rail; None without one."""
        return rail_of(self.motion)

    def follow(self, schedule: AbstractSchedule) -> "PointMass":
        """Moves by another schedule on the same rail."""
        return PointMass(self.mass, OnRail(_require_rail(self), schedule))

    def follow_law(self) -> "PointMass":
        """Moves by the feedback law on the same rail."""
        return PointMass(self.mass, Driven(_require_rail(self)))


def _require_rail(item: PointMass) -> AbstractRail:
    if item.rail is None:
        kind = type(item.motion).__name__
        raise ValueError(f"Argument `motion` must be on a rail to follow a schedule or a law, but it is a {kind}.")
    return item.rail


class BodyParameters(Printed):
    """The parameters that a ball and a disk share; :class:`~jaxball.Ball` describes them.

    Masses whose motions have the same structure are stacked into one group with a leading axis, so
    that the cost of compiling does not grow with their number. ``point_masses`` undoes it; ``order``
    holds the indices of each group's masses, and ``driven`` those whose θ and θ̇ belong to the state.
    Mechanisms are grouped likewise. The state has θ of the driven masses first, and then those of each
    mechanism's joints that are not prescribed, and then those of the ground that a law drives.

    A ``planar`` body lies in the plane of E1 and E3, and has one moment of inertia where others have three.
    """

    planar: ClassVar[bool] = False
    shape: ClassVar[AbstractShape | None] = None  # of a surface that is no sphere: a ConvexBody has one
    derived: ClassVar[tuple[str, ...]] = ()  # numbers that are no arguments

    mass: Float[Array, "*group"] = eqx.field(converter=number(OF_MASS, POSITIVE))
    inertia: Float[Array, "*group 3"] = eqx.field(converter=number(OF_INERTIA, POSITIVE))
    radius: Float[Array, "*group"] = eqx.field(converter=number(LENGTH, POSITIVE))
    offset: Float[Array, "*group 3"] = eqx.field(converter=number(LENGTH))
    gravity: Float[Array, "*group"] = eqx.field(converter=number(OF_GRAVITY, FINITE))
    force: AbstractWrench | None
    groups: tuple[PointMass, ...]
    order: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    driven: tuple[int, ...] = eqx.field(static=True)
    law: AbstractLaw | None
    mechanism_groups: tuple[AbstractMechanism, ...]
    mechanism_order: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    ground: AbstractGround | None
    resistance: AbstractResistance | None
    own_states: OwnStates | None

    def __init__(
        self,
        *,
        mass: Numbers,
        inertia: Numbers,
        radius: Numbers = 1.0,
        offset: Numbers = (0.0, 0.0, 0.0),
        gravity: Numbers = 1.0,
        force: AbstractWrench | None = None,
        masses: Sequence[PointMass] = (),
        law: AbstractLaw | None = None,
        mechanisms: Sequence[AbstractMechanism] = (),
        ground: AbstractGround | None = None,
        resistance: AbstractResistance | None = None,
        own_states: OwnStates | None = None,
    ):
        given: Any = mass, inertia, radius, offset, gravity  # their fields convert them
        self.mass, self.inertia, self.radius, self.offset, self.gravity = given
        self.force, self.law = force, law
        require_each("masses", masses, PointMass, "a PointMass")
        require_each("mechanisms", mechanisms, AbstractMechanism, "a mechanism, such as Mechanism(...)")
        self.groups, self.order = group_items(masses)
        self.driven = tuple(index for index, item in enumerate(masses) if isinstance(item.motion, Driven))
        self.mechanism_groups, self.mechanism_order = group_items(mechanisms)
        self.ground, self.resistance, self.own_states = ground, resistance, own_states
        require("ground", ground, (AbstractGround, type(None)), "a Ground, a surface such as a HeightField, or None")
        require("resistance", resistance, (AbstractResistance, type(None)), "a Resistance or None")
        require("own_states", own_states, (OwnStates, type(None)), "an OwnStates, or None")
        if self.planar:
            _require_line(ground)
        _require_force(self)
        _require_law(self)

    def __repr__(self) -> str:
        hidden = ("groups", "order", "driven", "mechanism_groups", "mechanism_order", *self.derived)
        fields = [field for field in dataclasses.fields(self) if field.name not in hidden]
        attributes = vars(self)  # some are missing while the body is being made
        masses = _lines("masses", attributes.get("groups", ()), attributes.get("order", ()))
        mechanisms = _lines("mechanisms", attributes.get("mechanism_groups", ()), attributes.get("mechanism_order", ()))
        return "\n".join([format_fields(self, fields), *masses, *mechanisms])

    @property
    def point_masses(self) -> tuple[PointMass, ...]:
        """The masses one by one, in the order in which they were given."""
        return ungroup_items(self.groups, self.order)

    @property
    def mechanisms(self) -> tuple[AbstractMechanism, ...]:
        """The mechanisms one by one, in the order in which they were given."""
        return ungroup_items(self.mechanism_groups, self.mechanism_order)

    @property
    def on_rails(self) -> tuple[int, ...]:
        """The indices of the masses on rails, which a schedule or the feedback law moves."""
        groups = zip(self.groups, self.order, strict=True)
        return tuple(sorted(index for group, order in groups if rail_of(group.motion) is not None for index in order))

    @property
    def joints(self) -> tuple[tuple[int, int], ...]:
        """The joints whose θ and θ̇ belong to the state: the indices of each one's mechanism and of the joint in it."""
        if not self.mechanism_order:
            return ()
        kinds = {index: group for group, order in self._mechanism_items for index in order}
        return tuple((index, a) for index in sorted(kinds) for a in kinds[index].in_state)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """What ``theta`` and ``thetadot`` of a state hold, by name."""
        masses = (f"masses[{index}]" for index in self.driven)
        joints = (f"mechanisms[{index}].joints[{a}]" for index, a in self.joints)
        return (*masses, *joints, *(f"ground.{name}" for name in self.driven_ground))

    @property
    def driven_ground(self) -> tuple[str, ...]:
        """The coordinates of the ground that the feedback law drives."""
        return () if self.ground is None else self.ground.driven

    @property
    def accelerated(self) -> tuple[int, ...]:
        """The indices in a state's ``theta`` of the coordinates that the feedback law drives."""
        free = {(i, a) for group, order in self._mechanism_items for i in order for a in group.free}
        joints = (len(self.driven) + slot for slot, joint in enumerate(self.joints) if joint not in free)
        first = len(self.driven) + len(self.joints)
        return (*range(len(self.driven)), *joints, *range(first, first + len(self.driven_ground)))

    def slots(self, order: tuple[int, ...], joints: Sequence[int]) -> Int[np.ndarray, "mechanisms joints"]:
        """Returns the indices in a state's ``theta`` of some joints of each mechanism of a group."""
        places = {joint: len(self.driven) + slot for slot, joint in enumerate(self.joints)}
        return np.asarray([[places[index, a] for a in joints] for index in order], dtype=int).reshape(len(order), -1)

    @property
    def _mechanism_items(self) -> Iterator[tuple[AbstractMechanism, tuple[int, ...]]]:
        return zip(self.mechanism_groups, self.mechanism_order, strict=True)

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments that make this body, by name."""
        names = ("mass", "inertia", "radius", "offset", "gravity", "force", "law", "ground", "resistance", "own_states")
        items = {"masses": self.point_masses, "mechanisms": self.mechanisms}
        return {name: getattr(self, name) for name in names} | items

    @property
    def n_own(self) -> int:
        """The number of states of one's own."""
        return 0 if self.own_states is None else len(self.own_states.names)

    def own_rates(self, t: Float[Array, ""], state: Any) -> Float[Array, " own"] | None:
        """Computes the rates of states of one's own; None without them."""
        return None if self.own_states is None else self.own_states(t, state)

    def height_of_centre(self, Gamma: Float[Array, "3"]) -> Float[Array, ""]:
        """Computes the height of the geometric centre over a plane on which the body stands: r of a sphere."""
        return self.radius if self.shape is None else self.shape.height(Gamma)

    @property
    def up(self) -> Float[Array, "3"]:
        """The vertical −**g**/g, space axes."""
        if self.ground is None:
            return jnp.zeros((3,), self.radius.dtype).at[2].set(1.0)
        return self.ground.up().astype(self.radius.dtype)

    @property
    def n_masses(self) -> int:
        """The number n of point masses."""
        return sum(len(indices) for indices in self.order)

    @property
    def total_mass(self) -> Float[Array, ""]:
        """M = Σ m_i, the shell included."""
        return self.mass + sum(jnp.sum(group.mass) for group in (*self.groups, *self.mechanism_groups))


Item = TypeVar("Item", PointMass, AbstractMechanism)


def group_items(items: Sequence[Item]) -> tuple[tuple[Item, ...], tuple[tuple[int, ...], ...]]:
    """Stacks the items by structure, and returns the indices of those in each group."""
    members: dict[Any, list[int]] = {}
    for index, item in enumerate(items):
        leaves, structure = jax.tree.flatten(item)
        members.setdefault((structure, tuple(np.shape(leaf) for leaf in leaves)), []).append(index)
    order = tuple(tuple(indices) for indices in members.values())
    return tuple(
        jax.tree.map(lambda *leaves: _stack(leaves), *(items[index] for index in indices)) for indices in order
    ), order


def ungroup_items(groups: Sequence[Item], order: Sequence[tuple[int, ...]]) -> tuple[Item, ...]:
    """Returns the items one by one, in the order in which they were before :func:`group_items`."""
    items: dict[int, Item] = {}
    for group, indices in zip(groups, order, strict=True):
        for k, index in enumerate(indices):
            items[index] = jax.tree.map(lambda leaf, k=k: _entry(leaf, k), group)
    return tuple(items[index] for index in range(len(items)))


def _lines(name: str, groups: Sequence[PointMass | AbstractMechanism], order: Sequence[tuple[int, ...]]) -> list[str]:
    """Formats the items one by one, as lines."""
    lines: dict[int, str] = {}
    for group, indices in zip(groups, order, strict=True):
        axis = max(np.ndim(group.mass) - (2 if isinstance(group, AbstractMechanism) else 1), 0)
        for k, index in enumerate(indices):  # the axes before are those of a batch
            item = jax.tree.map(lambda leaf, k=k, axis=axis: entry(leaf, axis, k), group)
            lines[index] = f"  {name}[{index}]: {format_value(item)}"
    shortened = [lines[index] for index in sorted(lines)]
    if len(shortened) > MOST_PRINTED:
        return [*shortened[:MOST_PRINTED], f"  and {len(shortened) - MOST_PRINTED} {name} more"]
    return shortened


def _stack(leaves: Sequence[Any]) -> Array:
    """Stacks known numbers by NumPy, without compiling anything."""
    if any(map(is_traced, leaves)):
        # JAX takes a third of the time to add an axis where nothing is compiled around it.
        return jnp.stack(leaves) if len(leaves) > 1 else jax.lax.expand_dims(leaves[0], (0,))
    stacked = np.stack([np.asarray(leaf) for leaf in leaves])
    return jnp.asarray(stacked, dtype=stacked.dtype)  # with a type, because without one JAX compiles a copy


def _entry(leaf: Any, index: int) -> Any:
    """Returns an entry along the first axis, taken by NumPy where it is known, without compiling anything."""
    is_concrete = isinstance(leaf, jax.Array) and not is_traced(leaf)
    return jnp.asarray(np.asarray(np.asarray(leaf)[index]), dtype=leaf.dtype) if is_concrete else leaf[index]


def _require_line(ground: AbstractGround | None) -> None:
    """Refuses what a disk cannot roll on."""
    if ground is not None and ground.turntable is not None:
        raise ValueError("Argument `ground` must have no turntable under a disk, which rolls on a line; use a Ball.")


def _require_force(body: "BodyParameters") -> None:
    force = body.force
    if force is None:
        return
    is_constant = isinstance(force, list | tuple | jax.Array | np.ndarray)
    remedy = (
        "HarmonicForce(constant) is one"
        if is_constant
        else "FunctionWrench(function) is one"
        if callable(force)
        else ""
    )
    require("force", force, AbstractWrench, "a force or None", remedy)
    if not isinstance(force, HarmonicForce | FunctionForce):  # which have been checked when they were made
        require_wrench("force", force, len(body.coordinates), body.n_own)


def _require_law(body: "BodyParameters") -> None:
    law, driven = body.law, [body.coordinates[slot] for slot in body.accelerated]
    if law is None:
        if driven:
            raise ValueError(
                f"Argument `law` must be a feedback law, because one drives {all_of(driven)}, but it is None; "
                "give a law, or a schedule to each of these."
            )
        return
    remedy = "FunctionLaw(function) is one" if callable(law) else ""
    require("law", law, AbstractLaw, "a feedback law or None", remedy)
    if not driven:
        raise ValueError(
            "Argument `law` must be None, because it drives nothing; use `Driven(rail)` for a mass, or "
            "`Accelerated()` for a joint or an angle of a TiltingPlane."
        )
    law.require_driven(len(driven))
