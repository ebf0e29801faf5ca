"""Resistance to rolling: viscous and dry rolling friction, spinning friction, and the drag of the medium."""

import abc
from collections.abc import Iterator

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.arguments import require_flags
from ...interface.printing import Printed
from ...numerics.declare import FINITE, FROM_0, OF_DRAG, OF_ROTATIONAL_DRAG, POSITIVE, RATE, number, number_or_none
from ...numerics.vectors import dot
from ..conditions import Condition, on_numbers, positive

SMOOTHING = 1e-3  # of dry friction by default, rad/time


class AbstractResistance(Printed):
    """What resists the turning and the motion of a body: at its contact with the plane, and from the medium.

    An implementer supplies ``contact_torque``. Everything else has a default, to be overridden where it does not fit:

    - ``medium``: a force at the geometric centre and a torque, which act in flight, too;
    - ``dry_torque``: the part of the contact torque that is proportional to the normal force, over that force;
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

    def dry_torque(
        self, r: Float[Array, ""], Omega: Float[Array, "3"], Gamma: Float[Array, "3"]
    ) -> Float[Array, "3"] | None:
        """Computes the dry torque over N, body axes, a length, shape (3,); None where no part is proportional to N.

        **Arguments:**

        - ``r``: the radius, a length.
        - ``Omega``, ``Gamma``: as for :meth:`contact_torque`.
        """
        return None

    @property
    def is_dry(self) -> bool:
        """Whether there is a dry torque."""
        return type(self).dry_torque is not AbstractResistance.dry_torque

    @property
    def holds(self) -> bool:
        """Whether dry friction is exact, so that it may hold a body at rest."""
        return False

    def conditions(self) -> Iterator[Condition]:
        """Yields every condition that its numbers must meet, named ``resistance.…``; traceable."""
        yield from on_numbers(self, "resistance.")


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
    N dry r; where ω₃ falls to 0, likewise. So a body with it is a hybrid system, and ``trajectory.switches`` says when
    it comes to rest and breaks loose.

    **Arguments:**

    - ``rolling``, ``spinning``: of viscous friction at the contact, mass length²/time.
    - ``drag``: of the medium, mass/time.
    - ``rotational_drag``: of the medium, mass length²/time.
    - ``dry``: the coefficient of rolling friction, a length over the radius; None for no dry friction, which is
      cheapest.
    - ``smoothing``: rad/time, far below the rates of interest; the smaller, the stiffer the equations.
    - ``negative``: whether coefficients may be negative, and so supply energy.
    - ``dry_spinning``: the coefficient of dry friction against spinning, a length over the radius; None for none. A
      disk, which does not spin, does not feel it.
    - ``exact``: whether dry friction stops a body and holds it at rest; ``dry`` and ``dry_spinning`` are then positive,
      and ``smoothing`` is not used.

    **Raises:** ``ValueError`` for ``exact`` without ``dry`` and ``dry_spinning``.

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

    def __check_init__(self):
        require_flags(negative=self.negative, exact=self.exact)
        if self.exact and self.dry is None and self.dry_spinning is None:
            raise ValueError(
                "Argument `exact` must be False where there is no dry friction, but it is True; give `dry` or "
                "`dry_spinning`."
            )

    def conditions(self) -> Iterator[Condition]:
        """Yields the conditions on the coefficients; traceable."""
        for name in ("rolling", "spinning", "drag", "rotational_drag", "dry", "dry_spinning"):
            value = getattr(self, name)
            if value is not None and self.exact and name.startswith("dry"):
                yield Condition(positive(value), f"resistance.{name}", value, "a positive number, as it is `exact`")
            elif value is not None:
                rule = FINITE if self.negative else FROM_0
                must = "a finite number" if self.negative else "0 or positive, unless `negative` allows it"
                yield Condition(rule.holds(value), f"resistance.{name}", value, must)
        yield from super().conditions()

    @property
    def is_dry(self) -> bool:
        has_coefficient = self.dry is not None or self.dry_spinning is not None
        return has_coefficient or type(self).dry_torque is not Resistance.dry_torque

    @property
    def holds(self) -> bool:
        return self.exact

    def medium(self, velocity: Float[Array, "3"], Omega: Float[Array, "3"]) -> tuple[Float[Array, "3"], ...] | None:
        """Computes −drag ż and −rotational_drag ω, body axes."""
        return -self.drag * velocity, -self.rotational_drag * Omega

    def contact_torque(self, Omega: Float[Array, "3"], Gamma: Float[Array, "3"]) -> Float[Array, "3"]:
        """Computes the viscous part of T at the contact, body axes."""
        spin = dot(Omega, Gamma)
        return -self.rolling * (Omega - spin * Gamma) - self.spinning * spin * Gamma

    def dry_torque(
        self, r: Float[Array, ""], Omega: Float[Array, "3"], Gamma: Float[Array, "3"]
    ) -> Float[Array, "3"] | None:
        """Computes the dry torque over N, body axes; None without dry friction. If that is exact, of a body
        in motion.
        """
        if self.dry is None and self.dry_spinning is None:
            return None
        spin = dot(Omega, Gamma)
        rolling, torque = Omega - spin * Gamma, jnp.zeros_like(Omega)
        if self.dry is not None:
            torque = torque - self.dry * r * rolling / self._size(dot(rolling, rolling))
        if self.dry_spinning is not None:
            torque = torque - self.dry_spinning * r * spin * Gamma / self._size(spin**2)
        return torque

    def _size(self, square: Float[Array, ""]) -> Float[Array, ""]:
        """Computes the size of a rate as dry friction has it: with smoothing, and positive where the rate is 0."""
        if self.exact:
            return jnp.sqrt(jnp.where(square > 0, square, 1.0))
        return jnp.sqrt(square + self.smoothing**2)
