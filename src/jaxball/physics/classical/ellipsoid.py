"""An ellipsoid that rolls on a horizontal plane: spheroids, and the rattleback."""

from collections.abc import Iterator
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.declare import ANGLE, FINITE, LENGTH, OF_GRAVITY, OF_INERTIA, OF_MASS, POSITIVE, number
from ...numerics.vectors import apply, cross, dot, inverse, outer, sine_cosine
from ...numerics.versor import derivative
from ..conditions import Condition, real_inertia
from ..dynamics.dry_friction import pressing_force
from ..forces.resistance import AbstractResistance
from ..rolling import AbstractRollingSystem, Reaction
from .rigid_body import versor_squared
from .state import AbstractClassicalSystem, OrientedState


class EllipsoidState(OrientedState):
    """(q, Ω, z) of an ellipsoid that rolls; at rest on the end of its third axis by default.

    **Arguments:**

    - ``q``: a versor with its real part first, whose rotation Λ maps body vectors to space vectors, shape (4,).
    - ``Omega``: Ω, body axes, rad/time, shape (3,).
    - ``z``: the path of the geometric centre over the plane, length, shape (2,).

    **Example:**

    >>> from jaxball.physics.classical import EllipsoidState
    >>> EllipsoidState(Omega=(0.0, 0.0, 2.0))
    EllipsoidState(q=(1.0, 0.0, 0.0, 0.0), Omega=(0.0, 0.0, 2.0), z=(0.0, 0.0))
    """

    z: Float[Array, "*batch 2"] = eqx.field(converter=number(), default=(0.0, 0.0))


class EllipsoidLaws(NamedTuple):
    """What a rolling ellipsoid conserves.

    - ``energy``: E = ½⟨𝕁Ω, Ω⟩ + ½ m |V|² + m g × the height of the centre of mass over the plane, mass length²/time²;
      with resistance it decreases at the rate of :meth:`RollingEllipsoid.dissipation`.
    - ``versor_squared``: |q|² = 1.
    """

    energy: Float[Array, ""]
    versor_squared: Float[Array, ""]


class RollingEllipsoid(AbstractClassicalSystem[EllipsoidState], AbstractRollingSystem[EllipsoidState]):
    """A rigid body with the surface of an ellipsoid, which rolls without slipping on a horizontal plane.

    It touches the plane where the outer normal of its surface is −Γ, at c = −A²Γ / √(Γ·A²Γ) from the geometric centre,
    with A the semi-axes. Two equal semi-axes make a spheroid, three a ball. Principal axes of inertia that are turned
    about the vertical against the semi-axes make a rattleback, which prefers one direction of spin.

    Gravity acts, resistance if there is any, and the plane, which holds it as far as is needed: it never slips and
    never leaves the plane. :meth:`reaction` tells where that is no longer so.

    **Arguments:**

    - ``mass``: m, the mass of the ellipsoid, in units of mass.
    - ``semiaxes``: the semi-axes of the surface, along the body axes, length, shape (3,).
    - ``inertia``: the principal moments (d1, d2, d3) about the centre of mass, mass length², shape (3,).
    - ``turn``: by how much the first two principal axes are turned about E3 against the semi-axes, rad.
    - ``offset``: from the geometric centre to the centre of mass, body axes, length, shape (3,).
    - ``gravity``: g, the acceleration of gravity, length/time².
    - ``resistance``: such as a :class:`~jaxball.Resistance`, at the contact and of a medium; None without. The radius
      by which dry friction is multiplied is the height of the geometric centre.

    **Raises:** ``ValueError`` when a shape is wrong, and for a resistance that is ``exact``. Values are not
    checked here, so that they may be traced; see :func:`jaxball.problems`.

    **Source:** the equations are those of a rolling rigid body, E. J. Routh, *Dynamics of a System of Rigid Bodies,
    Advanced Part*, 6th edition, 1905, §241; T. R. Kane and D. A. Levinson, *Realistic mathematical modeling of the
    rattleback*, International Journal of Non-Linear Mechanics 17 (1982), 175.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import simulate
    >>> from jaxball.physics.classical import EllipsoidState, RollingEllipsoid
    >>> egg = RollingEllipsoid(semiaxes=(1.0, 1.0, 1.5), inertia=(0.65, 0.65, 0.4))
    >>> lying = EllipsoidState(q=(jnp.sqrt(0.5), jnp.sqrt(0.5), 0.0, 0.0), Omega=(0.0, 0.0, 1.0))
    >>> round(float(simulate(egg, [0.0, 2.0], lying).state.z[-1, 0]), 6)  # it rolls about its long axis
    -2.0
    """

    mass: Float[Array, ""] = eqx.field(converter=number(OF_MASS, POSITIVE), default=1.0, kw_only=True)
    semiaxes: Float[Array, "3"] = eqx.field(converter=number(LENGTH, POSITIVE), kw_only=True)
    inertia: Float[Array, "3"] = eqx.field(converter=number(OF_INERTIA, POSITIVE), kw_only=True)
    turn: Float[Array, ""] = eqx.field(converter=number(ANGLE, FINITE), default=0.0, kw_only=True)
    offset: Float[Array, "3"] = eqx.field(converter=number(LENGTH), default=(0.0, 0.0, 0.0), kw_only=True)
    gravity: Float[Array, ""] = eqx.field(converter=number(OF_GRAVITY, FINITE), default=1.0, kw_only=True)
    resistance: AbstractResistance | None = eqx.field(default=None, kw_only=True)

    title: ClassVar[str] = "rolling ellipsoid"
    state_type: ClassVar[type[EllipsoidState]] = EllipsoidState

    def __check_init__(self):
        if self.resistance is not None and self.resistance.holds:
            raise ValueError(
                "Argument `resistance` must not be exact for a RollingEllipsoid, which has no mode of rest; leave "
                "`exact` out."
            )

    @property
    def J(self) -> Float[Array, "3 3"]:
        """𝕁, the inertia about the centre of mass, in body axes."""
        sine, cosine = sine_cosine(self.turn)
        zero, unit = jnp.zeros_like(sine), jnp.ones_like(sine)
        axes = jnp.stack(
            [jnp.stack([cosine, sine, zero]), jnp.stack([-sine, cosine, zero]), jnp.stack([zero, zero, unit])]
        )
        return jnp.sum(self.inertia[:, None, None] * axes[:, :, None] * axes[:, None, :], axis=0)

    def contact(self, Gamma: Float[Array, "3"]) -> Float[Array, "3"]:
        """Computes c, from the geometric centre to the point that touches the plane, in body axes; −c·Γ is the centre's
        height.
        """
        return -(self.semiaxes**2) * Gamma / self._height(Gamma)

    def reaction(self, t: Float[Array, ""], state: EllipsoidState) -> Float[Array, "3"]:
        """Returns the force of the plane in space axes: two components of friction, and the normal force."""
        return apply(state.Lambda, self._accelerations(state).reaction)

    def plane_reaction(self, t: Float[Array, ""], state: EllipsoidState) -> Reaction:
        return Reaction.of(self._accelerations(state).reaction, state.Gamma)

    @property
    def weight(self) -> Float[Array, "*batch"]:
        return self.mass * self.gravity

    def dissipation(self, t: Float[Array, ""], state: EllipsoidState) -> Float[Array, ""]:
        """Returns the power that resistance takes, mass length²/time³: E decreases at this rate."""
        force, torque = self._resisting(state)
        dry = self._accelerations(state).dry
        torque = torque if dry is None else torque + dry
        return -dot(torque, state.Omega) - dot(force, self._velocity(state))

    def field(self, t: Float[Array, ""], state: EllipsoidState) -> EllipsoidState:
        """Evaluates 𝕁Ω̇ = 𝕁Ω × Ω + s × R + T with s from the centre of mass to the contact, and V = s × Ω; q̇
        = ½ q Ω♯.
        """
        velocity = apply(state.Lambda, self._velocity(state))
        return EllipsoidState(derivative(state.q, state.Omega), self._accelerations(state).Omegadot, velocity[:2])

    def laws(self, t: Float[Array, ""], state: EllipsoidState) -> EllipsoidLaws:
        s, Omega, Gamma = self.contact(state.Gamma) - self.offset, state.Omega, state.Gamma
        V = cross(s, Omega)
        kinetic = (dot(apply(self.J, Omega), Omega) + self.mass * dot(V, V)) / 2
        return EllipsoidLaws(kinetic - self.mass * self.gravity * dot(s, Gamma), versor_squared(state))

    def law_rates(self, t: Float[Array, ""], state: EllipsoidState) -> dict[str, Float[Array, ""]]:
        """Returns Ė, where there is resistance."""
        return {} if self.resistance is None else {"energy": -self.dissipation(t, state)}

    def conditions(self) -> Iterator[Condition]:
        yield from super().conditions()
        yield real_inertia(self.inertia)
        inside = jnp.sum((self.offset / self.semiaxes) ** 2) < 1
        yield Condition(inside, "offset", self.offset, "a point inside the surface")
        if self.resistance is not None:
            yield from self.resistance.conditions()

    def _height(self, Gamma: Float[Array, "3"]) -> Float[Array, ""]:
        """Computes √(Γ·A²Γ), the height of the geometric centre over the plane."""
        return jnp.sqrt(jnp.sum((self.semiaxes * Gamma) ** 2))

    def _moving(self, state: EllipsoidState) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Returns s, and the rest of m⁻¹R when Ω̇ is 0: ṡ × Ω + Ω × (s × Ω) + gΓ."""
        Omega, Gamma = state.Omega, state.Gamma
        Gammadot, height, squared = cross(Gamma, Omega), self._height(Gamma), self.semiaxes**2
        s = self.contact(Gamma) - self.offset
        sdot = -squared * (Gammadot - Gamma * dot(Gamma, squared * Gammadot) / height**2) / height
        return s, cross(sdot, Omega) + cross(Omega, cross(s, Omega)) + self.gravity * Gamma

    def _velocity(self, state: EllipsoidState) -> Float[Array, "3"]:
        """Computes the velocity of the geometric centre, in body axes: c × Ω."""
        return cross(self.contact(state.Gamma), state.Omega)

    def _resisting(self, state: EllipsoidState) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Returns the force of a medium at the geometric centre, and all torques of resistance but the dry one, in body
        axes.
        """
        none = jnp.zeros_like(state.Omega)
        if self.resistance is None:
            return none, none
        torque = self.resistance.contact_torque(state.Omega, state.Gamma)
        medium = self.resistance.medium(self._velocity(state), state.Omega)
        return (none, torque) if medium is None else (medium[0], torque + medium[1])

    def _accelerations(self, state: EllipsoidState) -> "_Accelerations":
        """Solves Newton's and Euler's laws about the contact; dry friction is proportional to the normal force N.

        With the friction N d, Ω̇ is Ω̇₀ + N a, a the acceleration by d, and N = N₀ + N m Γ·(s × a) is solved for N.
        """
        Omega, Gamma, J = state.Omega, state.Gamma, self.J
        s, rest = self._moving(state)
        force, resisting = self._resisting(state)
        about_contact = inverse(J + self.mass * (dot(s, s) * jnp.eye(3, dtype=s.dtype) - outer(s, s)))
        torque = cross(apply(J, Omega), Omega) + self.mass * cross(s, rest)
        torque = torque - cross(self.contact(Gamma), force) + resisting
        Omegadot = apply(about_contact, torque)
        dry = None if self.resistance is None else self.resistance.dry_torque(self._height(Gamma), Omega, Gamma)
        if dry is not None:
            by_friction = apply(about_contact, dry)
            without = dot(Gamma, self.mass * (cross(s, Omegadot) + rest) - force)
            share = 1 - self.mass * dot(Gamma, cross(s, by_friction))
            N = pressing_force(without, share)
            Omegadot, dry = Omegadot + N * by_friction, N * dry
        return _Accelerations(Omegadot, self.mass * (cross(s, Omegadot) + rest) - force, dry)


class _Accelerations(NamedTuple):
    """Ω̇, the force of the plane, and the torque of dry friction, None without; body axes."""

    Omegadot: Float[Array, "3"]
    reaction: Float[Array, "3"]
    dry: Float[Array, "3"] | None
