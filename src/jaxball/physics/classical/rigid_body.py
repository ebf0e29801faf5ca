"""Bodies with a fixed point: the free rigid body, the heavy top, and Suslov's problem.

In that problem the angular velocity fulfils ⟨Ω, ξ⟩ = 0, where ξ(t) is fixed or moves in the body.
"""

import abc
from collections.abc import Iterator
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.printing import Printed
from ...numerics.arrays import Numbers, require_shape, to_array
from ...numerics.declare import FINITE, LENGTH, OF_GRAVITY, OF_INERTIA, OF_MASS, POSITIVE, number
from ...numerics.functions import HarmonicSeries, VectorOfTime
from ...numerics.kinks import kinks_seen
from ...numerics.vectors import apply, cross, dot
from ...numerics.versor import derivative
from ..conditions import Condition, real_inertia
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
    >>> from jaxball.physics.classical import FreeRigidBody, RigidBodyState
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

    - ``mass``: m, the mass of the top, in units of mass.
    - ``inertia``: the principal moments (d1, d2, d3) about the fixed point, mass length², shape (3,); the body axes are
      principal.
    - ``chi``: χ, from the fixed point to the centre of mass, body axes, length, shape (3,).
    - ``gravity``: g, the acceleration of gravity, length/time².

    The motion depends only on 𝕀 and on the product m g χ.

    **Raises:** ``ValueError`` when a shape is wrong. Values are not checked here, so that they may be
    traced; see :func:`jaxball.problems`.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.physics.classical import HeavyTop, RigidBodyState
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


ALLOWED_SINE = 1e-6  # how far the sine of the angle between Ω and the constraint's plane may be from 0


class AbstractAxis(Printed):
    """ξ(t) in body axes. Its length does not affect the motion, but must not be 0."""

    @abc.abstractmethod
    def __call__(self, t: Float[Array, ""]) -> Float[Array, "3"]:
        """Returns ξ(t)."""

    def derivatives(self, t: Float[Array, ""]) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Returns ξ(t) and ξ̇(t), the latter by forward mode; at a kink, its value on the later side."""
        return jax.jvp(self, (t,), (jnp.ones_like(t),))

    def kinks(self) -> Float[Array, " kinks"]:
        """Returns the times at which ξ̇ or one of its derivatives jumps; ξ must not.

        By default, those at which the trace of ``__call__`` compares the time with something else.
        """
        return kinks_seen(self, type(self).__call__)


class HarmonicAxis(AbstractAxis):
    """A constant plus sinusoids: ξ(t) = constant + Σ amplitude_k sin(frequency_k t + phase_k).

    **Arguments:**

    - ``constant``: the constant part, body axes, shape (3,).
    - ``amplitude``: a row for each sinusoid, in the same units, shape (terms, 3).
    - ``frequency``: one for each sinusoid, rad/time, shape (terms,).
    - ``phase``: one for each sinusoid, rad, shape (terms,); zero if not given.

    **Raises:** ``ValueError`` when ``constant`` is not three numbers, and when ``amplitude``,
    ``frequency`` and ``phase`` differ in length.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.physics.classical import HarmonicAxis
    >>> axis = HarmonicAxis((0.0, 0.0, 1.0), amplitude=[(0.5, 0.0, 0.0)], frequency=[2.0])
    >>> xi, xidot = axis.derivatives(jnp.array(0.0))
    >>> xidot
    Array([1., 0., 0.], dtype=float64)
    """

    series: HarmonicSeries

    def __init__(
        self,
        constant: Numbers,
        amplitude: Numbers | None = None,
        frequency: Numbers = (),
        phase: Numbers | None = None,
    ):
        require_shape("constant", to_array(constant, "constant"), (3,))
        self.series = HarmonicSeries(constant, amplitude, frequency, phase)

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "3"]:
        return self.series(t)


class FunctionAxis(VectorOfTime, AbstractAxis):
    """ξ(t) = function(t, parameters), for any function that JAX can trace.

    ``function`` is compiled into programs, so pass the same one each time: a new lambda compiles again. Give the times
    at which its derivative jumps in ``kink_times``.

    **Arguments:**

    - ``function``: of (t, parameters), to ξ, body axes, shape (3,).
    - ``parameters``: arrays, in any PyTree, passed to it; they can be swept and differentiated.
    - ``kink_times``: the times at which its derivative jumps or has a kink, shape (kinks,).

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.physics.classical import FunctionAxis
    >>> def tilting(t, rate):
    ...     return jnp.stack([jnp.sin(rate * t), 0.0 * t, jnp.cos(rate * t)])
    >>> print(FunctionAxis(tilting, 0.5)(jnp.array(0.0)))
    [0. 0. 1.]
    """


class SuslovLaws(NamedTuple):
    """The conserved quantities of Suslov's problem, whether ξ is constant or varies.

    - ``energy``: E = ½⟨𝕀Ω, Ω⟩, mass length²/time². The reaction torque λξ has the power λ⟨Ω, ξ⟩ = 0 and does no work.
    - ``constraint``: ⟨Ω, ξ⟩ = 0.
    - ``versor_squared``: |q|² = 1.
    """

    energy: Float[Array, ""]
    constraint: Float[Array, ""]
    versor_squared: Float[Array, ""]


def _as_axis(xi: Numbers | AbstractAxis) -> AbstractAxis:
    return xi if isinstance(xi, AbstractAxis) else HarmonicAxis(xi)


class SuslovProblem(AbstractClassicalSystem[RigidBodyState]):
    """A rigid body with a fixed point whose angular velocity is orthogonal to ξ(t), ``eq_suslov``.

    **Arguments:**

    - ``inertia``: the principal moments (d1, d2, d3) about the fixed point, mass length², shape (3,); the body axes are
      principal.
    - ``xi``: ξ(t), the axis about which the body cannot rotate, of any nonzero length, body axes, shape (3,). Or a
      function of time as an :class:`~jaxball.physics.classical.AbstractAxis`.

    Textbooks put E3 on ξ and keep the products of inertia I13 and I23; here the axes are principal and ξ is free, which
    is equally general. Where a constant ξ is a principal axis, Ω is constant.

    **Raises:** ``ValueError`` when a shape is wrong. Values are not checked here, so that they may be
    traced; see :func:`jaxball.problems`.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.physics.classical import RigidBodyState, SuslovProblem
    >>> problem = SuslovProblem(inertia=(1.0, 2.0, 3.0), xi=(0.0, 1.0, 1.0))
    >>> state = RigidBodyState(Omega=(1.0, 1.0, -1.0))
    >>> print(problem.reaction(jnp.array(0.0), state))
    [0.  1.6 1.6]
    >>> problem.laws(jnp.array(0.0), state).constraint
    Array(0., dtype=float64)
    """

    inertia: Float[Array, "3"] = eqx.field(converter=number(OF_INERTIA, POSITIVE), kw_only=True)
    xi: AbstractAxis = eqx.field(converter=_as_axis, kw_only=True)

    title: ClassVar[str] = "Suslov problem"
    state_type: ClassVar[type[RigidBodyState]] = RigidBodyState

    def field(self, t: Float[Array, ""], state: RigidBodyState) -> RigidBodyState:
        """Evaluates 𝕀Ω̇ = 𝕀Ω × Ω + λξ and q̇ = ½ q Ω♯."""
        torque = gyroscopic_torque(self.inertia, state.Omega) + self.reaction(t, state)
        return rates_of(state, torque / self.inertia)

    def multiplier(self, t: Float[Array, ""], state: RigidBodyState) -> Float[Array, ""]:
        """Computes λ of ``eq_suslov_lambda``, a torque over the length of ξ."""
        xi, xidot = self.xi.derivatives(t)
        along = xi / self.inertia
        free = dot(gyroscopic_torque(self.inertia, state.Omega), along)
        return -(dot(state.Omega, xidot) + free) / dot(xi, along)

    def reaction(self, t: Float[Array, ""], state: RigidBodyState) -> Float[Array, "3"]:
        """Computes λξ, the torque by which the constraint acts on the body, in body axes: Λλξ = d/dt (Λ𝕀Ω)."""
        return self.multiplier(t, state) * self.xi(t)

    def spatial_momentum(self, state: RigidBodyState) -> Float[Array, "3"]:
        """Computes Λ𝕀Ω, the angular momentum in space axes, which the reaction changes."""
        return apply(state.Lambda, self.inertia * state.Omega)

    def laws(self, t: Float[Array, ""], state: RigidBodyState) -> SuslovLaws:
        return SuslovLaws(
            energy=kinetic_energy(self.inertia, state.Omega),
            constraint=dot(state.Omega, self.xi(t)),
            versor_squared=versor_squared(state),
        )

    def conditions(self) -> Iterator[Condition]:
        yield from super().conditions()
        yield real_inertia(self.inertia)

    def start_conditions(self, t: Float[Array, ""], state: RigidBodyState) -> Iterator[Condition]:
        xi, Omega = self.xi(t), state.Omega
        size = dot(xi, xi)
        yield Condition((size > 0) & jnp.isfinite(size), "xi", xi, "three finite numbers, not all zero, at the start")
        yield Condition(
            dot(Omega, xi) ** 2 <= ALLOWED_SINE**2 * size * dot(Omega, Omega),
            "state.Omega",
            Omega,
            "orthogonal to xi at the start",
        )

    def driving_kinks(self) -> Float[Array, " kinks"]:
        return self.xi.kinks()
