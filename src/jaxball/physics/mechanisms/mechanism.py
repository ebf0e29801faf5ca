"""Mechanisms: point masses carried by joints, which move by schedules, laws and forces."""

import abc
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PyTree

from ...interface.arguments import call_with, require_each, require_function
from ...interface.printing import Printed
from ...numerics.arrays import Numbers, default_dtype, join_arrays, numbers, stack_arrays
from ...numerics.declare import LENGTH, OF_MASS, POSITIVE, number
from ...numerics.vectors import cross
from ..conditions import Condition, positive
from ..prescribed.schedules import AbstractSchedule
from ..state import State
from .forces import AbstractJointForce
from .joints import AbstractJoint, Accelerated, Drive, HardStops, Hinge, JointFriction, Moved, in_place, require_drive

AnyMechanism = TypeVar("AnyMechanism", bound="AbstractMechanism")
EachJoint = tuple[Float[Array, "_"], Float[Array, "_"], Float[Array, "_"]]  # θ, θ̇ and θ̈ of some or all joints


class Places(NamedTuple):
    """The positions χ_i of a mechanism's masses, and how each joint moves them, χ_a = ∂χ/∂θ_a.

    ``details`` are what the kind of mechanism keeps to compute the rates of these.
    """

    chi: Float[Array, "n 3"]
    partial: Float[Array, "k n 3"]
    details: PyTree


class CarriedMass(Printed):
    """A point mass that a joint of a mechanism carries.

    **Arguments:**

    - ``mass``: the mass, in units of mass.
    - ``place``: its position when every θ is 0, from the geometric centre, body axes, length, shape (3,).
    - ``joint``: the index of the joint that carries it; by default the last one.

    **Example:**

    >>> from jaxball import CarriedMass, Hinge, Mechanism
    >>> Mechanism([Hinge((0.0, 1.0, 0.0))], [CarriedMass(0.5, (0.0, 0.0, -0.6))])
    Mechanism(joints=(Hinge(axis=(0.0, 1.0, 0.0)),), mass=(0.5,), place=((0.0, 0.0, -0.6),), carrier=(0,))
    """

    mass: Float[Array, ""] = eqx.field(converter=number(OF_MASS, POSITIVE))
    place: Float[Array, "3"] = eqx.field(converter=number(LENGTH), default=(0.0, 0.0, 0.0))
    joint: int = eqx.field(static=True, default=-1)


class AbstractMechanism(Printed):
    """Point masses placed by joints: χ_i(θ), with θ of every joint.

    A kind of mechanism implements ``drives``, ``places`` and ``slopes``. A joint's drive decides whether a schedule
    prescribes its θ, or θ belongs to the state, because a law accelerates the joint (``Accelerated``) or it moves
    freely under a force.
    """

    mass: eqx.AbstractVar[Float[Array, "*group n"]]

    @property
    @abc.abstractmethod
    def drives(self) -> tuple[Drive, ...]:
        """What drives each joint."""

    @abc.abstractmethod
    def places(self, theta: Float[Array, " k"]) -> Places:
        """Computes χ of each mass, and its derivatives with respect to each θ."""

    @abc.abstractmethod
    def slopes(self, places: Places, thetadot: Float[Array, " k"]) -> Float[Array, "k n 3"]:
        """Computes the rates of the derivatives, Σ_b χ_ab θ̇_b, at the ``Places`` that :meth:`places` returned."""

    def arms(self, theta: Float[Array, " k"]) -> Float[Array, "n points 3"]:
        """Returns, for each mass, the points of the line that is drawn from the hinges that carry it to the mass."""
        return self.places(theta).chi[:, None]

    @property
    def n_joints(self) -> int:
        """The number k of joints."""
        return len(self.drives)

    @property
    def in_state(self) -> tuple[int, ...]:
        """The joints whose θ and θ̇ belong to the state."""
        return tuple(a for a, drive in enumerate(self.drives) if not isinstance(drive, AbstractSchedule))

    @property
    def accelerated(self) -> tuple[int, ...]:
        """The joints whose θ̈ the feedback law gives."""
        return tuple(a for a, drive in enumerate(self.drives) if isinstance(drive, Accelerated))

    @property
    def free(self) -> tuple[int, ...]:
        """The joints that move under forces."""
        return tuple(a for a in self.in_state if a not in self.accelerated)

    def rates(self, t: Float[Array, ""], own: EachJoint) -> EachJoint:
        """Returns θ, θ̇ and θ̈ of every joint, where ``own`` has the values that belong to the state."""
        columns = []
        for a, drive in enumerate(self.drives):
            if isinstance(drive, AbstractSchedule):
                columns.append(drive.derivatives(t))
            else:
                columns.append(tuple(values[self.in_state.index(a)] for values in own))
        theta, thetadot, thetaddot = (jnp.stack(values) for values in zip(*columns, strict=True))
        return theta, thetadot, thetaddot

    def forces(
        self, t: Float[Array, ""], rates: EachJoint, state: State, impulses: bool = True
    ) -> Float[Array, " free"]:
        """Computes Q of the free joints; without ``impulses``, only the part of it that :meth:`impulses` does not
        integrate.
        """
        theta, thetadot, _ = rates
        forces = []
        for a in self.free:
            drive = self.drives[a]
            if isinstance(drive, AbstractJointForce):
                force = drive if impulses else drive.without_impulse
                forces.append(force(t, theta[a], thetadot[a], state))
            else:
                forces.append(jnp.zeros_like(theta[a]))
        return jnp.stack(forces)

    def impulses(self, t: Float[Array, ""]) -> Float[Array, " free"]:
        """Computes ∫ Q up to t of the parts of forces on free joints that are known in closed form."""
        drives = (self.drives[a] for a in self.free)
        parts = [drive.impulse(t) if isinstance(drive, AbstractJointForce) else None for drive in drives]
        return jnp.stack([jnp.zeros_like(t) if part is None else part for part in parts])

    @property
    def frictions(self) -> dict[int, JointFriction]:
        """The friction that may hold a free joint at rest, by the place of the joint among the free ones."""
        of_joints = {place: drive.sticking for place, drive in self._free_forces.items()}
        return {place: friction for place, terms in of_joints.items() for friction in terms}  # pyright: ignore[reportReturnType]

    @property
    def stops(self) -> dict[int, HardStops]:
        """The hard stops of free joints, by the place of the joint among the free ones."""
        of_joints = {place: drive.stopping for place, drive in self._free_forces.items()}
        return {place: stops for place, terms in of_joints.items() for stops in terms}  # pyright: ignore[reportReturnType]

    @property
    def _free_forces(self) -> dict[int, AbstractJointForce]:
        drives = ((place, self.drives[a]) for place, a in enumerate(self.free))
        return {place: drive for place, drive in drives if isinstance(drive, AbstractJointForce)}

    @property
    def holdable(self) -> tuple[int, ...]:
        """The places, among the free joints, of those that may be held: by dry friction, or at a hard stop."""
        return tuple(place for place, drive in self._free_forces.items() if drive.sticking or drive.stopping)

    def slipping(self: AnyMechanism, directions: Float[Array, " sticking"]) -> AnyMechanism:
        """Returns the same mechanism where the joints of :attr:`holdable` move in these directions, or are held, 0."""
        drives = list(self.drives)
        for which, place in enumerate(self.holdable):
            drive = drives[self.free[place]]
            assert isinstance(drive, AbstractJointForce)
            drives[self.free[place]] = drive.slipping(directions[which])
        return self.with_drives(drives)

    def conditions(self, name: str) -> Iterator[Condition]:
        """Yields every condition that its numbers must meet, with the name that sentences use; traceable."""
        yield Condition(positive(self.mass), f"{name}.mass", self.mass, "positive numbers")
        for a, drive in enumerate(self.drives):
            if isinstance(drive, AbstractJointForce):
                yield from drive.conditions(f"{name}.joints[{a}].drive")

    def motion_kinks(self) -> Float[Array, " kinks"]:
        """Returns the times at which θ̈ of a schedule, or a force whose impulse is known, jumps or has a kink."""
        times = [drive.kinks() for drive in self.drives if isinstance(drive, AbstractSchedule)]
        times += [drive.motion_kinks() for drive in self.drives if isinstance(drive, AbstractJointForce)]
        return join_arrays(times)

    def driving_kinks(self, state: State) -> Float[Array, " kinks"]:
        """Returns the times at which any other force jumps or has a kink, for such a state."""
        return join_arrays([drive.kinks_with(state) for drive in self.drives if isinstance(drive, AbstractJointForce)])

    @abc.abstractmethod
    def with_drives(self: AnyMechanism, drives: Sequence[Drive]) -> AnyMechanism:
        """Returns the same mechanism with other drives, one for each joint."""

    def prepare(self: AnyMechanism) -> AnyMechanism:
        """Returns the same mechanism, ready to be evaluated many times."""
        return self.with_drives([_prepare(drive) for drive in self.drives])


def _prepare(drive: Drive) -> Drive:
    return drive.prepare() if isinstance(drive, AbstractSchedule | AbstractJointForce) else drive


class Mechanism(AbstractMechanism):
    """Joints in a chain, or in branches, and the point masses that they carry.

    **Arguments:**

    - ``joints``: each a :class:`~jaxball.Hinge`, a :class:`~jaxball.Slider` or a :class:`~jaxball.Carriage`, on the
      joint before it, unless its ``on`` says otherwise.
    - ``masses``: each a :class:`~jaxball.CarriedMass`, any number of them; a rigid body is six of them.

    Every joint must move some mass: where H_aa = Σ m |∂χ/∂θ_a|² is 0, its θ̈ is not determined. It is 0 for a mass on
    the hinge's axis, and for two successive hinges in a configuration where the second has brought its masses onto the
    axis of the first; another order of axes then helps.

    **Raises:** ``ValueError`` when joints carry each other in a circle, or a mass is on a joint that does not exist.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Ball, BallState, CarriedMass, Hinge, Mechanism, simulate
    >>> pendulum = Mechanism([Hinge((0.0, 1.0, 0.0))], [CarriedMass(0.5, (0.0, 0.0, -0.6))])
    >>> ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), mechanisms=[pendulum])
    >>> ball.coordinates  # what `theta` of its states holds
    ('mechanisms[0].joints[0]',)
    >>> run = simulate(ball, jnp.array([0.0, 1.0]), BallState(theta=[0.3], thetadot=[0.0]))
    >>> run.state.theta.shape
    (2, 1)
    """

    joints: tuple[AbstractJoint, ...]
    mass: Float[Array, "*group n"]
    place: Float[Array, "*group n 3"]
    carrier: tuple[int, ...] = eqx.field(static=True)

    def __init__(self, joints: Sequence[AbstractJoint], masses: Sequence[CarriedMass] = ()):
        require_each("joints", joints, AbstractJoint, "a joint, such as Hinge(...)")
        require_each("masses", masses, CarriedMass, "a CarriedMass")
        if not joints:
            raise ValueError(
                "Argument `joints` must be a list of one joint or more, but it is empty; a mass that does not move in "
                "the body is a PointMass with the motion Fixed(...)."
            )
        self.joints = tuple(joints)
        for a, joint in enumerate(self.joints):
            if joint.on is not None and not -1 <= joint.on < a:
                raise ValueError(
                    f"Argument `joints[{a}].on` must be the index of a joint before it, or -1 for the body, but it is "
                    f"{joint.on}, so that joints would carry each other in a circle; list a joint after the one that "
                    "carries it."
                )
        self.carrier = tuple(_carrier(index, item.joint, len(joints)) for index, item in enumerate(masses))
        self.mass = stack_arrays([item.mass for item in masses])
        self.place = stack_arrays([item.place for item in masses], (3,))
        _require_moved(self)

    @property
    def drives(self) -> tuple[Drive, ...]:
        return tuple(joint.drive for joint in self.joints)

    @property
    def masses(self) -> tuple[CarriedMass, ...]:
        """The masses one by one."""
        return tuple(CarriedMass(m, x, a) for m, x, a in zip(self.mass, self.place, self.carrier, strict=True))

    def carriers(self, a: int) -> tuple[int, ...]:
        """Lists the joints that carry joint ``a``, and itself."""
        return _chains(self.joints)[a]

    def links(self, theta: Float[Array, " k"]) -> list[Moved]:
        """Computes where each joint places its link, and how it moves it."""
        links: list[Moved] = []
        for a, (joint, on) in enumerate(zip(self.joints, _list_carriers(self.joints), strict=True)):
            links.append(joint.move(links[on].placement if on >= 0 else in_place(theta), theta[a]))
        return links

    def places(self, theta: Float[Array, " k"]) -> Places:
        links = self.links(theta)
        loaded = tuple(dict.fromkeys(self.carrier))  # the links that have masses, each once
        order = [np.flatnonzero(np.asarray(self.carrier) == link) for link in loaded]
        points = [links[link].placement.of_points(self.place[which]) for link, which in zip(loaded, order, strict=True)]
        chi = jnp.concatenate(points)[np.argsort(np.concatenate(order))]
        w, c, v, bend = (jnp.stack(column) for column in zip(*(link[1:] for link in links), strict=True))
        return Places(chi, jnp.where(self._moved, _velocity(w, c, v, chi), 0.0), (w, c, v, bend))

    def slopes(self, places: Places, thetadot: Float[Array, " k"]) -> Float[Array, "k n 3"]:
        w, c, v, bend = places.details
        # The rate of w × (χ − c) + v: joints before a joint carry its w, c and v, and all of them carry χ.
        rate = jnp.where(self._before, thetadot[None, :], 0.0)[..., None]  # of each joint's carriers
        omega = jnp.sum(rate * w[None], axis=1)
        cdot = jnp.sum(rate * jnp.swapaxes(_velocity(w, c, v, c), 0, 1), axis=1)
        vdot = cross(omega, v) + thetadot[:, None] * bend
        chidot = jnp.sum(places.partial * thetadot[:, None, None], axis=0)
        turned = _velocity(cross(omega, w), c, vdot, places.chi)
        return jnp.where(self._moved, turned + _velocity(w, cdot, jnp.zeros_like(v), chidot), 0.0)

    def arms(self, theta: Float[Array, " k"]) -> Float[Array, "n points 3"]:
        places = self.places(theta)
        hinges = [a for a, joint in enumerate(self.joints) if isinstance(joint, Hinge)]
        carried = self._moved[hinges].swapaxes(0, 1)
        points = jnp.where(carried, places.details[1][np.asarray(hinges, dtype=int)][None], jnp.nan)
        return jnp.concatenate([points, places.chi[:, None]], axis=1)

    @property
    def _before(self) -> Bool[np.ndarray, "k k"]:
        """Whether the joint of a column is among those that carry the joint of a row."""
        k = self.n_joints
        rows = [[b in chain[:-1] for b in range(k)] for chain in _chains(self.joints)]
        return np.asarray(rows, dtype=bool).reshape(k, k)

    @property
    def _moved(self) -> Bool[np.ndarray, "k n 1"]:
        """Whether each joint moves each mass."""
        chains = _chains(self.joints)
        rows = [[a in chains[link] for link in self.carrier] for a in range(self.n_joints)]
        return np.asarray(rows, dtype=bool)[..., None]

    def conditions(self, name: str) -> Iterator[Condition]:
        yield from AbstractMechanism.conditions(self, name)
        for a, joint in enumerate(self.joints):
            yield from joint.conditions(f"{name}.joints[{a}]")

    def with_drives(self, drives: Sequence[Drive]) -> "Mechanism":
        joints = [
            eqx.tree_at(lambda j: j.drive, joint, drive, is_leaf=lambda x: x is None)
            for joint, drive in zip(self.joints, drives, strict=True)
        ]
        return eqx.tree_at(lambda m: m.joints, self, tuple(joints))

    def prepare(self) -> "Mechanism":
        joints = tuple(joint.prepare() for joint in self.joints)
        placed: Mechanism = eqx.tree_at(lambda m: m.joints, self, joints)
        return placed.with_drives([_prepare(drive) for drive in placed.drives])


class FunctionMechanism(AbstractMechanism):
    """Masses at χ_i = function(θ, parameters), for any function that JAX can trace.

    ``function`` is compiled into programs: one that is written anew compiles again unless it only uses equal numbers.

    **Arguments:**

    - ``function``: of (theta, parameters), with θ of every joint, shape (k,), to χ, from the geometric centre, body
      axes, length, shape (n, 3).
    - ``mass``: of each mass, shape (n,).
    - ``drives``: what drives each θ, as for a :class:`~jaxball.Hinge`; k of them.
    - ``parameters``: arrays, in any PyTree, passed to the function; they can be swept and differentiated.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.physics import FunctionMechanism
    >>> def on_a_sphere(theta, radius):
    ...     a, b = theta
    ...     return radius * jnp.stack([jnp.sin(a), jnp.cos(a) * jnp.sin(b), -jnp.cos(a) * jnp.cos(b)])[None]
    >>> puck = FunctionMechanism(on_a_sphere, mass=[0.2], drives=[None, None], parameters=0.8)
    >>> puck.n_joints
    2
    """

    function: Callable[[Float[Array, " k"], PyTree], Float[Array, "n 3"]] = eqx.field(static=True)
    mass: Float[Array, "*group n"]
    given: tuple[Drive, ...]
    parameters: PyTree

    def __init__(
        self,
        function: Callable[[Float[Array, " k"], PyTree], Float[Array, "n 3"]],
        mass: Numbers,
        drives: Sequence[Drive],
        parameters: PyTree = None,
    ):
        self.function, self.parameters = function, parameters
        self.mass = numbers("mass", ("n",))(mass)
        for a, drive in enumerate(drives):
            require_drive(f"drives[{a}]", drive)
        self.given = tuple(drives)
        theta = jax.ShapeDtypeStruct((len(self.given),), default_dtype())
        require_function("function", function, (self.mass.shape[0], 3), theta=theta, parameters=parameters)

    @property
    def drives(self) -> tuple[Drive, ...]:
        return self.given

    def places(self, theta: Float[Array, " k"]) -> Places:
        def at(theta):
            return call_with(self.function, theta, parameters=self.parameters)

        units = jnp.eye(len(self.given), dtype=theta.dtype)
        return Places(at(theta), jnp.stack([jax.jvp(at, (theta,), (unit,))[1] for unit in units]), theta)

    def slopes(self, places: Places, thetadot: Float[Array, " k"]) -> Float[Array, "k n 3"]:
        return jax.jvp(lambda theta: self.places(theta).partial, (places.details,), (thetadot,))[1]

    def with_drives(self, drives: Sequence[Drive]) -> "FunctionMechanism":
        return eqx.tree_at(lambda m: m.given, self, tuple(drives), is_leaf=lambda x: x is None)


def _velocity(
    w: Float[Array, "k 3"], c: Float[Array, "k 3"], v: Float[Array, "k 3"], x: Float[Array, "n 3"]
) -> Float[Array, "k n 3"]:
    """Computes w × (x − c) + v of every joint, at every point."""
    arms = x[None] - c[:, None]
    return cross(jnp.broadcast_to(w[:, None], arms.shape), arms) + v[:, None]


def _carrier(index: int, joint: int, count: int) -> int:
    if not -count <= joint < count:
        raise ValueError(
            f"Argument `masses[{index}].joint` must be the index of one of the {count} joints, but it is {joint}."
        )
    return joint % count


def _list_carriers(joints: Sequence[AbstractJoint]) -> list[int]:
    """Lists, of each joint, the joint that carries it; -1 for the body."""
    return [a - 1 if joint.on is None else joint.on for a, joint in enumerate(joints)]


def _chains(joints: Sequence[AbstractJoint]) -> list[tuple[int, ...]]:
    """Lists, of each joint, those that carry it, and itself."""
    # Of the joints alone: each access to a method of a module takes as long as the module has leaves.
    chains: list[tuple[int, ...]] = []
    for a, on in enumerate(_list_carriers(joints)):
        chains.append((*(chains[on] if on >= 0 else ()), a))
    return chains


def _require_moved(mechanism: Mechanism) -> None:
    chains = _chains(mechanism.joints)
    carrying = {a for link in set(mechanism.carrier) for a in chains[link]}
    for a in range(mechanism.n_joints):
        if a not in carrying:
            raise ValueError(
                f"Argument `joints[{a}]` must move some mass, but it carries none; give it a mass, or leave it out."
            )
