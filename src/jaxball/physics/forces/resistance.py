"""Resistance to rolling: viscous and dry rolling friction, spinning friction, and the drag of the medium."""

import abc
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.arguments import require_flags, whole_number
from ...interface.printing import Printed
from ...numerics.declare import FINITE, FROM_0, OF_DRAG, OF_ROTATIONAL_DRAG, POSITIVE, RATE, number, number_or_none
from ...numerics.vectors import dot
from ..conditions import Condition, on_numbers, positive

SMOOTHING = 1e-3  # of dry friction by default, rad/time


class AbstractResistance(Printed):
    """What resists the turning and the motion of a body: at its contact with the plane, and from the medium.

    An implementer supplies ``contact_torque``. Everything else has a default, to be overridden where it does not fit:

    - ``medium``: a force at the geometric centre and a torque, which act in flight, too;
    - ``rolling_level`` and ``spinning_level``: the dry torques that oppose rolling and spinning, over N r, at a rate.
      Where one is given, dry friction is exact: it stops the body, and holds it at rest with up to
      ``static_rolling_level`` and ``static_spinning_level``, which are the levels at the rate 0 unless overridden;
    - ``dry_torque``: the part of the contact torque that is proportional to the normal force, over that force. It
      follows from the levels; overridden without them, it is another law, of a body that is never held;
    - ``conditions``: what its numbers must be, so that an impossible run has a sentence that says why.

    Methods are traced: they are written with ``jax.numpy``, in body axes, for one moment without a batch. What they
    return enters accelerations, contact forces, the dissipation and all laws that are checked. A torque that does not
    vanish with the slowest motion can set a body in motion, so make it smooth at rest.
    """

    @abc.abstractmethod
    def contact_torque(self, Omega: Float[Array, "3"], Gamma: Float[Array, "3"]) -> Float[Array, "3"]:
        """Computes T at the contact without its dry part, body axes, mass length²/time², shape (3,).

        **Arguments:**

        - ``Omega``: Ω relative to the matter of the ground, which turns on a turntable; body axes, rad/time, shape
          (3,).
        - ``Gamma``: Γ, the unit vector up, or the normal of a curved ground, body axes, shape (3,).
        """

    def medium(self, velocity: Float[Array, "3"], Omega: Float[Array, "3"]) -> tuple[Float[Array, "3"], ...] | None:
        """Computes the force at the geometric centre and the torque, each in body axes, of shape (3,); None where there
        is none.

        **Arguments:**

        - ``velocity``: of the geometric centre relative to the plane, body axes, length/time, shape (3,).
        - ``Omega``: Ω, body axes, rad/time, shape (3,).
        """
        return None

    def rolling_level(self, rate: Float[Array, ""]) -> Float[Array, "*group"] | None:
        """Computes the level of dry friction against rolling, dimensionless: its torque over N r, positive. None where
        there is none, at all rates.

        It may fall or rise with the rate, smoothly: a step that goes on a little beyond the end of rolling looks at
        rates just below 0.

        **Arguments:**

        - ``rate``: |ω_h|, of ω along the ground and relative to it, rad/time, shape ().
        """
        return None

    def spinning_level(self, rate: Float[Array, ""]) -> Float[Array, "*group"] | None:
        """Computes the level of dry friction against spinning, as :meth:`rolling_level`, at the rate |ω₃|."""
        return None

    @property
    def static_rolling_level(self) -> Float[Array, "*group"] | None:
        """The largest level that holds a body against rolling, dimensionless, no less than that of the rate 0."""
        return self.rolling_level(jnp.zeros(()))

    @property
    def static_spinning_level(self) -> Float[Array, "*group"] | None:
        """The largest level that holds a body against spinning, as ``static_rolling_level``."""
        return self.spinning_level(jnp.zeros(()))

    def dry_torque(
        self, r: Float[Array, ""], Omega: Float[Array, "3"], Gamma: Float[Array, "3"]
    ) -> Float[Array, "3"] | None:
        """Computes the dry torque over N of a body in motion, body axes, a length, shape (3,); None where no part is
        proportional to N.

        **Arguments:**

        - ``r``: the radius, a length.
        - ``Omega``, ``Gamma``: as for :meth:`contact_torque`.
        """
        if not self.has_levels:
            return None
        spin = dot(Omega, Gamma)
        rolling, torque = Omega - spin * Gamma, jnp.zeros_like(Omega)
        rates = self._size(dot(rolling, rolling)), self._size(spin**2)
        levels = Levels.at(self, rates[0].level_at, rates[1].level_at)
        if levels.rolling is not None:
            torque = torque - levels.rolling * r * rolling / rates[0].divisor
        if levels.spinning is not None:
            torque = torque - levels.spinning * r * spin * Gamma / rates[1].divisor
        return torque

    def _size(self, square: Float[Array, ""]) -> "_Size":
        """Computes the size of a rate from its square, as dry friction has it."""
        moves = square > 0
        divisor = jnp.sqrt(jnp.where(moves, square, 1.0))
        return _Size(divisor, jnp.where(moves, divisor, 0.0))

    @property
    def has_levels(self) -> bool:
        """Whether there is a level of friction against rolling or spinning."""
        zero = jnp.zeros(())
        levels = jax.eval_shape(lambda rate: (self.rolling_level(rate), self.spinning_level(rate)), zero)
        return any(level is not None for level in levels)

    @property
    def is_dry(self) -> bool:
        """Whether there is a dry torque."""
        return type(self).dry_torque is not AbstractResistance.dry_torque or self.has_levels

    @property
    def holds(self) -> bool:
        """Whether dry friction is exact, so that it may hold a body at rest: where there are levels."""
        return self.has_levels

    def conditions(self) -> Iterator[Condition]:
        """Yields every condition that its numbers must meet, named ``resistance.…``; traceable."""
        yield from on_numbers(self, "resistance.")
        if not self.holds:
            return
        kinetic, static = Levels.at(self, jnp.zeros(()), jnp.zeros(())), Levels.at_rest(self)
        for name, level, largest in zip(("rolling_level", "spinning_level"), kinetic, static, strict=True):
            if level is not None and largest is not None:
                must = "a positive number at the rate 0, as it may hold the body"
                yield Condition(positive(level), f"resistance.{name}", level, must)
                holds, must = (largest >= level).all(), f"no less than `{name}` at the rate 0"
                yield Condition(holds, f"resistance.static_{name}", largest, must)


class _Size(NamedTuple):
    """The size of a rate: what it is divided by for its direction, positive at rest, too, and where its level is."""

    divisor: Float[Array, ""]
    level_at: Float[Array, ""]


class Levels(NamedTuple):
    """The levels of dry friction against rolling and spinning, torques over N r; None for what is not resisted."""

    rolling: Float[Array, ""] | None
    spinning: Float[Array, ""] | None

    @classmethod
    def at(cls, resistance: AbstractResistance, rolling: Float[Array, ""], spinning: Float[Array, ""]) -> "Levels":
        """Returns those of a body that rolls and spins at these rates."""
        return cls(resistance.rolling_level(rolling), resistance.spinning_level(spinning))

    @classmethod
    def at_rest(cls, resistance: AbstractResistance) -> "Levels":
        """Returns the largest ones that hold a body."""
        return cls(resistance.static_rolling_level, resistance.static_spinning_level)


class Resistance(AbstractResistance):
    """Torques at the contact, and the drag of a medium that is at rest relative to the plane.

    With ω relative to the matter of the ground, so that ω₃ is less by the rate of a turntable, and its part ω_h along
    the plane,

    - at the contact T = −rolling ω_h − spinning ω₃ e3 − N dry r ω_h / √(ω_h² + smoothing²) and
      −N dry_spinning r ω₃ / √(ω₃² + smoothing²);
    - from the medium, the force −drag ż at the geometric centre and the torque −rotational_drag ω.

    Dry friction is proportional to the normal force N, which it changes in turn; both are solved for together. Being
    smoothed, it cannot hold a body at rest: on a slope whose tangent is s times ``dry``, with s < 1, the body creeps at
    ω = smoothing s / √(1 − s²).

    With ``exact``, smoothing is 0: the dry torques are −N dry r ω_h / |ω_h| and −N dry_spinning r sign ω₃. Where ω_h
    falls to 0 the body rests, exactly: its centre stays, ω̇_h = 0, with the torque that this needs, until that exceeds
    N static_dry r; where ω₃ falls to 0, likewise. So a body with it is a hybrid system, and ``trajectory.switches``
    says when it comes to rest and breaks loose.

    With ``stribeck``, friction falls from the static to the kinetic level as the rate grows, as that of a
    :class:`~jaxball.JointFriction`: in place of ``dry`` is dry + (static_dry − dry) exp(−(|ω_h| / stribeck)^exponent),
    and likewise against spinning. Without it, it falls at once as the body breaks loose. For other functions of the
    rate, override ``rolling_level`` and ``spinning_level``.

    **Arguments:**

    - ``rolling``: the coefficient of viscous rolling friction, mass length²/time.
    - ``spinning``: the coefficient of viscous friction against spinning about the vertical, mass length²/time.
    - ``drag``: the coefficient of the drag of the medium, mass/time.
    - ``rotational_drag``: the coefficient of the rotational drag of the medium, mass length²/time.
    - ``dry``: the kinetic coefficient of rolling friction, a length over the radius; none if not given. Without dry
      friction it is cheapest.
    - ``smoothing``: the rate below which dry friction fades, rad/time. It is far below the rates of interest; the
      smaller, the stiffer the equations.
    - ``negative``: whether coefficients may be negative, and so supply energy.
    - ``dry_spinning``: the kinetic coefficient of dry friction against spinning, a length over the radius; none if not
      given. A disk, which does not spin, does not feel it.
    - ``exact``: whether dry friction stops a body and holds it at rest. ``dry`` and ``dry_spinning`` are then positive,
      and ``smoothing`` is not used.
    - ``static_dry``: the coefficient that holds a body at rest if friction is ``exact``, ``dry`` or more; ``dry`` if
      not given.
    - ``static_dry_spinning``: the coefficient that holds a body against spinning, likewise; ``dry_spinning`` if not
      given.
    - ``stribeck``: the rate at which most of the difference between static and kinetic friction is gone, rad/time.
    - ``exponent``: the exponent of the Stribeck effect, 1 for Tustin's law, 2 for a Gaussian.

    **Raises:** ``TypeError`` or ``ValueError`` for what belongs to an argument that is not given: ``exact`` without
    ``dry`` and ``dry_spinning``, static coefficients without ``exact`` or without the kinetic one, ``stribeck`` without
    a static coefficient; and for an exponent that is not a positive whole number.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Ball, BallState, Resistance, simulate
    >>> slowed = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), resistance=Resistance(rolling=0.14))
    >>> run = simulate(slowed, jnp.array([0.0, 10.0]), BallState(Omega=(0.0, 1.0, 0.0)))
    >>> round(float(run.state.Omega[-1, 1]), 6)  # exp(−0.14 t / (0.4 + m r²))
    0.367879
    """

    rolling: Float[Array, "*group"] = eqx.field(converter=number(OF_ROTATIONAL_DRAG), default=0.0)
    spinning: Float[Array, "*group"] = eqx.field(converter=number(OF_ROTATIONAL_DRAG), default=0.0)
    drag: Float[Array, "*group"] = eqx.field(converter=number(OF_DRAG), default=0.0)
    rotational_drag: Float[Array, "*group"] = eqx.field(converter=number(OF_ROTATIONAL_DRAG), default=0.0)
    dry: Float[Array, "*group"] | None = eqx.field(converter=number_or_none(), default=None)
    smoothing: Float[Array, "*group"] = eqx.field(converter=number(RATE, POSITIVE), default=SMOOTHING)
    negative: bool = eqx.field(static=True, default=False)
    dry_spinning: Float[Array, "*group"] | None = eqx.field(converter=number_or_none(), default=None)
    exact: bool = eqx.field(static=True, default=False)
    static_dry: Float[Array, "*group"] | None = eqx.field(converter=number_or_none(), default=None)
    static_dry_spinning: Float[Array, "*group"] | None = eqx.field(converter=number_or_none(), default=None)
    stribeck: Float[Array, "*group"] | None = eqx.field(converter=number_or_none(RATE, POSITIVE), default=None)
    exponent: int = eqx.field(static=True, default=2)

    def __check_init__(self):
        require_flags(negative=self.negative, exact=self.exact)
        whole_number("exponent", self.exponent, 1)
        problem = find_contradiction(vars(self), lambda name: name)
        if problem is not None:
            raise ValueError(f"Argument {problem}")

    def conditions(self) -> Iterator[Condition]:
        """Yields the conditions on the coefficients; traceable."""
        for name in ("rolling", "spinning", "drag", "rotational_drag", "dry", "dry_spinning"):
            value = getattr(self, name)
            if value is not None and self.exact and name.startswith("dry"):
                yield Condition(positive(value), f"resistance.{name}", value, "a positive number, as it is `exact`")
                static = getattr(self, f"static_{name}")
                if static is not None:
                    holds = positive(static) & (static >= value).all()
                    must = f"a positive number, not less than `{name}`"
                    yield Condition(holds, f"resistance.static_{name}", static, must)
            elif value is not None:
                rule = FINITE if self.negative else FROM_0
                must = "a finite number" if self.negative else "0 or positive, unless `negative` allows it"
                yield Condition(rule.holds(value), f"resistance.{name}", value, must)
        yield from on_numbers(self, "resistance.")

    @property
    def has_levels(self) -> bool:
        return self.dry is not None or self.dry_spinning is not None

    @property
    def holds(self) -> bool:
        return self.exact

    def rolling_level(self, rate: Float[Array, ""]) -> Float[Array, "*group"] | None:
        return self._level(self.dry, self.static_dry, rate)

    def spinning_level(self, rate: Float[Array, ""]) -> Float[Array, "*group"] | None:
        return self._level(self.dry_spinning, self.static_dry_spinning, rate)

    @property
    def static_rolling_level(self) -> Float[Array, "*group"] | None:
        return super().static_rolling_level if self.static_dry is None else self.static_dry

    @property
    def static_spinning_level(self) -> Float[Array, "*group"] | None:
        return super().static_spinning_level if self.static_dry_spinning is None else self.static_dry_spinning

    def _level(
        self, kinetic: Float[Array, "*group"] | None, static: Float[Array, "*group"] | None, rate: Float[Array, ""]
    ) -> Float[Array, "*group"] | None:
        if kinetic is None or static is None or self.stribeck is None:
            return kinetic
        return kinetic + (static - kinetic) * jnp.exp(-((rate / self.stribeck) ** self.exponent))

    def medium(self, velocity: Float[Array, "3"], Omega: Float[Array, "3"]) -> tuple[Float[Array, "3"], ...] | None:
        """Computes −drag ż and −rotational_drag ω, body axes."""
        return -self.drag * velocity, -self.rotational_drag * Omega

    def contact_torque(self, Omega: Float[Array, "3"], Gamma: Float[Array, "3"]) -> Float[Array, "3"]:
        """Computes the viscous part of T at the contact, body axes."""
        spin = dot(Omega, Gamma)
        return -self.rolling * (Omega - spin * Gamma) - self.spinning * spin * Gamma

    def _size(self, square: Float[Array, ""]) -> _Size:
        if self.exact:
            return super()._size(square)
        smoothed = jnp.sqrt(square + self.smoothing**2)
        return _Size(smoothed, smoothed)


def find_contradiction(values: Mapping[str, Any], named: Callable[[str], str]) -> str | None:
    """Finds the first argument of a :class:`Resistance` that the others exclude; returns the sentence about it from its
    name on.

    - ``named``: the name that is shown of an argument.
    """
    given = {name for name, value in values.items() if value is not None and value is not False}
    if "exact" in given and not given & {"dry", "dry_spinning"}:
        return (
            f"`{named('exact')}` must be left out where there is no dry friction, but it is set; give "
            f"`{named('dry')}` or `{named('dry_spinning')}`."
        )
    for name in ("static_dry", "static_dry_spinning"):
        kinetic = name.removeprefix("static_")
        if name in given and kinetic not in given:
            return f"`{named(name)}` must be left out without `{named(kinetic)}`, the level in motion; give both."
        if name in given and "exact" not in given:
            return (
                f"`{named(name)}` must be left out where dry friction is smoothed, which cannot hold a body at rest; "
                f"set `{named('exact')}`."
            )
    if "stribeck" in given and not given & {"static_dry", "static_dry_spinning"}:
        return (
            f"`{named('stribeck')}` must be left out where friction at rest is that in motion; give "
            f"`{named('static_dry')}` or `{named('static_dry_spinning')}`."
        )
    return None
