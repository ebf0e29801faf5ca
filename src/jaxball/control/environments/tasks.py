"""What an episode of an environment is: the task of the robot with its rewards, and the numbers that it draws.

The goals here are to reach a point, to follow a path and to hold a speed. Domain randomisation draws numbers of the
robot and of its start, by name, from distributions.
"""

import abc
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...interface.arguments import describe, require
from ...interface.compat import is_traced
from ...interface.printing import Printed
from ...interface.wording import did_you_mean
from ...numerics.arrays import Numbers, positive_number, to_array
from ...numerics.declare import number, number_or_none
from ...numerics.vectors import dot, root
from ...physics.body import System
from ...physics.contact.body_on_plane import BodyOnPlane
from ...physics.contact.law import Contact
from ...physics.contact.modes import ContactState
from ...physics.contact.released import ReleasedState, position, release
from ...physics.prescribed.schedules import AbstractSchedule
from ...physics.prescribed.signals import AbstractSignal, ConstantSignal
from ...physics.state import PlacedState
from ..weights import places_by_name


class AbstractDistribution(Printed):
    """A distribution from which random numbers are drawn in place of given ones.

    A kind of distribution implements ``draw``, which is traced.
    """

    @abc.abstractmethod
    def draw(self, key: Any, nominal: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        """Draws random numbers in place of ``nominal``, of its shape, by a random key."""


class Uniform(AbstractDistribution):
    """Numbers between two bounds, independent of each other, all equally likely.

    **Arguments:**

    - ``low``, ``high``: the bounds, in the units of the parameter that is drawn.

    **Raises:** ``ValueError`` where ``low`` is above ``high``.

    **Example:**

    >>> import jax, jax.numpy as jnp
    >>> from jaxball.control.environments import Uniform
    >>> drawn = Uniform(0.9, 1.1).draw(jax.random.key(0), jnp.zeros(1000))
    >>> bool(drawn.min() >= 0.9), bool(drawn.max() <= 1.1), round(float(drawn.mean()), 2)
    (True, True, 1.0)
    """

    low: Float[Array, ""] = eqx.field(converter=number())
    high: Float[Array, ""] = eqx.field(converter=number())

    def __check_init__(self):
        if not (is_traced(self.low) or is_traced(self.high)) and not np.asarray(self.low) <= np.asarray(self.high):
            raise ValueError(
                f"Argument `high` must be {self.low:g} or more, which is `low`, but it is {self.high:g}; exchange them."
            )

    def draw(self, key, nominal):
        return self.low + (self.high - self.low) * jax.random.uniform(key, nominal.shape, nominal.dtype)


class Normal(AbstractDistribution):
    """Gaussian numbers, independent of each other.

    **Arguments:**

    - ``mean``, ``deviation``: the mean and the standard deviation, in the units of the parameter that is drawn.

    **Raises:** ``ValueError`` for a negative deviation.
    """

    mean: Float[Array, ""] = eqx.field(converter=number())
    deviation: Float[Array, ""] = eqx.field(converter=number())

    def __check_init__(self):
        if not is_traced(self.deviation) and not np.asarray(self.deviation) >= 0:
            raise ValueError(f"Argument `deviation` must be 0 or positive, but it is {self.deviation:g}.")

    def draw(self, key, nominal):
        return self.mean + self.deviation * jax.random.normal(key, nominal.shape, nominal.dtype)


class Factor(AbstractDistribution):
    """One random factor for all nominal numbers: moments of inertia that grow together stay possible.

    **Arguments:**

    - ``factor``: its distribution.
    """

    factor: AbstractDistribution

    def __check_init__(self):
        require("factor", self.factor, AbstractDistribution, "a distribution, such as Uniform(0.9, 1.1)")

    def draw(self, key, nominal):
        # One number for all: moments drawn one by one could be those of no body.
        return nominal * self.factor.draw(key, jnp.ones((), nominal.dtype))


def numbers_of(system: System) -> dict[str, Float[Array, "..."]]:
    """Returns the arrays among the arguments that make a body, by their paths, such as ``mechanisms[0].mass``."""
    return {_name(path): leaf for path, leaf in jax.tree_util.tree_leaves_with_path(system.arguments)}


def with_numbers(system: System, values: Mapping[str, Float[Array, "..."]]) -> System:
    """Returns the body with other arrays, by their paths; traceable."""
    leaves, structure = jax.tree_util.tree_flatten_with_path(system.arguments)
    changed = [values.get(_name(path), leaf) for path, leaf in leaves]
    # Made again by its constructor, which computes and checks what follows from the arguments.
    return type(system)(**jax.tree.unflatten(structure, changed))


def require_numbers_of(system: System, names: Iterable[str]) -> dict[str, Float[Array, "..."]]:
    """Returns the arrays of a body with these paths.

    **Raises:** ``ValueError`` for one that it does not have.
    """
    arrays = numbers_of(system)
    for name in names:
        if name not in arrays:
            there = f"its numbers are {', '.join(arrays)}"
            raise ValueError(
                f"Argument `parameters` must have paths of numbers of this {system.title} as keys, but one is {name!r}"
                f"{did_you_mean(name, arrays, there)}"
            )
    # A parameter of a user's function may be a number of Python.
    return {name: to_array(arrays[name], name) for name in names}


def directions_by_name(names: Iterable[str], directions: tuple[str, ...]) -> dict[str, list[int]]:
    """Finds the places of local coordinates, by their names or by those of their groups.

    **Raises:** ``ValueError`` for an unknown name, and for a coordinate that two names give.
    """
    indices = places_by_name("starts", names, directions)
    places = [place for places in indices.values() for place in places]
    for place in places:
        if places.count(place) > 1:
            raise ValueError(f"Argument `starts` must give {directions[place]} once, but two of its keys do.")
    return indices


def _name(path: Any) -> str:
    return f"{path[0].key}{jax.tree_util.keystr(path[1:])}"


UPRIGHT = 1e-12  # the square of the horizontal part of a body axis that has no direction on the plane


class Moment(NamedTuple):
    """A moment of an episode.

    - ``t``: the time since the reset.
    - ``system``: the body with the inputs that act, and the parameters that were drawn.
    - ``state``: its state.
    - ``u``: the inputs that act, shape (m,).
    - ``slip``: with a law of contact, all that a solve advances: the velocity ``V`` of the centre, its ``height``, the
      ``mode``; else None.
    - ``contact``: that law.
    """

    t: Float[Array, ""]
    system: System
    state: PlacedState
    u: Float[Array, " m"]
    slip: ContactState | None = None
    contact: Contact | None = None

    @property
    def as_solved(self) -> tuple[Any, Any]:
        """The body and its state as a solve has them, with a law of contact and its modes."""
        if self.slip is None or self.contact is None:
            return self.system, self.state
        return BodyOnPlane(self.system, self.contact), self.slip

    @property
    def place(self) -> Float[Array, " d"]:
        """The position of the centre along e1 and e2, d = 2, or of a disk along e1, d = 1."""
        return self._in_plane(position(self.system.prepare(), self.t, self._released)[:2])

    @property
    def velocity(self) -> Float[Array, " d"]:
        """The velocity of the centre along the same axes."""
        return self._in_plane(self._released.V[:2])

    @property
    def spin(self) -> Float[Array, ""]:
        """Ω·Γ, the angular velocity about the vertical."""
        return dot(self.state.Omega, self.state.Gamma)

    @property
    def heading(self) -> Float[Array, "2"]:
        """The direction in which the body rolls about its axis E2: horizontal, of length 1; 0 where E2 is vertical."""
        axis = self.state.Lambda[:2, 1]
        # With a bound below, because a policy is differentiated through this, and the root has no slope at 0.
        size = root(jnp.sum(axis**2), UPRIGHT)
        ahead = jnp.stack([axis[1], -axis[0]])
        # The inner `where` keeps the division by 0 out of the gradient, too.
        return jnp.where(size > 0, ahead / jnp.where(size > 0, size, 1.0), 0.0)

    def ahead(self, vector: Float[Array, "*rows d"]) -> Float[Array, "*rows d"]:
        """Converts horizontal vectors to their components ahead and to the left; for a disk, they stay as they are."""
        if vector.shape[-1] == 1:
            return vector
        c, s = self.heading
        x, y = vector[..., 0], vector[..., 1]
        return jnp.stack([c * x + s * y, c * y - s * x], axis=-1)

    @property
    def _released(self) -> ReleasedState:
        """The state with the velocity of the centre, and its height over that of rolling."""
        return release(self.system.prepare(), self.t, self.state) if self.slip is None else self.slip.released

    def _in_plane(self, vector: Float[Array, "2"]) -> Float[Array, " d"]:
        return vector[:1] if self.system.planar else vector


class AbstractGoal(Printed):
    """What the robot is to do.

    A kind of goal implements ``misses``; ``draw``, if something of it is random; ``observe``, if a policy is to see it
    in another form; and ``is_reached``, if an episode ends where it is. All are traced, for one robot. One that is not
    for every body says so in ``require_fits``.
    """

    def require_fits(self, system: System) -> None:
        """Raises an error where it is no goal of this body; called when an environment is made."""

    def draw(self, key: Any, moment: Moment) -> Any:
        """Draws the target of an episode: a PyTree of arrays, of the same structure at each reset, at its
        first moment.
        """
        return ()

    @abc.abstractmethod
    def misses(self, target: Any, moment: Moment) -> Float[Array, " misses"]:
        """Returns what the robot misses the target by: numbers that are all 0 where it does as it should."""

    def observe(self, target: Any, moment: Moment) -> Float[Array, " numbers"]:
        """Returns what a policy sees of the target; by default, what it is missed by."""
        return self.misses(target, moment)

    def is_reached(self, target: Any, moment: Moment) -> Bool[Array, ""]:
        """Returns whether the robot has done what it is to do, which ends the episode; by default never."""
        return jnp.zeros((), bool)


class ReachPoint(AbstractGoal):
    """To come to a point, and to rest there.

    What is missed is the way to go and the velocity, of a ball shape (4,), of a disk (2,), in space axes. A policy sees
    both by their components ahead and to the left.

    **Arguments:**

    - ``point``: along e1 and e2, length, shape (2,); of a disk, a number; the origin by default.
    - ``drawn``: the distribution of the point's coordinates, which are then drawn at each reset.
    - ``within``: if given, an episode ends where the robot is closer to the point, a length, and slower than this
      length in a unit of time.
    """

    point: Float[Array, " d"] | None = eqx.field(converter=lambda x: _row("point", x), default=None)
    drawn: AbstractDistribution | None = None
    within: Float[Array, ""] | None = eqx.field(converter=number_or_none(), default=None)

    def __check_init__(self):
        _require_distribution(self.drawn)
        if self.within is not None:
            positive_number("within", self.within)

    def require_fits(self, system: System) -> None:
        """Raises ``ValueError`` for a point with another number of coordinates."""
        if self.point is not None and self.point.size != (1 if system.planar else 2):
            body, must = ("disk", "one number") if system.planar else ("ball", "two numbers, along e1 and e2,")
            raise ValueError(
                f"Argument `point` of ReachPoint must be {must} for a {body}, but its shape is {self.point.shape}."
            )

    def draw(self, key, moment):
        point = jnp.zeros_like(moment.place) if self.point is None else self.point
        return point if self.drawn is None else self.drawn.draw(key, point)

    def misses(self, target, moment):
        return jnp.concatenate([target - moment.place, -moment.velocity])

    def observe(self, target, moment):
        return jnp.concatenate([moment.ahead(target - moment.place), -moment.ahead(moment.velocity)])

    def is_reached(self, target, moment):
        if self.within is None:
            return super().is_reached(target, moment)
        # The way and the velocity, each by its length.
        rows = self.misses(target, moment).reshape(2, -1)
        return jnp.all(jnp.sum(rows**2, axis=1) < self.within**2)


class FollowPath(AbstractGoal):
    """To follow a point that moves along a path.

    What is missed is the way to the point and its velocity relative to the robot, of a ball shape (4,), of a disk (2,),
    in space axes. A policy sees both by their components ahead and to the left, and the way to where the point will be.

    **Arguments:**

    - ``along``: its first coordinate over time, a schedule such as :class:`~jaxball.Waypoints`.
    - ``across``: its second coordinate; of a disk, None.
    - ``preview``: how long ahead of the point a policy sees the path, times, shape (k,).
    """

    along: AbstractSchedule
    across: AbstractSchedule | None = None
    preview: Float[Array, " k"] = eqx.field(converter=number(), default=())

    def __check_init__(self):
        must = "a schedule, such as Waypoints(...)"
        require("along", self.along, AbstractSchedule, must)
        require("across", self.across, (AbstractSchedule, type(None)), f"{must}, or None")

    def require_fits(self, system: System) -> None:
        """Raises ``ValueError`` for a path of another number of coordinates."""
        if system.planar != (self.across is None):
            body, must = ("disk", "None") if system.planar else ("ball", "a schedule")
            raise ValueError(
                f"Argument `across` of FollowPath must be {must} for a {body}, but it is {describe(self.across)}."
            )

    def misses(self, target, moment):
        place, velocity = self._at(moment.t, moment)
        return jnp.concatenate([place - moment.place, velocity - moment.velocity])

    def observe(self, target, moment):
        place, velocity = self._at(moment.t, moment)
        rows = [place - moment.place, velocity - moment.velocity]
        rows += [self._at(moment.t + later, moment)[0] - moment.place for later in self.preview]
        return jnp.ravel(moment.ahead(jnp.stack(rows)))

    def _at(self, t: Float[Array, ""], moment: Moment) -> tuple[Float[Array, " d"], Float[Array, " d"]]:
        axes = [axis for axis in (self.along, self.across) if axis is not None]
        place, velocity, _ = zip(*(axis.prepare().derivatives(t) for axis in axes), strict=True)
        return jnp.stack(place), jnp.stack(velocity)


class HoldSpeed(AbstractGoal):
    """To roll ahead with a speed, and not aside.

    What is missed is the speed ahead, and that to the left of a ball, shapes (2,) and (1,).

    **Arguments:**

    - ``speed``: a number, or a signal of the time since the reset, such as :class:`~jaxball.PiecewiseSignal`.
    - ``drawn``: the distribution of a number that the speed is multiplied by, drawn at each reset.
    """

    speed: AbstractSignal = eqx.field(converter=lambda x: x if isinstance(x, AbstractSignal) else ConstantSignal(x))
    drawn: AbstractDistribution | None = None

    def __check_init__(self):
        _require_distribution(self.drawn)

    def draw(self, key, moment):
        unit = jnp.ones_like(moment.t)
        return unit if self.drawn is None else self.drawn.draw(key, unit)

    def misses(self, target, moment):
        velocity = moment.ahead(moment.velocity)
        speed = target * self.speed.prepare()(moment.t)
        return jnp.concatenate([speed[None] - velocity[:1], -velocity[1:]])


def _row(name: str, numbers: Numbers | None) -> Float[Array, " d"] | None:
    if numbers is None:
        return None
    array = jnp.atleast_1d(to_array(numbers, name))
    if array.ndim != 1 or array.size not in (1, 2):
        raise ValueError(f"Argument `{name}` must be a number or two, but its shape is {array.shape}.")
    return array


def _require_distribution(drawn: Any) -> None:
    require("drawn", drawn, (AbstractDistribution, type(None)), "a distribution, such as Uniform(-1.0, 1.0), or None")


class AbstractReward(Printed):
    """The reward of a step.

    A kind of reward implements ``__call__``, which is traced, for one robot.
    """

    @abc.abstractmethod
    def __call__(self, misses: Float[Array, " misses"], moment: Moment) -> Float[Array, ""]:
        """Computes the reward per time, at the end of a step, by what the goal is missed by there."""


class QuadraticReward(AbstractReward):
    """−(Σ w m² + Σ v u²): less, the more the goal is missed and the larger the inputs are.

    **Arguments:**

    - ``misses``: the weights w, a number for all, or shape (misses,).
    - ``inputs``: the weights v, a number for all, or shape (m,).

    **Example:**

    >>> from jaxball.control.environments import QuadraticReward
    >>> QuadraticReward(misses=(1.0, 1.0, 0.1, 0.1), inputs=0.01)
    QuadraticReward(misses=(1.0, 1.0, 0.1, 0.1), inputs=0.01)
    """

    misses: Float[Array, "..."] = eqx.field(converter=lambda x: _weights("misses", x), default=1.0)
    inputs: Float[Array, "..."] = eqx.field(converter=lambda x: _weights("inputs", x), default=0.0)

    def __call__(self, misses, moment):
        return -jnp.sum(_for(self.misses, misses) * misses**2) - jnp.sum(_for(self.inputs, moment.u) * moment.u**2)


def _weights(name: str, weights: Numbers) -> Float[Array, "..."]:
    array = to_array(weights, name)
    if array.ndim > 1:
        raise ValueError(f"Argument `{name}` must be a number or a row of numbers, but its shape is {array.shape}.")
    return array


def _for(weights: Float[Array, "..."], values: Float[Array, " k"]) -> Float[Array, " k"]:
    return jnp.broadcast_to(weights, values.shape)
