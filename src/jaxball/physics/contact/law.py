"""The law of the contact between a body and its ground: Coulomb's friction and Newton's restitution."""

import abc
from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...interface.printing import Printed
from ...numerics.arrays import Numbers, is_traced, namespace_of, numbers
from ..conditions import Condition, positive

SLOWEST_REBOUND = 1e-6
DEFAULT_ROOM = 64
COEFFICIENTS: tuple[str, ...] = ("sliding", "static", "restitution", "slowest")


class AbstractFriction(Printed):
    """The coefficient of sliding friction as a function of the slip speed, instead of one number.

    Friction is −μ(v) N v_s/|v_s| with v = |v_s|, so that it has the direction of Coulomb's law and is proportional to
    the normal force. An implementer supplies ``__call__``, which is traced: it is written with ``jax.numpy``, for one
    speed. It must be smooth for v ≥ 0 and not negative, or friction would do work on the body. Static friction is the
    coefficient ``static`` of the :class:`~jaxball.Contact`, μ(0) if that is not given.
    """

    @abc.abstractmethod
    def __call__(self, speed: Float[Array, ""]) -> Float[Array, ""]:
        """μ(v), dimensionless.

        **Arguments:**

        - ``speed``: v, 0 or positive, length/time.
        """

    def conditions(self) -> Iterator[Condition]:
        """Every condition that its numbers must meet, named ``contact.…``; traceable."""
        yield from ()


class SmoothedCoulomb(AbstractFriction):
    """Coulomb's friction, smoothed where the slip is slow: μ(v) = kinetic v / (v + smoothing).

    It fades with the slip, so that its direction is of no importance where the slip vanishes. No slip ends in a finite
    time, and static friction is 0: the body never rolls exactly. Where rolling would need the share s < 1 of the
    friction ``kinetic`` N, the lowest point creeps at v = smoothing s / (1 − s).

    **Arguments:**

    - ``kinetic``: the friction coefficient of a fast slip, dimensionless, 0 or positive.
    - ``smoothing``: the slip speed at which friction is half as large, length/time, positive, far below the speeds of
      interest; the smaller, the stiffer the equations.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Contact, SmoothedCoulomb
    >>> float(Contact(SmoothedCoulomb(kinetic=0.25, smoothing=0.5)).coefficient(jnp.array(2.0)))
    0.2
    """

    kinetic: Float[Array, "*batch"] = eqx.field(converter=numbers("kinetic"))
    smoothing: Float[Array, "*batch"] = eqx.field(converter=numbers("smoothing"))

    def __call__(self, speed: Float[Array, ""]) -> Float[Array, "*batch"]:
        """μ(v)."""
        return self.kinetic * speed / (speed + self.smoothing)

    def conditions(self) -> Iterator[Condition]:
        """What its numbers must be; traceable."""
        finite = namespace_of(self.kinetic).isfinite
        holds = (self.kinetic >= 0) & finite(self.kinetic)
        yield Condition(holds, "contact.sliding.kinetic", self.kinetic, "0 or positive")
        yield Condition(positive(self.smoothing), "contact.sliding.smoothing", self.smoothing, "a positive number")


class Contact(Printed):
    """What happens when rolling ends: how large friction can be, and how an impact rebounds.

    Friction up to |f| = ``static`` N holds a body that does not slip. On a body that slips with v_s, friction is
    −``sliding`` N v_s/|v_s|. A body that lands on the ground rebounds with −``restitution`` times its normal velocity,
    with sliding friction during the impact.

    **Arguments:**

    - ``sliding``: the kinetic friction coefficient μ, dimensionless; 0 for a smooth ground. An
      :class:`~jaxball.AbstractFriction` makes it a function of the slip speed, except that it is constant during an
      impact; ``sliding`` is then its value for speed 0.
    - ``static``: the static friction coefficient μ_s; ``sliding`` if not given.
    - ``restitution``: Newton's e, from 0 to 1.
    - ``slowest``: a rebound slower than this times √(g r) is treated as none, because bounces get shorter and shorter,
      and infinitely many of them end in a finite time (Zeno). Without gravity, g is the acceleration by which other
      forces press the body on.
    - ``room``: how many switches of the mode are kept; all are counted.
    - ``friction``: the function in the place of ``sliding``, as ``dataclasses.replace`` passes it on.

    **Raises:** ``ValueError`` for impossible coefficients.

    **Example:**

    >>> from jaxball import Contact
    >>> Contact(sliding=0.2, restitution=0.5)
    Contact(sliding=0.2, static=0.2, restitution=0.5, slowest=1e-06, room=64)
    """

    sliding: Float[Array, "*batch"]
    static: Float[Array, "*batch"]
    restitution: Float[Array, "*batch"]
    slowest: Float[Array, "*batch"]
    room: int = eqx.field(static=True)
    friction: AbstractFriction | None = None

    def __init__(
        self,
        sliding: Numbers | AbstractFriction,
        static: Numbers | None = None,
        restitution: Numbers = 0.0,
        slowest: Numbers = SLOWEST_REBOUND,
        room: int = DEFAULT_ROOM,
        friction: AbstractFriction | None = None,
    ):
        if isinstance(sliding, AbstractFriction):
            friction = sliding
        self.friction = friction
        least: Any = sliding if friction is None else friction(jnp.zeros(()))
        self.sliding = numbers("sliding")(least)
        self.static = self.sliding if static is None else numbers("static")(static)
        self.restitution = numbers("restitution")(restitution)
        self.slowest = numbers("slowest")(slowest)
        self.room = room
        if room < 1:
            raise ValueError(f"Argument `room` must be 1 or more, but it is {room}.")
        if not any(map(is_traced, jax.tree.leaves(self))):
            known = jax.tree.map(np.asarray, self)  # NumPy checks its conditions, without compiling anything
            for condition in known.conditions():
                for problem in condition.problems():
                    raise ValueError(problem.sentence(name=problem.name.removeprefix("contact.")))

    def conditions(self) -> Iterator[Condition]:
        """What the coefficients must be; traceable."""
        if self.friction is not None:  # first, because what it makes of impossible numbers says nothing
            yield from self.friction.conditions()
        finite = namespace_of(self.sliding).isfinite
        must = "0 or positive"
        yield Condition((self.sliding >= 0) & finite(self.sliding), "contact.sliding", self.sliding, must)
        must = "no less than the coefficient `sliding`, because friction cannot be larger on a body that slips"
        yield Condition((self.static >= self.sliding) & finite(self.static), "contact.static", self.static, must)
        holds = (self.restitution >= 0) & (self.restitution <= 1)
        yield Condition(holds, "contact.restitution", self.restitution, "from 0 to 1, or impacts would create energy")
        holds = (self.slowest > 0) & finite(self.slowest)
        yield Condition(holds, "contact.slowest", self.slowest, "a positive number, or bounces would never end")

    def coefficient(self, speed: Float[Array, ""]) -> Float[Array, ""]:
        """The kinetic friction coefficient for a slip speed, length/time."""
        return self.sliding if self.friction is None else self.friction(speed)

    @property
    def law_of_sliding(self) -> Any:
        """What was given as ``sliding``: the coefficient, or the friction that has it."""
        return self.sliding if self.friction is None else self.friction
