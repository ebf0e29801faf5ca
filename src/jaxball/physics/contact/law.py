"""The law of the contact between a body and its ground: Coulomb's friction and Newton's restitution."""

import abc
from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...interface.arguments import refusal
from ...interface.compat import is_traced
from ...interface.printing import Printed
from ...numerics.arrays import Numbers, namespace_of, numbers
from ...numerics.declare import BETWEEN_0_AND_1, FROM_0, LENGTH, POSITIVE, VELOCITY, number
from ..conditions import Condition, on_numbers

SLOWEST_REBOUND = 1e-6
DEFAULT_CAPACITY = 64
COEFFICIENTS: tuple[str, ...] = ("friction", "static_friction", "restitution", "slowest")
_LOSING_ENERGY = BETWEEN_0_AND_1._replace(phrase="from 0 to 1, or impacts would create energy")
_ENDING_BOUNCES = POSITIVE._replace(phrase="a positive number, or bounces would never end")


class AbstractFriction(Printed):
    """The coefficient of sliding friction as a function of the slip speed, instead of one number.

    Friction is −μ(v) N v_s/|v_s| with v = |v_s|, so that it has the direction of Coulomb's law and is proportional to
    the normal force. An implementer supplies ``__call__``, which is traced: it is written with ``jax.numpy``, for one
    speed. It must be smooth for v ≥ 0 and not negative, or friction would do work on the body. Static friction is the
    coefficient ``static_friction`` of the :class:`~jaxball.Contact`, μ(0) if that is not given.
    """

    @abc.abstractmethod
    def __call__(self, speed: Float[Array, ""]) -> Float[Array, ""]:
        """Computes μ(v), dimensionless.

        **Arguments:**

        - ``speed``: v, 0 or positive, length/time.
        """

    def conditions(self) -> Iterator[Condition]:
        """Yields every condition that its numbers must meet, named ``contact.…``; traceable."""
        yield from on_numbers(self, "contact.friction.")


class SmoothedCoulomb(AbstractFriction):
    """Coulomb's friction, smoothed where the slip is slow: μ(v) = kinetic v / (v + smoothing).

    It fades with the slip, so that its direction is of no importance where the slip vanishes. No slip ends in a finite
    time, and static friction is 0: the body never rolls exactly. Where rolling would need the share s < 1 of the
    friction ``kinetic`` N, the lowest point creeps at v = smoothing s / (1 − s).

    **Arguments:**

    - ``kinetic``: the friction coefficient of a fast slip, dimensionless, 0 or positive.
    - ``smoothing``: the slip speed at which friction is half as large, length/time, positive. It is far below the
      speeds of interest; the smaller, the stiffer the equations.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Contact
    >>> from jaxball.physics import SmoothedCoulomb
    >>> float(Contact(SmoothedCoulomb(kinetic=0.25, smoothing=0.5)).coefficient(jnp.array(2.0)))
    0.2
    """

    kinetic: Float[Array, "*group"] = eqx.field(converter=number(rule=FROM_0))
    smoothing: Float[Array, "*group"] = eqx.field(converter=number(VELOCITY, POSITIVE))

    def __call__(self, speed: Float[Array, ""]) -> Float[Array, "*batch"]:
        """Computes μ(v)."""
        return self.kinetic * speed / (speed + self.smoothing)


class LimitSurface(AbstractFriction):
    """Coupled friction of slip and spin: an ellipsoid limits the friction force f and the torque m₃ about the normal.

    The ground touches a small patch about the contact point, over which friction resists spinning as well as slip. With
    the slide s = (v_s, ρ ω₃), of the slip velocity v_s and the spin ω₃ over the ground, that is

    - where s is not 0, f = −μ N v_s/|s| and m₃ = −μ N ρ² ω₃/|s|: spinning lessens friction against slip, and slip that
      against spinning, so that a ball that spins slides further;
    - where s is 0, friction holds both as long as |f|² + (m₃/ρ)² ≤ (μ_s N)², with the ``static_friction`` of the
      :class:`~jaxball.Contact`.

    The energy that it dissipates is μ N |s| in a unit of time. A body that spins slides, even if its v_s is 0: what
    friction it then needs makes it creep, at v_s = ρ |ω₃| |f| / √((μN)² − |f|²). A disk, which does not spin, has
    Coulomb's law. In an impact friction is Coulomb's, without a torque.

    The source is S. Goyal, A. Ruina, J. Papadopoulos, Planar sliding with dry friction, Wear 143 (1991) 307–330; the
    ellipsoid approximates what P. Contensou (1963) found for a patch with a given pressure.

    **Arguments:**

    - ``friction``: the kinetic coefficient μ of slip without spin, dimensionless, positive.
    - ``radius``: ρ, the largest torque against the spin over the largest force, length, positive. For a uniform
      pressure on a circle it is 2/3 of the radius of that.

    **Example:**

    >>> from jaxball import Contact
    >>> from jaxball.physics import LimitSurface
    >>> Contact(LimitSurface(friction=0.3, radius=0.05)).friction_or_law
    LimitSurface(friction=0.3, radius=0.05)
    """

    friction: Float[Array, "*group"] = eqx.field(converter=number(rule=POSITIVE))
    radius: Float[Array, "*group"] = eqx.field(converter=number(LENGTH, POSITIVE))

    def __call__(self, speed: Float[Array, ""]) -> Float[Array, "*batch"]:
        """Returns μ, which does not depend on the speed."""
        return self.friction


class Contact(Printed):
    """What happens when rolling ends: how large friction can be, and how an impact rebounds.

    Friction up to |f| = ``static_friction`` N holds a body that does not slip. On a body that slips with v_s, friction
    is −``friction`` N v_s/|v_s|. A body that lands on the ground rebounds with −``restitution`` times its normal
    velocity, with sliding friction during the impact.

    **Arguments:**

    - ``friction``: the kinetic friction coefficient μ, dimensionless; 0 for a smooth ground. An
      :class:`~jaxball.physics.AbstractFriction` makes it a function of the slip speed, except that it is constant
      during an impact; ``friction`` is then its value for speed 0.
    - ``static_friction``: the static friction coefficient μ_s; ``friction`` if not given.
    - ``restitution``: Newton's coefficient of restitution e, from 0 to 1.
    - ``slowest``: a rebound slower than this times √(g r) is treated as none; without gravity, g is the acceleration by
      which other forces press the body on. Bounces get shorter and shorter, and infinitely many of them end in a finite
      time (Zeno). So do strikes of a joint on its stop that each lift the body: a slower rise is treated as none, too.
    - ``capacity``: how many switches of the mode are kept; all are counted.
    - ``friction_law``: the function in the place of ``friction``, as ``dataclasses.replace`` passes it on.

    **Raises:** ``ValueError`` for impossible coefficients.

    **Example:**

    >>> from jaxball import Contact
    >>> Contact(friction=0.2, restitution=0.5)
    Contact(friction=0.2, static_friction=0.2, restitution=0.5, slowest=1e-06, capacity=64)
    """

    friction: Float[Array, "*batch"]
    static_friction: Float[Array, "*batch"]
    restitution: Float[Array, "*group"] = eqx.field(converter=number(rule=_LOSING_ENERGY))
    slowest: Float[Array, "*group"] = eqx.field(converter=number(rule=_ENDING_BOUNCES))
    capacity: int = eqx.field(static=True)
    friction_law: AbstractFriction | None = None

    def __init__(
        self,
        friction: Numbers | AbstractFriction,
        static_friction: Numbers | None = None,
        restitution: Numbers = 0.0,
        slowest: Numbers = SLOWEST_REBOUND,
        capacity: int = DEFAULT_CAPACITY,
        friction_law: AbstractFriction | None = None,
    ):
        if isinstance(friction, AbstractFriction):
            friction_law = friction
        elif callable(friction):
            remedy = (
                "" if isinstance(friction, type) else "a function of the slip speed is a subclass of AbstractFriction"
            )
            must = "a coefficient, or a law of friction such as SmoothedCoulomb(0.3, 0.01)"
            raise refusal("friction", must, friction, remedy)
        self.friction_law = friction_law
        # Whether a slip ends, and static friction by default, depend on μ(0) alone.
        at_rest: Any = friction if friction_law is None else friction_law(jnp.zeros(()))
        self.friction = numbers("friction")(at_rest)
        self.static_friction = self.friction if static_friction is None else numbers("static_friction")(static_friction)
        given: Any = restitution, slowest  # their fields convert them
        self.restitution, self.slowest = given
        self.capacity = capacity

    def __check_init__(self):
        if self.capacity < 1:
            raise ValueError(f"Argument `capacity` must be 1 or more, but it is {self.capacity}.")
        if not any(map(is_traced, jax.tree.leaves(self))):
            law = jax.tree.map(np.asarray, self)  # NumPy checks its conditions, without compiling anything
            for condition in law.conditions():
                for problem in condition.problems():
                    raise ValueError(problem.sentence(name=problem.name.removeprefix("contact.")))

    def conditions(self) -> Iterator[Condition]:
        """Yields the conditions on the coefficients; traceable."""
        if self.friction_law is not None:  # first, because what it makes of impossible numbers says nothing
            yield from self.friction_law.conditions()
        yield Condition(FROM_0.holds(self.friction), "contact.friction", self.friction, FROM_0.phrase)
        static = self.static_friction
        holds = (static >= self.friction) & namespace_of(static).isfinite(static)
        must = "no less than the coefficient `friction`, because friction cannot be larger on a body that slips"
        yield Condition(holds, "contact.static_friction", static, must)
        yield from on_numbers(self, "contact.")

    def coefficient(self, speed: Float[Array, ""]) -> Float[Array, ""]:
        """Returns the kinetic friction coefficient for a slip speed, length/time."""
        return self.friction if self.friction_law is None else self.friction_law(speed)

    @property
    def limit_radius(self) -> Float[Array, "*batch"] | None:
        """The radius ρ of a :class:`LimitSurface`; None if friction is another."""
        return self.friction_law.radius if isinstance(self.friction_law, LimitSurface) else None

    @property
    def friction_or_law(self) -> Any:
        """What was given as ``friction``: the coefficient, or the friction that has it."""
        return self.friction if self.friction_law is None else self.friction_law
