"""External loads on the body, weight, the motion of the ground, the external force and resistance, and their power.

With them is the energy of the ball (section 3.1). The ``arm`` is Γ, or what a body that is no sphere has in its place.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...numerics.vectors import add, apply, convert, cross, dot
from ..forces.force import BodyMotion, Wrench
from ..grounds import Footing
from ..grounds.ground import AT_REST
from ..prescribed.motion import Kinematics
from ..state import PlacedState, ReducedState, State
from .footing import Arm, arm_over, footing, place_of_centre, velocity_of_centre
from .moments import VelocityMoments
from .parameters import BodyParameters


class Load(NamedTuple):
    """The load on a body, in body axes.

    ``gamma`` is γ = Λ⁻¹(Ẍ + u̇ − **g**), and None on a level plane at rest, where it is gΓ. ``force`` is F̃ of all
    forces at the geometric centre, ``torque`` T̃ of all torques, each None where there are none. ``applied`` is the
    contribution of the external force and its torque to both. ``resisted`` is the angular velocity that friction at
    the contact resists.

    On a surface, ``footing`` says how it holds the body, Γ is its normal instead of the vertical, and
    γ = Λ⁻¹(ẇ + r ω × ṅ − **g**), with ν × v_s more where the body slips and the contact axes turn at ν. ``arm`` is that
    from the contact to the centre; where it changes in space, as under a body that is no sphere, r ω × its rate takes
    the place of r ω × ṅ.
    """

    g: Float[Array, ""]
    Gamma: Float[Array, "3"]
    gamma: Float[Array, "3"] | None
    force: Float[Array, "3"] | None
    torque: Float[Array, "3"] | None
    applied: Wrench | None
    resisted: Float[Array, "3"]
    arm: Arm
    footing: Footing = AT_REST

    @property
    def weight(self) -> Float[Array, "3"]:
        """γ: the upward weight of a unit of mass at rest in the space axes."""
        return self.g * self.Gamma if self.gamma is None else self.gamma

    def of_momenta(self, r: Float[Array, ""], Omega: Float[Array, "3"]) -> "Load":
        """Returns the load in the balances of momenta about the contact point, whose rates contain that of the arm: γ
        without what this adds.
        """
        if self.arm.rate is None:
            return self
        assert self.gamma is not None
        return self._replace(gamma=self.gamma - r * cross(Omega, self.arm.rate))

    def with_torque(self, torque: Float[Array, "3"] | None) -> "Load":
        """Returns the load with one more torque, body axes, if there is one."""
        return self._replace(torque=add(self.torque, torque))

    def about_contact(self, body_moments: VelocityMoments, r: Float[Array, ""]) -> Float[Array, "3"]:
        """Computes the torque of the load about the contact point: γ × (MrΓ + p) + rΓ × F̃ + T̃, with the arm for rΓ."""
        if self.gamma is None:
            # γ = gΓ is along rΓ, so only p is left of its lever, and weight and force share one product with Γ.
            push = add(self.g * body_moments.p, convert(lambda force: r * force, self.force))
            return add(cross(self.Gamma, push), self.torque)
        weight = cross(self.gamma, body_moments.M * r * self.arm.along + body_moments.p)
        force = convert(lambda force: r * cross(self.arm.along, force), self.force)
        return add(weight, force, self.torque)


def load(
    system: BodyParameters,
    t: Float[Array, ""],
    state: State,
    slip: Float[Array, "3"] | None = None,
    touching: Bool[Array, ""] | None = None,
    height: Float[Array, ""] | None = None,
    under: Footing | None = None,
) -> Load:
    """Computes the load at a state, except dry friction, which depends on the normal force.

    ``slip`` is the slip velocity in space axes, where the body does not roll; ``touching`` whether the plane resists
    its turning, which it does if not given; ``height`` how far the body is over the plane, 0 if not given; ``under``
    its footing on a surface, that of rolling if not given. Reduced states, which do not contain Λ, are refused where an
    external force acts or the ground is not level and at rest.
    """
    r, g, Omega = system.radius, system.gravity, state.Omega
    # With ``slip`` the caller knows the footing, which then is that of its own velocity.
    under = footing(system, t, state) if under is None else under

    def in_body(v: Float[Array, "3"] | None) -> Float[Array, "3"] | None:
        return convert(lambda v: apply(_require_attitude(state).Lambda.T, v), v)

    arm, resisted = arm_over(system, state, under), add(Omega, convert(jnp.negative, in_body(under.spin)))
    # Γ, or the normal of a surface.
    normal = state.Gamma if under.axes is None else arm.along
    # Whatever acceleration the contact imposes on the body acts on its masses like a weight.
    turned = None if slip is None or under.turning is None else cross(under.turning, slip)
    lift = None if system.ground is None else system.ground.lift(t, g)
    gamma = in_body(add(under.acceleration, turned, lift))
    if arm.rate is not None:
        gamma = add(g * normal if gamma is None else gamma, r * cross(Omega, arm.rate))
    # That of the lowest point, to which rolling adds what the centre has.
    velocity = in_body(add(under.velocity, slip))
    applied = None if system.force is None else _external_wrench(system, t, state, slip, height, under)
    force, torque = (None, None) if applied is None else applied
    if system.resistance is not None:
        resistance = system.resistance
        medium = resistance.medium(add(r * cross(Omega, arm.along), velocity), Omega)
        resisting = resistance.contact_torque(resisted, normal)
        # In flight the ground resists nothing, but the medium does.
        resisting = resisting if touching is None else jnp.where(touching, resisting, 0.0)
        if medium is not None:
            force, resisting = add(force, medium[0]), resisting + medium[1]
        torque = add(torque, resisting)
    return Load(g, normal, gamma, force, torque, applied, resisted, arm, under)


def _require_attitude(state: State) -> PlacedState:
    """Returns a state that says how the body is turned in space, which a reduced one does not."""
    assert not isinstance(state, ReducedState)
    return state


def _external_wrench(
    system: BodyParameters,
    t: Float[Array, ""],
    state: State,
    slip: Float[Array, "3"] | None,
    height: Float[Array, ""] | None,
    under: Footing,
) -> Wrench:
    """Computes the external force and its torque in body axes; on a disk, their parts in its plane."""
    assert system.force is not None
    state = _require_attitude(state)
    position = place_of_centre(system, state, under, height)
    velocity = add(velocity_of_centre(system, state, under), slip)
    motion = BodyMotion(position, velocity, state.Lambda, state.Omega, state.theta, state.thetadot, state.own)
    force, torque = system.force.wrench(t, motion)
    if system.planar:
        force = force.at[1].set(0.0)
        torque = convert(lambda torque: jnp.zeros_like(torque).at[1].set(torque[1]), torque)
    into_body = state.Lambda.T
    return Wrench(apply(into_body, force), convert(lambda torque: apply(into_body, torque), torque))


def kinetic_energy(
    m: Float[Array, " n_plus_one"],
    inertia: Float[Array, "3 3"],
    r: Float[Array, ""],
    masses: Kinematics,
    Omega: Float[Array, "3"],
    arm: Float[Array, "3"],
    drift: Float[Array, "3"] | None = None,
) -> Float[Array, ""]:
    """Computes T = ½ Ω·𝕀Ω + ½ Σ m |Ω × s + χ̇ + Λ⁻¹u|², over the shell (first) and the point masses.

    ``drift`` is Λ⁻¹ of what every mass has besides the velocity of rolling on a plane at rest, if there is any.
    """
    Y = add(velocities(r, masses, Omega, arm), convert(lambda drift: drift[None], drift))
    return 0.5 * dot(Omega, apply(inertia, Omega)) + 0.5 * jnp.sum(m * jnp.sum(Y**2, axis=1))


def velocities(
    r: Float[Array, ""], masses: Kinematics, Omega: Float[Array, "3"], arm: Float[Array, "3"]
) -> Float[Array, "n 3"]:
    """Computes Y = Ω × s + χ̇, the velocities in space of masses that roll with the ball, ``eq:roll_c_con``;
    body axes.
    """
    return jax.vmap(lambda chi, chidot: cross(Omega, r * arm + chi) + chidot)(masses.chi, masses.chidot)


def accelerations_in_turning_axes(
    Omega: Float[Array, "*rows 3"],
    x: Float[Array, "*rows 3"],
    xdot: Float[Array, "*rows 3"],
    xddot: Float[Array, "*rows 3"],
) -> Float[Array, "*rows 3"]:
    """Computes Ω × (Ω × x + 2ẋ) + ẍ, centrifugal, Coriolis's and relative acceleration in axes that turn at a constant
    Ω.
    """
    return cross(Omega, cross(Omega, x) + 2 * xdot) + xddot


def accelerations_of_masses(
    r: Float[Array, ""],
    masses: Kinematics,
    Omega: Float[Array, "3"],
    Omegadot: Float[Array, "3"],
    arm: Float[Array, "3"],
) -> Float[Array, "n 3"]:
    """Computes a = Ω̇ × s + Ω × (Ω × χ + 2χ̇) + χ̈, the accelerations in space of the masses; body axes."""

    def one(chi, chidot, chiddot):
        return cross(Omegadot, r * arm + chi) + accelerations_in_turning_axes(Omega, chi, chidot, chiddot)

    return jax.vmap(one)(*masses)


def potential_energy(
    m: Float[Array, " n_plus_one"],
    g: Float[Array, ""],
    masses: Kinematics,
    up: Float[Array, "3"],
    height: Float[Array, ""],
) -> Float[Array, ""]:
    """Computes V = g Σ m (χ·Λ⁻¹up + height): zero where every mass is at the height of the origin of space.

    ``up`` is the vertical in body axes, which is Γ on a level plane, and ``height`` that of the geometric centre.
    """
    return g * jnp.sum(m * (jnp.sum(masses.chi * up[None], axis=1) + height))


def actuation_power(
    m: Float[Array, " n_plus_one"], masses: Kinematics, a: Float[Array, "n_plus_one 3"], weight: Float[Array, "3"]
) -> Float[Array, ""]:
    """Computes Σ m χ̇·(γ + a), the rate at which motors and all other forces within the body do work;
    ``weight`` is γ.
    """
    return jnp.sum(m * jnp.sum(masses.chidot * (weight[None] + a), axis=1))


def dissipation(
    acting: Load,
    dry: Float[Array, "3"] | None,
    Lambda: Float[Array, "3 3"],
    velocity: Float[Array, "3"],
    omega: Float[Array, "3"],
) -> Float[Array, ""]:
    """Computes the power that resistance takes from the body: −T·ω − F_m·ż, without the external force.

    A ground that turns gives back a part, :func:`power_of_turning_ground`. ``dry`` is the torque of dry friction in
    body axes, and ``velocity`` ż.
    """
    turned = (convert(lambda torque: -dot(apply(Lambda, torque), omega), torque) for torque in (acting.torque, dry))
    moved = convert(lambda force: -dot(apply(Lambda, force), velocity), acting.force)
    supplied = None if acting.applied is None else external_power(acting.applied, Lambda, velocity, omega)
    return add(jnp.zeros_like(acting.g), *turned, moved, supplied)


def power_of_turning_ground(
    system: BodyParameters, acting: Load, dry: Float[Array, "3"] | None, Lambda: Float[Array, "3 3"]
) -> Float[Array, ""] | None:
    """Computes T·ω_g, the power of a ground whose matter turns at ω_g by the torque of its resistance; None otherwise.

    What is dissipated there is −T·(ω − ω_g). ``dry`` is the torque of dry friction in body axes.
    """
    spin, resistance = acting.footing.spin, system.resistance
    if spin is None:
        return None
    smooth = None if resistance is None else resistance.contact_torque(acting.resisted, acting.Gamma)
    return convert(lambda torque: dot(apply(Lambda, torque), spin), add(smooth, dry))


def external_power(
    applied: Wrench, Lambda: Float[Array, "3 3"], velocity: Float[Array, "3"], omega: Float[Array, "3"]
) -> Float[Array, ""]:
    """Computes F·ż + T·ω, the rate at which the external force and its torque, in body axes, do work."""
    turned = convert(lambda torque: dot(apply(Lambda, torque), omega), applied.torque)
    return add(dot(apply(Lambda, applied.force), velocity), turned)
