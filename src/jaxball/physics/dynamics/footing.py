"""The ground under a body at a state, whatever its form: footing, normal, contact axes, and rates of a rolling body.

The equations of motion and the laws of contact ask here, and so need not know which ground it is.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ...numerics.arrays import select_tree
from ...numerics.vectors import apply, cross
from ..grounds import AbstractSurface, Footing
from ..grounds.surface import Coordinates
from ..state import BallState, PlacedState, Rates, ReducedState, rolling_velocity
from .parameters import BodyParameters


def surface_under(system: BodyParameters, t: Float[Array, ""], state: Any) -> AbstractSurface | None:
    """Returns the surface under a body at a state, which tells where a law has driven it; None on a plane."""
    surface = system.ground
    if not isinstance(surface, AbstractSurface):
        return None
    if not surface.driven:
        return surface
    assert system.law is not None
    count = len(surface.driven)
    accelerations = system.law.among(system.accelerated, t, state)
    return surface.following(t, *(values[-count:] for values in (state.theta, state.thetadot, accelerations)))


def locate_surface(system: BodyParameters, t: Float[Array, ""], state: Any) -> AbstractSurface | None:
    """Locates the surface under a body, with the place and the velocity that a state gives it; None on a plane.

    Unlike :func:`surface_under` it asks no law for accelerations, so that it needs no place of the body.
    """
    surface = system.ground
    if not isinstance(surface, AbstractSurface):
        return None
    if not surface.driven:
        return surface
    count = len(surface.driven)
    theta, thetadot = state.theta[-count:], state.thetadot[-count:]
    return surface.following(t, theta, thetadot, jnp.zeros_like(theta))


def footing(system: BodyParameters, t: Float[Array, ""], state: Any) -> Footing | None:
    """Computes how the surface under a body holds it; None on a plane."""
    surface = surface_under(system, t, state)
    if surface is None:
        return None
    assert isinstance(state, PlacedState)
    return surface.footing(t, system.radius, state.z, apply(state.Lambda, state.Omega))


def footing_of_released(
    system: BodyParameters,
    t: Float[Array, ""],
    state: Any,
    V: Float[Array, "3"],
    height: Float[Array, ""],
    touching: Bool[Array, ""] | bool,
) -> Footing | None:
    """Computes how the surface under a body holds it while it slips or flies with the velocity ``V``; None on a plane.

    In flight no ground acts, and the motion is described as on a level plane at rest, for any height: the normal is e3,
    and the contact axes are those of space. ``coordinate_rates`` are always those of the piece that is nearest; NaN,
    which ends a solve with a status, where a body that touches the ground is beyond its edge.
    """
    surface = surface_under(system, t, state)
    if surface is None:
        return None
    assert isinstance(state, PlacedState)
    r, omega = system.radius, apply(state.Lambda, state.Omega)
    held = surface.footing(t, r, state.z, omega, V, height)
    if surface.has_edge:
        over = jnp.asarray(touching) & ~(surface.beyond_edge(t, state.z) < 0)
        held = held._replace(coordinate_rates=jnp.where(over, jnp.nan, held.coordinate_rates))
    axes, none = jnp.eye(3, dtype=r.dtype), jnp.zeros_like(V)
    free = held._replace(
        normal=axes[2],
        tangents=axes[:2],
        velocity=none,
        spin=none,
        centre_velocity=r * cross(omega, axes[2]),
        normal_rate=none,
        acceleration=none,
        turning=none,
    )
    return select_tree(jnp.asarray(touching), held, free)


def contact_normal(system: BodyParameters, t: Float[Array, ""], state: Any) -> Float[Array, "3"]:
    """Computes the normal of the ground towards the body, in body axes: Γ on a plane."""
    surface = surface_under(system, t, state)
    if surface is None:
        return state.Gamma
    assert isinstance(state, PlacedState)
    return apply(state.Lambda.T, surface.normal(t, state.z))


class Arm(NamedTuple):
    """The arm from the contact to the geometric centre over r, body axes, and its rate.

    Of a sphere it is Γ. ``rate`` is that in space, in body axes: on a surface it is Λ⁻¹ṅ, on a plane 0, which is None.
    """

    along: Float[Array, "3"]
    rate: Float[Array, "3"] | None

    def rate_in_body(self, Omega: Float[Array, "3"]) -> Float[Array, "3"]:
        """Computes the rate of its components in body axes: Γ̇ = Γ × Ω of a sphere on a plane."""
        carried = cross(self.along, Omega)
        return carried if self.rate is None else carried + self.rate


def arm_of(system: BodyParameters, Gamma: Float[Array, "3"]) -> Float[Array, "3"]:
    """Computes the arm over r, with Γ for the normal of the contact: Γ itself of a sphere."""
    return Gamma if system.shape is None else system.shape.arm(Gamma) / system.radius


def arm_over_plane(system: BodyParameters, Gamma: Float[Array, "3"], Omega: Float[Array, "3"]) -> Arm:
    """Computes the arm of a body over a plane, and its rate."""
    if system.shape is None:
        return Arm(Gamma, None)
    along, rate = jax.jvp(lambda Gamma: arm_of(system, Gamma), (Gamma,), (cross(Gamma, Omega),))
    return Arm(along, cross(Omega, along) + rate)


def velocity_by_turning(
    system: BodyParameters, Lambda: Float[Array, "3 3"], Omega: Float[Array, "3"]
) -> Float[Array, "3"]:
    """Computes the velocity of the geometric centre, space axes, of a body whose contact point is at rest on a plane.

    It is linear in Ω: of a rate or a change of Ω it is that of the velocity.
    """
    if system.shape is None:
        return in_three(rolling_velocity(Lambda, Omega, system.radius))
    return apply(Lambda, cross(Omega, system.shape.arm(Lambda[2])))


def in_three(v: Float[Array, "2"]) -> Float[Array, "3"]:
    """Returns a horizontal vector with its third component, 0."""
    return jnp.concatenate([v, jnp.zeros_like(v[:1])])


def in_space(system: BodyParameters, state: Any) -> BallState:
    """Converts a state to the state of a ball in space; on a surface ``z`` has both coordinates of the contact point of
    a disk.
    """
    space, surface = state.in_space(), system.ground
    if not isinstance(surface, AbstractSurface) or not system.planar:
        return space
    return eqx.tree_at(lambda x: x.z, space, surface.coordinates(state.z))


def has_end(system: Any) -> bool:
    """Returns whether a system is a body on a surface, which may not let it go on."""
    return isinstance(getattr(system, "ground", None), AbstractSurface)


def end_of_ground(system: BodyParameters, t: Float[Array, ""], state: Any) -> Int[Array, ""]:
    """Returns whether the surface under a body does not let it go on from a state: a status, or SUCCESS if it does."""
    surface = surface_under(system, t, state)
    assert surface is not None
    return surface.end(t, system.radius, state.z)


def room_on_ground(system: BodyParameters, t: Float[Array, ""], state: Any) -> Float[Array, "2"]:
    """Computes how much room the surface under a body leaves it: positive where it fits, and where there is ground."""
    surface = surface_under(system, t, state)
    assert surface is not None
    return surface.room(t, system.radius, state.z)


def rates(
    system: BodyParameters,
    t: Float[Array, ""],
    state: Any,
    Omegadot: Float[Array, "3"],
    angles: Rates,
    under: Footing | None,
) -> Any:
    """Computes ẋ where Ω̇ is known, and θ, θ̇, θ̈: the kinematics of rolling. ``under`` is the :func:`footing`."""
    moved = state.rates(system.radius, Omegadot, angles, system.own_rates(t, state), system.drift(t, state))
    if under is not None:
        return eqx.tree_at(lambda x: x.z, moved, under.coordinate_rates)
    if system.shape is None or isinstance(state, ReducedState):
        return moved
    over = velocity_by_turning(system, state.Lambda, state.Omega)[:2]
    drift = system.drift(t, state)
    return eqx.tree_at(lambda x: x.z, moved, over if drift is None else over + drift)


class ContactAxes(NamedTuple):
    """The axes of the contact, two along the ground and its normal: on a plane, those of space.

    ``rows`` takes vectors from body axes to these. ``spin`` is the angular velocity of the ground's matter in them,
    None on a plane.
    """

    rows: Float[Array, "3 3"]
    spin: Float[Array, "3"] | None

    @classmethod
    def of(cls, system: BodyParameters, t: Float[Array, ""], state: Any) -> "ContactAxes":
        """Computes the contact axes at a state."""
        surface = locate_surface(system, t, state)
        if surface is None:
            return cls(state.Lambda, None)
        axes, spin = _axes_and_spin(surface, t, system.radius, state.z)
        rows = jnp.sum(axes[:, :, None] * state.Lambda[None], axis=1)
        return cls(rows, apply(axes, spin))

    def over_ground(self, Omega: Float[Array, "3"]) -> Float[Array, "3"]:
        """Computes the angular velocity of the body relative to the ground, from Ω."""
        omega = apply(self.rows, Omega)
        return omega if self.spin is None else omega - self.spin

    def in_body(self, omega: Float[Array, "3"]) -> Float[Array, "3"]:
        """Computes Ω from the angular velocity relative to the ground."""
        return apply(self.rows.T, omega if self.spin is None else omega + self.spin)


def rate_of_carrier(
    system: BodyParameters, t: Float[Array, ""], state: Any, under: Footing | None = None
) -> Float[Array, "3"] | None:
    """Computes the rate of the components of ω relative to the ground while ω is constant, in body axes; None on a
    plane.

    These components change as the axes of the contact turn along the path of the contact point and with the ground.
    ``under`` is the footing of a body that touches its ground, that of rolling if not given.
    """
    surface = surface_under(system, t, state)
    if surface is None:
        return None
    omega, u = apply(state.Lambda, state.Omega), state.z
    under = surface.footing(t, system.radius, u, omega) if under is None else under

    def components(t: Float[Array, ""], u: Coordinates) -> tuple[Float[Array, "3"], Float[Array, "3 3"]]:
        axes, spin = _axes_and_spin(surface, t, system.radius, u)
        return apply(axes, omega - spin), axes

    _, rate, axes = jax.jvp(components, (t, u), (jnp.ones_like(t), under.coordinate_rates), has_aux=True)
    return apply(state.Lambda.T, apply(axes.T, rate))


def _axes_and_spin(
    surface: AbstractSurface, t: Float[Array, ""], r: Float[Array, ""], u: Coordinates
) -> tuple[Float[Array, "3 3"], Float[Array, "3"]]:
    """Returns the axes of the contact as rows, space axes, and the angular velocity of the ground's matter."""
    under = surface.footing(t, r, u, jnp.zeros((3,), r.dtype))
    return jnp.concatenate([under.tangents, under.normal[None]]), under.spin
