"""External loads on the body: weight, the motion of the ground, the external force, and resistance."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...numerics.vectors import apply, cross
from ..forces.force import BodyMotion, Wrench
from ..grounds import Footing
from ..grounds.ground import Ground, TableMotion
from ..state import BallState, DiskState, ReducedState, RotationState, State
from .footing import Arm, arm_over_plane, footing, in_three, velocity_by_turning
from .moments import AbstractMoments
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
    footing: Footing | None = None

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
        if torque is None:
            return self
        return self._replace(torque=torque if self.torque is None else self.torque + torque)

    def about_contact(self, body_moments: AbstractMoments, r: Float[Array, ""]) -> Float[Array, "3"]:
        """Computes the torque of the load about the contact point: γ × (MrΓ + p) + rΓ × F̃ + T̃, with the arm for rΓ."""
        if self.gamma is None:
            # γ = gΓ is along rΓ, so only p is left of its lever, and weight and force share one product with Γ.
            push = self.g * body_moments.p if self.force is None else self.g * body_moments.p + r * self.force
            torque = cross(self.Gamma, push)
        else:
            torque = cross(self.gamma, body_moments.M * r * self.arm.along + body_moments.p)
            torque = torque if self.force is None else torque + r * cross(self.arm.along, self.force)
        return torque if self.torque is None else torque + self.torque


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
    r, g, Gamma, resisted = system.radius, system.gravity, state.Gamma, state.Omega
    gamma = force = torque = applied = velocity = W = None
    arm = arm_over_plane(system, Gamma, state.Omega)
    # With ``slip`` the caller knows the footing, which then is that of its own velocity.
    under = footing(system, t, state) if under is None else under
    if system.force is not None:
        assert not isinstance(state, ReducedState)
        applied = _external_wrench(system, t, state, slip, height, under)
        force, torque = applied
    if under is not None:
        assert not isinstance(state, ReducedState)
        assert system.ground is not None
        # Whatever acceleration the contact imposes on the body acts on its masses like a weight.
        into_body, turning = state.Lambda.T, apply(state.Lambda, state.Omega)
        Gamma = apply(into_body, under.normal)
        arm = Arm(Gamma, apply(into_body, under.normal_rate))
        velocity, resisted = apply(into_body, under.velocity), resisted - apply(into_body, under.spin)
        carried = under.acceleration + r * cross(turning, under.normal_rate)
        carried = carried if slip is None else carried + cross(under.turning, slip)
        gamma = apply(into_body, carried + system.ground.lift(t, g))
    elif system.ground is not None:
        assert not isinstance(state, ReducedState)
        lift = system.ground.lift(t, g)
        table = table_under(system, t, state, slip)
        if table is not None:
            W, velocity = table.W, apply(state.Lambda.T, in_three(table.velocity))
            lift = lift + in_three(table.acceleration)
        gamma = apply(state.Lambda.T, lift)
    if under is None and arm.rate is not None:
        gamma = (g * Gamma if gamma is None else gamma) + r * cross(state.Omega, arm.rate)
    if slip is not None:
        assert not isinstance(state, ReducedState)
        # ``velocity`` is that of the lowest point, to which rolling adds what the centre has.
        over = apply(state.Lambda.T, slip)
        velocity = over if velocity is None else velocity + over
    if system.resistance is not None:
        resistance, Omega = system.resistance, state.Omega
        rolling = r * cross(Omega, arm.along)
        medium = resistance.medium(rolling if velocity is None else rolling + velocity, Omega)
        resisting = resistance.contact_torque(resisted, Gamma, W)
        # In flight the ground resists nothing, but the medium does.
        resisting = resisting if touching is None else jnp.where(touching, resisting, 0.0)
        if medium is not None:
            force = medium[0] if force is None else force + medium[0]
            resisting = resisting + medium[1]
        torque = resisting if torque is None else torque + resisting
    return Load(g, Gamma, gamma, force, torque, applied, resisted, arm, under)


def _external_wrench(
    system: BodyParameters,
    t: Float[Array, ""],
    state: BallState | RotationState | DiskState,
    slip: Float[Array, "3"] | None,
    height: Float[Array, ""] | None,
    under: Footing | None,
) -> Wrench:
    """Computes the external force and its torque in body axes; on a disk, their parts in its plane."""
    assert system.force is not None
    if under is not None:
        position, velocity = under.centre, under.centre_velocity
    else:
        drift = system.drift(t, state)
        velocity = velocity_by_turning(system, state.Lambda, state.Omega)
        velocity = velocity if drift is None else velocity + in_three(drift)
        position = in_three(place(state))
        if height is not None or system.shape is not None:
            position = position.at[2].set(height_over_origin(system, state.Gamma, height))
    velocity = velocity if slip is None else velocity + slip
    motion = BodyMotion(position, velocity, state.Lambda, state.Omega, state.theta, state.thetadot, state.own)
    force, torque = system.force.wrench(t, motion)
    if system.planar:
        force = force.at[1].set(0.0)
        torque = None if torque is None else jnp.zeros_like(torque).at[1].set(torque[1])
    into_body = state.Lambda.T
    return Wrench(apply(into_body, force), None if torque is None else apply(into_body, torque))


def place(state: BallState | RotationState | DiskState) -> Float[Array, "2"]:
    """Returns the place of the geometric centre over the plane; a disk moves along e1."""
    return jnp.stack([state.z, jnp.zeros_like(state.z)]) if isinstance(state, DiskState) else state.z


def height_over_origin(
    system: BodyParameters, Gamma: Float[Array, "3"], height: Float[Array, ""] | None
) -> Float[Array, ""]:
    """Computes the third coordinate of the geometric centre of a body at a height over the plane, which is at −r."""
    height = jnp.zeros_like(system.radius) if height is None else height
    return height if system.shape is None else height + (system.shape.height(Gamma) - system.radius)


def table_under(
    system: BodyParameters, t: Float[Array, ""], state: State, slip: Float[Array, "3"] | None = None
) -> TableMotion | None:
    """Computes the motion of a turntable under the body's centre; None without one. ``slip`` is as in :func:`load`."""
    if not isinstance(system.ground, Ground) or system.ground.turntable is None:
        return None
    assert isinstance(state, BallState | RotationState)
    over = velocity_by_turning(system, state.Lambda, state.Omega)[:2]
    return system.ground.table_motion(t, state.z, over if slip is None else over + slip[:2])
