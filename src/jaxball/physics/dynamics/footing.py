"""The ground under a body at a state, whatever its form: footing, normal, contact axes, and rates of a rolling body.

The equations of motion and the laws of contact ask here, and so need not know which ground it is.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ...numerics.arrays import select_tree
from ...numerics.vectors import add, apply, convert, cross, in_three
from ..grounds import AbstractSurface, Footing
from ..grounds.ground import AT_REST, AbstractGround
from ..grounds.surface import Coordinates
from ..state import BallState, DiskState, Rates, ReducedState, rolling_velocity
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


def footing(
    system: BodyParameters,
    t: Float[Array, ""],
    state: Any,
    V: Float[Array, "3"] | None = None,
    height: Float[Array, ""] | None = None,
) -> Footing:
    """Computes how the ground under a body holds it.

    ``V`` is the velocity of its centre, that of rolling if not given, and ``height`` how far it is above the ground.
    """
    ground = surface_under(system, t, state) or system.ground
    if ground is None:
        return AT_REST
    return ground.footing(t, system.radius, state.z, apply(state.Lambda, state.Omega), V, height)


def footing_of_released(
    system: BodyParameters,
    t: Float[Array, ""],
    state: Any,
    V: Float[Array, "3"],
    height: Float[Array, ""],
    touching: Bool[Array, ""] | bool,
) -> Footing:
    """Computes how the ground under a body holds it while it slips or flies with the velocity ``V``.

    In flight no ground acts, and over a surface the motion is described as on a level plane at rest, for any height:
    the normal is e3, and the contact axes are those of space. ``coordinate_rates`` are always those of the piece that
    is nearest; NaN, which ends a solve with a status, where a body that touches the ground is beyond its edge.
    """
    surface, held = surface_under(system, t, state), footing(system, t, state, V, height)
    if surface is None:
        return held
    if surface.has_edge:
        assert held.coordinate_rates is not None
        over = jnp.asarray(touching) & ~(surface.beyond_edge(t, state.z) < 0)
        held = held._replace(coordinate_rates=jnp.where(over, jnp.nan, held.coordinate_rates))
    none = jnp.zeros_like(V)
    free = held._replace(
        axes=jnp.eye(3, dtype=V.dtype), velocity=none, spin=none, normal_rate=none, acceleration=none, turning=none
    )
    return select_tree(jnp.asarray(touching), held, free)


def contact_normal(system: BodyParameters, t: Float[Array, ""], state: Any) -> Float[Array, "3"]:
    """Computes the normal of the ground towards the body, in body axes: Γ on a plane."""
    surface = surface_under(system, t, state)
    return state.Gamma if surface is None else apply(state.Lambda.T, surface.normal(t, state.z))


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


def arm_over(system: BodyParameters, state: Any, under: Footing) -> Arm:
    """Computes the arm of a body over its ground, and its rate."""
    if under.axes is not None:
        into_body = state.Lambda.T
        return Arm(apply(into_body, under.axes[2]), convert(lambda rate: apply(into_body, rate), under.normal_rate))
    Gamma, Omega = state.Gamma, state.Omega
    if system.shape is None:
        return Arm(Gamma, None)
    along, rate = jax.jvp(lambda Gamma: arm_of(system, Gamma), (Gamma,), (cross(Gamma, Omega),))
    return Arm(along, cross(Omega, along) + rate)


def velocity_by_turning(
    system: BodyParameters,
    Lambda: Float[Array, "3 3"],
    Omega: Float[Array, "3"],
    under: Footing = AT_REST,
) -> Float[Array, "3"]:
    """Computes r ω × n, space axes, the velocity of the geometric centre of a body whose contact point is at rest.

    It is linear in Ω: of a rate or a change of Ω it is that of the velocity.
    """
    if under.axes is not None:
        return system.radius * cross(apply(Lambda, Omega), under.axes[2])
    if system.shape is None:
        return in_three(rolling_velocity(Lambda, Omega, system.radius))
    return apply(Lambda, cross(Omega, system.shape.arm(Lambda[2])))


def velocity_of_centre(system: BodyParameters, state: Any, under: Footing) -> Float[Array, "3"]:
    """Computes w + r ω × n, the velocity of the geometric centre of a body that rolls, space axes."""
    return add(velocity_by_turning(system, state.Lambda, state.Omega, under), under.velocity)


def place(state: Any) -> Float[Array, "2"]:
    """Returns the place of the geometric centre over the plane; a disk moves along e1."""
    return jnp.stack([state.z, jnp.zeros_like(state.z)]) if isinstance(state, DiskState) else state.z


def place_of_centre(
    system: BodyParameters, state: Any, under: Footing, height: Float[Array, ""] | None
) -> Float[Array, "3"]:
    """Returns the place of the geometric centre, at a ``height`` over that of rolling, space axes; a plane is at −r."""
    if under.centre is not None:
        return under.centre
    above = None if system.shape is None else system.shape.height(state.Gamma) - system.radius
    total = add(height, above)
    on_plane = in_three(place(state))
    return on_plane if total is None else on_plane.at[2].set(total)


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
    under: Footing,
) -> Any:
    """Computes ẋ where Ω̇ is known, and θ, θ̇, θ̈: the kinematics of rolling. ``under`` is the :func:`footing`."""
    moved = state.rates(system.radius, Omegadot, angles, system.own_rates(t, state))
    if under.coordinate_rates is not None:
        return eqx.tree_at(lambda x: x.z, moved, under.coordinate_rates)
    if isinstance(state, ReducedState) or (system.shape is None and under.velocity is None):
        return moved
    V = velocity_of_centre(system, state, under)
    return eqx.tree_at(lambda x: x.z, moved, V[0] if isinstance(state, DiskState) else V[:2])


class ContactAxes(NamedTuple):
    """The axes of the contact, two along the ground and its normal: on a plane, those of space.

    ``rows`` takes vectors from body axes to these. ``spin`` is the angular velocity of the ground's matter in them,
    None where it does not turn.
    """

    rows: Float[Array, "3 3"]
    spin: Float[Array, "3"] | None

    @classmethod
    def of(cls, system: BodyParameters, t: Float[Array, ""], state: Any) -> "ContactAxes":
        """Computes the contact axes at a state."""
        if system.ground is None:
            return cls(state.Lambda, None)
        ground = locate_surface(system, t, state) or system.ground
        axes, spin = _axes_and_spin(ground, t, system.radius, state.z)
        under = Footing(axes)
        return cls(under.rows(state.Lambda), convert(under.to_axes, spin))

    def over_ground(self, Omega: Float[Array, "3"]) -> Float[Array, "3"]:
        """Computes the angular velocity of the body relative to the ground, from Ω."""
        return add(apply(self.rows, Omega), convert(jnp.negative, self.spin))

    def in_body(self, omega: Float[Array, "3"]) -> Float[Array, "3"]:
        """Computes Ω from the angular velocity relative to the ground."""
        return apply(self.rows.T, add(omega, self.spin))


def rate_of_carrier(
    system: BodyParameters, t: Float[Array, ""], state: Any, under: Footing | None = None
) -> Float[Array, "3"] | None:
    """Computes the rate of the components of ω relative to the ground while ω is constant, in body axes; None where its
    matter does not turn.

    These components change as the axes of the contact turn along the path of the contact point and with the ground.
    ``under`` is the footing of a body that touches its ground, that of rolling if not given.
    """
    under = footing(system, t, state) if under is None else under
    if under.spin is None:
        return None
    ground = surface_under(system, t, state) or system.ground
    assert ground is not None
    omega, u = apply(state.Lambda, state.Omega), state.z

    def components(t: Float[Array, ""], u: Coordinates) -> tuple[Float[Array, "3"], Float[Array, "3 3"] | None]:
        axes, spin = _axes_and_spin(ground, t, system.radius, u)
        return Footing(axes).to_axes(add(omega, convert(jnp.negative, spin))), axes

    # What turns in a plane turns as a whole, so that its rate is the same everywhere.
    along = jnp.zeros_like(u) if under.coordinate_rates is None else under.coordinate_rates
    _, rate, axes = jax.jvp(components, (t, u), (jnp.ones_like(t), along), has_aux=True)
    return apply(state.Lambda.T, Footing(axes).to_space(rate))


@eqx.filter_jit  # a function of programs, which ask for it at many places
def _axes_and_spin(
    ground: AbstractGround, t: Float[Array, ""], r: Float[Array, ""], u: Coordinates
) -> tuple[Float[Array, "3 3"] | None, Float[Array, "3"] | None]:
    """Returns the axes of the contact as rows, space axes, and the angular velocity of the ground's matter."""
    under = ground.footing(t, r, u, jnp.zeros((3,), r.dtype))
    return under.axes, under.spin
