"""The heavy top."""

from collections.abc import Iterator
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..numerics.declare import FINITE, LENGTH, OF_GRAVITY, OF_INERTIA, OF_MASS, POSITIVE, number
from ..numerics.vectors import cross, dot
from ..physics.conditions import Condition, real_inertia
from .rigid_body import gyroscopic_torque, kinetic_energy, rates_of, versor_squared
from .state import AbstractClassicalSystem, RigidBodyState


class HeavyTopLaws(NamedTuple):
    """The integrals of a heavy top.

    - ``energy``: E = ½⟨𝕀Ω, Ω⟩ + mg⟨χ, Γ⟩, mass length²/time², 0 at rest with the centre of mass at the height of the
      fixed point.
    - ``vertical_momentum``: ⟨𝕀Ω, Γ⟩, the angular momentum about the vertical through the fixed point.
    - ``axial_momentum``: ⟨𝕀Ω, χ⟩, Lagrange's integral. It is constant only if the top is symmetric about χ, as with d1
      = d2 and χ on E3.
    - ``vertical_squared``: |Γ|² = 1.
    - ``versor_squared``: |q|² = 1.
    """

    energy: Float[Array, ""]
    vertical_momentum: Float[Array, ""]
    axial_momentum: Float[Array, ""]
    vertical_squared: Float[Array, ""]
    versor_squared: Float[Array, ""]


class HeavyTop(AbstractClassicalSystem[RigidBodyState]):
    """A rigid body that turns about a fixed point under gravity, ``eq_heavy_top``.

    **Arguments:**

    - ``mass``: m, in units of mass.
    - ``inertia``: the principal moments (d1, d2, d3) about the fixed point, mass length², shape (3,); the body axes are
      principal.
    - ``chi``: χ, from the fixed point to the centre of mass, body axes, length, shape (3,).
    - ``gravity``: g, length/time².

    The motion depends only on 𝕀 and on the product m g χ.

    **Raises:** ``ValueError`` when a shape is wrong. Values are not checked here, so that they may be
    traced; see :func:`jaxball.problems`.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.classical import HeavyTop, RigidBodyState
    >>> top = HeavyTop(inertia=(1.0, 1.0, 0.5), chi=(0.0, 0.0, 0.5))
    >>> laws = top.laws(jnp.array(0.0), RigidBodyState(Omega=(0.0, 0.0, 3.0)))
    >>> float(laws.energy)  # ½ · 0.5 · 3² + m g |χ|
    2.75
    """

    mass: Float[Array, ""] = eqx.field(converter=number(OF_MASS, POSITIVE), default=1.0, kw_only=True)
    inertia: Float[Array, "3"] = eqx.field(converter=number(OF_INERTIA, POSITIVE), kw_only=True)
    chi: Float[Array, "3"] = eqx.field(converter=number(LENGTH), kw_only=True)
    gravity: Float[Array, ""] = eqx.field(converter=number(OF_GRAVITY, FINITE), default=1.0, kw_only=True)

    title: ClassVar[str] = "heavy top"
    state_type: ClassVar[type[RigidBodyState]] = RigidBodyState

    def field(self, t: Float[Array, ""], state: RigidBodyState) -> RigidBodyState:
        """Evaluates 𝕀Ω̇ = 𝕀Ω × Ω + mgΓ × χ and q̇ = ½ q Ω♯, which implies Γ̇ = Γ × Ω."""
        weight = self.mass * self.gravity * cross(state.Gamma, self.chi)
        return rates_of(state, (gyroscopic_torque(self.inertia, state.Omega) + weight) / self.inertia)

    def laws(self, t: Float[Array, ""], state: RigidBodyState) -> HeavyTopLaws:
        momentum, Gamma = self.inertia * state.Omega, state.Gamma
        potential = self.mass * self.gravity * dot(self.chi, Gamma)
        return HeavyTopLaws(
            energy=kinetic_energy(self.inertia, state.Omega) + potential,
            vertical_momentum=dot(momentum, Gamma),
            axial_momentum=dot(momentum, self.chi),
            vertical_squared=dot(Gamma, Gamma),
            versor_squared=versor_squared(state),
        )

    def conditions(self) -> Iterator[Condition]:
        """Yields the conditions on each number, and that a body of this mass and inertia can have its centre of mass at
        χ.

        With the second moments s_j = ∫ x_j² dm = ½ (d1 + d2 + d3) − d_j, those about the centre of mass,
        diag(s) − m χχᵀ, have no negative eigenvalue if and only if m Σ χ_j² / s_j ≤ 1.
        """
        yield from super().conditions()
        yield real_inertia(self.inertia)
        # A flat body has no second moment across its plane, and χ no component there: not 0 / 0.
        second = jnp.maximum(jnp.sum(self.inertia) / 2 - self.inertia, 1e-12 * jnp.sum(self.inertia))
        yield Condition(
            self.mass * jnp.sum(self.chi**2 / second) <= 1 + 1e-6,
            "chi",
            self.chi,
            "a position where a body of this mass and inertia can have its centre of mass, m Σ χ_j² / s_j ≤ 1 with "
            "s_j = ½ (d1 + d2 + d3) − d_j (a smaller mass under larger gravity moves in the same way)",
        )
