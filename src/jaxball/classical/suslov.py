"""Suslov's problem: a rigid body with a fixed point and the nonholonomic constraint ⟨Ω, ξ⟩ = 0.

The vector ξ(t), to which Ω is orthogonal, is fixed or moves in the body.
"""

import abc
from collections.abc import Iterator
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..interface.printing import Printed
from ..numerics.arrays import Numbers, numbers, require_shape, to_array
from ..numerics.functions import HarmonicSeries, VectorOfTime
from ..numerics.kinks import kinks_seen
from ..numerics.vectors import apply, dot
from ..physics.conditions import Condition, positive_inertia, real_inertia
from .rigid_body import gyroscopic_torque, kinetic_energy, rates_of, versor_squared
from .state import AbstractClassicalSystem, RigidBodyState

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

    - ``constant``: body axes, shape (3,).
    - ``amplitude``: of each sinusoid, in the same units, shape (terms, 3).
    - ``frequency``: rad/time, shape (terms,).
    - ``phase``: rad, shape (terms,); zero if not given.

    **Raises:** ``ValueError`` when ``constant`` is not three numbers, and when ``amplitude``,
    ``frequency`` and ``phase`` differ in length.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.classical import HarmonicAxis
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
    - ``kink_times``: times, shape (kinks,), at which its derivative jumps or has a kink.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.classical import FunctionAxis
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


class SuslovProblem(AbstractClassicalSystem[RigidBodyState]):
    """A rigid body with a fixed point whose angular velocity is orthogonal to ξ(t), ``eq_suslov``.

    **Arguments:**

    - ``inertia``: the principal moments (d1, d2, d3) about the fixed point, mass length², shape (3,); the body axes are
      principal.
    - ``xi``: ξ in body axes, of any nonzero length, shape (3,), or a function of time as an
      :class:`~jaxball.classical.AbstractAxis`.

    Textbooks put E3 on ξ and keep the products of inertia I13 and I23; here the axes are principal and ξ is free, which
    is equally general. Where a constant ξ is a principal axis, Ω is constant.

    **Raises:** ``ValueError`` when a shape is wrong. Values are not checked here, so that they may be
    traced; see :func:`jaxball.problems`.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.classical import RigidBodyState, SuslovProblem
    >>> problem = SuslovProblem(inertia=(1.0, 2.0, 3.0), xi=(0.0, 1.0, 1.0))
    >>> state = RigidBodyState(Omega=(1.0, 1.0, -1.0))
    >>> print(problem.reaction(jnp.array(0.0), state))
    [0.  1.6 1.6]
    >>> problem.laws(jnp.array(0.0), state).constraint
    Array(0., dtype=float64)
    """

    inertia: Float[Array, "3"]
    xi: AbstractAxis

    title: ClassVar[str] = "Suslov problem"
    state_type: ClassVar[type[RigidBodyState]] = RigidBodyState

    def __init__(self, *, inertia: Numbers, xi: Numbers | AbstractAxis):
        self.inertia = numbers("inertia", (3,))(inertia)
        self.xi = xi if isinstance(xi, AbstractAxis) else HarmonicAxis(xi)

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
        yield positive_inertia(self.inertia)
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
