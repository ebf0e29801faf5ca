"""The free rigid body, and functions shared by the bodies with a fixed point."""

from collections.abc import Iterator
from typing import ClassVar, NamedTuple

import equinox as eqx
from jaxtyping import Array, Float

from ..numerics.declare import OF_INERTIA, POSITIVE, number
from ..numerics.vectors import apply, cross, dot
from ..numerics.versor import derivative
from ..physics.conditions import Condition, real_inertia
from .state import AbstractClassicalSystem, OrientedState, RigidBodyState


class FreeBodyLaws(NamedTuple):
    """The integrals of a free rigid body.

    - ``energy``: E = ½⟨𝕀Ω, Ω⟩, mass length²/time².
    - ``spatial_momentum``: Λ𝕀Ω, the angular momentum in space axes, mass length²/time, shape (3,).
    - ``momentum_squared``: |𝕀Ω|², which does not depend on Λ.
    - ``versor_squared``: |q|² = 1.
    """

    energy: Float[Array, ""]
    spatial_momentum: Float[Array, "3"]
    momentum_squared: Float[Array, ""]
    versor_squared: Float[Array, ""]


class FreeRigidBody(AbstractClassicalSystem[RigidBodyState]):
    """A rigid body on which no torque acts, ``EP_fin_rigid_body``.

    **Arguments:**

    - ``inertia``: the principal moments (d1, d2, d3) about the centre of mass, or about a fixed point, mass length²,
      shape (3,); the body axes are principal.

    **Raises:** ``ValueError`` when the shape is wrong. Values are not checked here, so that they may be
    traced; see :func:`jaxball.problems`.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.classical import FreeRigidBody, RigidBodyState
    >>> body = FreeRigidBody(inertia=(1.0, 2.0, 3.0))
    >>> body.laws(jnp.array(0.0), RigidBodyState(Omega=(0.0, 1.0, 1.0))).energy
    Array(2.5, dtype=float64)
    """

    inertia: Float[Array, "3"] = eqx.field(converter=number(OF_INERTIA, POSITIVE), kw_only=True)

    title: ClassVar[str] = "free rigid body"
    state_type: ClassVar[type[RigidBodyState]] = RigidBodyState

    def field(self, t: Float[Array, ""], state: RigidBodyState) -> RigidBodyState:
        """Evaluates 𝕀Ω̇ = 𝕀Ω × Ω and q̇ = ½ q Ω♯."""
        return rates_of(state, gyroscopic_torque(self.inertia, state.Omega) / self.inertia)

    def laws(self, t: Float[Array, ""], state: RigidBodyState) -> FreeBodyLaws:
        momentum = self.inertia * state.Omega
        return FreeBodyLaws(
            energy=kinetic_energy(self.inertia, state.Omega),
            spatial_momentum=apply(state.Lambda, momentum),
            momentum_squared=dot(momentum, momentum),
            versor_squared=versor_squared(state),
        )

    def conditions(self) -> Iterator[Condition]:
        yield from super().conditions()
        yield real_inertia(self.inertia)


def rates_of(state: RigidBodyState, Omegadot: Float[Array, "3"]) -> RigidBodyState:
    """Computes the rates of a state where Ω̇ is known: q̇ = ½ q Ω♯."""
    return RigidBodyState(q=derivative(state.q, state.Omega), Omega=Omegadot)


def gyroscopic_torque(inertia: Float[Array, "3"], Omega: Float[Array, "3"]) -> Float[Array, "3"]:
    """Computes 𝕀Ω × Ω."""
    return cross(inertia * Omega, Omega)


def kinetic_energy(inertia: Float[Array, "3"], Omega: Float[Array, "3"]) -> Float[Array, ""]:
    """Computes ½⟨𝕀Ω, Ω⟩."""
    return 0.5 * dot(inertia * Omega, Omega)


def versor_squared(state: OrientedState) -> Float[Array, ""]:
    """Computes |q|²."""
    return (state.q * state.q).sum()
