"""The contract of a system that rolls on a plane: the force with which the plane holds it."""

import abc
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..numerics.vectors import dot, root
from .system import AbstractSystem, AnyState


class Reaction(NamedTuple):
    """The size of the reaction of a plane: the normal force N and the square of the friction |f|.

    **Arguments:**

    - ``normal``: N, mass length/time²; negative where the plane would have to pull.
    - ``friction_squared``: |f|², the square of such a force.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.physics import Reaction
    >>> force = Reaction(normal=jnp.array(2.0), friction_squared=jnp.array(0.25))
    >>> float(force.friction), float(force.ratio)
    (0.5, 0.25)
    """

    normal: Float[Array, "*batch"]
    friction_squared: Float[Array, "*batch"]

    @classmethod
    def of(cls, R: Float[Array, "3"], Gamma: Float[Array, "3"]) -> "Reaction":
        """Computes N = R·Γ and |f|², f = R − NΓ, of the plane's force in body axes."""
        normal = dot(R, Gamma)
        friction = R - normal * Gamma
        return cls(normal, dot(friction, friction))

    @property
    def friction(self) -> Float[Array, "*batch"]:
        """|f|; its derivative is 0 where it is 0."""
        return root(self.friction_squared)

    @property
    def ratio(self) -> Float[Array, "*batch"]:
        """|f| / N; infinite where N ≤ 0."""
        return friction_ratio(self.friction, self.normal)

    @property
    def angle(self) -> Float[Array, "*batch"]:
        """The angle of the reaction from the vertical, atan2(|f|, N), which grows with |f| / N, smoothly past N = 0."""
        return jnp.arctan2(self.friction, self.normal)


def friction_ratio(friction: Float[Array, "*batch"], normal: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Computes |f| / N; infinite where N ≤ 0."""
    held = ~(normal <= 0)  # NaN counts as held, so that it stays NaN
    return jnp.where(held, friction / jnp.where(held, normal, 1.0), jnp.inf)


class AbstractRollingSystem(AbstractSystem[AnyState]):
    """A system that rolls on a plane, which holds it as far as is needed, whether a real plane could or not.

    An implementer supplies, besides what an :class:`AbstractSystem` needs,

    - ``plane_reaction(t, state)``: the normal force and the friction that hold it;
    - ``weight``: the scale of these forces.

    In return its runs have extremes of the contact force (:func:`jaxball.contact_extremes`), the events
    :class:`~jaxball.Detachment` and :class:`~jaxball.Slip`, reductions of the contact force in ensembles and studies,
    and a row of :func:`jaxball.analysis.verify.check_laws` that says whether the plane could hold it.
    """

    @abc.abstractmethod
    def plane_reaction(self, t: Float[Array, ""], state: AnyState) -> Reaction:
        """Computes N, negative where the plane would have to pull, and |f|²; traced, for one state, ``self`` prepared
        or not.
        """

    @property
    @abc.abstractmethod
    def weight(self) -> Float[Array, "*batch"]:
        """The weight M g, mass length/time²."""
