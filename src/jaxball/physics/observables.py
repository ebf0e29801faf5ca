"""All observables of a state: positions, energies, forces."""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .. import programs
from ..interface.arguments import refusal
from ..interface.printing import Printed, in_short
from ..numerics.arrays import to_array
from ..numerics.kinks import just_before
from ..numerics.vectors import add, apply, convert, cross, dot
from .body import AbstractBody
from .contact.body_on_plane import BodyOnPlane
from .contact.modes import Mode
from .contact.released import load_of_released
from .dynamics.dry_friction import TurningMode
from .dynamics.equations import accelerations, angles_in_state, equations
from .dynamics.footing import place_of_centre, velocity_by_turning
from .dynamics.load import (
    Load,
    accelerations_of_masses,
    actuation_power,
    dissipation,
    external_power,
    kinetic_energy,
    load,
    potential_energy,
    power_of_turning_ground,
)
from .dynamics.locked import contact_momentum, linear_momentum, reaction_in_body
from .dynamics.moments import (
    VelocityMoments,
    along_rails,
    joint_motion,
    kinematics,
    point_mass_values,
    principal_inertia,
)
from .grounds.ground import Ground
from .prescribed.motion import Kinematics
from .rolling import Reaction
from .state import BallState, DiskState, Rates, ReducedState, RotationState, State
from .system import require_one_state


class Observables(Printed):
    """The observables at one time, or along a leading axis of times.

    Positions named ``…_body`` are in body axes, relative to the geometric centre; those named ``…_space`` are in space
    axes, also relative to it. ``geometric_centre`` and ``contact_point`` are positions in space, with the plane at
    height −r, or a surface where it was put. The contact force acts on the ball.

    **Arguments:** each with a leading axis of times, if there are several.

    - ``mass_positions_body``, ``mass_positions_space``: of the point masses, and then of those of mechanisms, length,
      shape (n, 3).
    - ``centre_of_mass_body``, ``centre_of_mass_space``: length, shape (3,).
    - ``geometric_centre``, ``contact_point``: length, shape (3,).
    - ``vertical_body``: Γ, shape (3,).
    - ``angular_velocity_body``, ``angular_velocity_space``, ``angular_acceleration_body``: Ω, ω = ΛΩ and Ω̇, in
      rad/time and rad/time², shape (3,).
    - ``contact_momentum``: Π, the angular momentum about the body's lowest point, relative to the plane and in body
      axes, mass length²/time, shape (3,).
    - ``kinetic_energy``, ``potential_energy``: T and V, mass length²/time².
    - ``power``: Ė, the total of the actuation, the external force, resistance and the ground's motion, mass
      length²/time³.
    - ``dissipation``: the power dissipated by resistance, 0 or positive unless a coefficient is negative.
    - ``contact_force``: R, space axes, shape (3,), mass length/time².
    - ``normal_force``, ``friction``: N, and the two components of f, shape (2,), mass length/time²; on a surface p
      along ∂p/∂u1 and across, which with its normal are right-handed.
    - ``friction_ratio``: |f| / N; 0 in flight.
    - ``mass_angles``, ``mass_rates``: θ and θ̇ of every point mass on a rail, in their order, shape (rails,).
    - ``joint_angles``, ``joint_rates``: θ and θ̇ of every joint of every mechanism, in their order, shape (joints,).
    - ``joint_efforts``: Q of each, the torque of a hinge and the force along a slider, shape (joints,); for a joint
      that a schedule or a law moves, the effort that its motor needs. Its power is Q θ̇.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Disk, DiskState, observe
    >>> seen = observe(Disk(mass=2.0, inertia=1.0), jnp.array(0.0), DiskState(phidot=-1.0))
    >>> float(seen.energy), float(seen.normal_force)  # T = ½ (m r² + d2) φ̇² and V = 0, N = m g
    (1.5, 2.0)
    """

    mass_positions_body: Float[Array, "*t n 3"]
    mass_positions_space: Float[Array, "*t n 3"]
    centre_of_mass_body: Float[Array, "*t 3"]
    centre_of_mass_space: Float[Array, "*t 3"]
    geometric_centre: Float[Array, "*t 3"]
    contact_point: Float[Array, "*t 3"]
    vertical_body: Float[Array, "*t 3"]  # Γ
    angular_velocity_body: Float[Array, "*t 3"]  # Ω
    angular_velocity_space: Float[Array, "*t 3"]  # ω = ΛΩ
    angular_acceleration_body: Float[Array, "*t 3"]  # Ω̇
    contact_momentum: Float[Array, "*t 3"]  # Π
    kinetic_energy: Float[Array, "*t"]
    potential_energy: Float[Array, "*t"]
    power: Float[Array, "*t"]  # Ė
    dissipation: Float[Array, "*t"]
    contact_force: Float[Array, "*t 3"]  # R
    normal_force: Float[Array, "*t"]  # N
    friction: Float[Array, "*t 2"]  # f
    friction_ratio: Float[Array, "*t"]  # |f| / N
    mass_angles: Float[Array, "*t rails"]
    mass_rates: Float[Array, "*t rails"]
    joint_angles: Float[Array, "*t joints"]
    joint_rates: Float[Array, "*t joints"]
    joint_efforts: Float[Array, "*t joints"]

    def __repr__(self) -> str:
        return "\n".join(["Observables", *(f"  {name}: {in_short(value)}" for name, value in vars(self).items())])

    @property
    def energy(self) -> Float[Array, "*t"]:
        """E = T + V."""
        return self.kinetic_energy + self.potential_energy


def observe(system: AbstractBody, t: Float[Array, ""], state: BallState | DiskState) -> Observables:
    """Computes the observables of a ball or a disk at time ``t``. A disk is observed in space.

    **Arguments:**

    - ``system``: a :class:`~jaxball.Ball` or a :class:`~jaxball.Disk`.
    - ``t``: time.
    - ``state``: of a kind that contains the position of the body.

    **Raises:** ``TypeError`` when the body has no state of that kind, ``ValueError`` for several states; use
    ``jax.vmap`` or, for a run, its ``observables``.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Ball, BallState, observe
    >>> ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), radius=0.5)
    >>> observe(ball, jnp.array(0.0), BallState(z=(3.0, 4.0))).contact_point
    Array([ 3. ,  4. , -0.5], dtype=float64)
    """
    if isinstance(state, ReducedState):
        raise refusal("state", "one that contains the position of the body, such as a BallState", state)
    require_one_state(system, state)
    return compute_observables(system, t, movement(system, t, state))


class Movement(NamedTuple):
    """The motion of a body at one moment: its accelerations, and what acts on it.

    Ω̇ in body axes, θ, θ̇ and θ̈, the load, the moments, the torque of dry friction, R in space axes, and the slip of a
    body that need not roll.
    """

    state: BallState
    Omegadot: Float[Array, "3"]
    angles: Rates
    acting: Load
    body_moments: VelocityMoments
    dry: Float[Array, "3"] | None
    R: Float[Array, "3"]
    slip: "Slip | None"

    @property
    def weight(self) -> Float[Array, "3"]:
        """γ + Λ⁻¹v̇_s, with which a + γ is the force that a unit of mass needs anywhere in the body; body axes."""
        slips = None if self.slip is None else apply(self.state.Lambda.T, self.slip.acceleration)
        return add(self.acting.weight, slips)


class Slip(NamedTuple):
    """The motion of a body besides rolling: v_s and v̇_s in space axes, and its height above the ground."""

    velocity: Float[Array, "3"]
    acceleration: Float[Array, "3"]
    height: Float[Array, ""]


@functools.singledispatch
def movement(system: Any, t: Float[Array, ""], state: Any) -> Movement:
    """Computes the motion of a body from its state: of one that rolls, or of one on its plane that may slide
    and fly.
    """
    raise refusal("system", "a Ball or a Disk", system)


@movement.register
def _of_rolling(system: AbstractBody, t: Float[Array, ""], state: Any, mode: TurningMode | None = None) -> Movement:
    state = state.in_space() if isinstance(state, RotationState) else state
    acting = load(system, t, state)
    solution = accelerations(system, t, state, acting, mode)
    in_space = state.in_space()
    reaction = reaction_in_body(solution.body_moments, system.radius, acting, in_space.Omega, solution.Omegadot)
    R = apply(in_space.Lambda, reaction)
    return Movement(in_space, solution.Omegadot, solution.angles, acting, solution.body_moments, solution.dry, R, None)


@movement.register
def _of_hybrid(plane: BodyOnPlane, t: Float[Array, ""], state: Any) -> Movement:
    if plane.contact is None:
        return _of_rolling(plane.moving(state), t, state.body, plane.mode(t, state))
    response = plane.response(t, state)
    force = plane.interaction(t, state, response)
    system, body = plane.moving(state), state.body
    touching = ~state.is_in(Mode.FLIGHT)
    acting, slip = load_of_released(system, t, state.released, touching, response.footing)
    Omegadot, thetaddot = (response.part(name, force.amounts) for name in ("Omegadot", "thetaddot"))
    return Movement(
        body if isinstance(body, BallState) else body.in_space(),
        Omegadot,
        (body.theta, body.thetadot, thetaddot),
        acting,
        equations(system, t, body).body_moments,
        plane.dry_torque(t, state, force, acting),
        response.footing.to_space(force.R),
        Slip(slip, response.footing.to_space(force.slip_acceleration), state.height),
    )


def compute_observables(system: AbstractBody, t: Float[Array, ""], motion: Movement) -> Observables:
    """Computes the observables of a body from its motion."""
    in_space, body_moments, acting, slip = motion.state, motion.body_moments, motion.acting, motion.slip
    r, g, Omega, Lambda = system.radius, system.gravity, in_space.Omega, in_space.Lambda
    under, omega, Omegadot, arm = acting.footing, apply(Lambda, Omega), motion.Omegadot, acting.arm.along
    points = kinematics(system, t, motion.angles)
    still = jnp.zeros((1, 3), dtype=Omega.dtype)
    with_shell = Kinematics(
        jnp.concatenate([system.offset[None], points.chi]),
        jnp.concatenate([still, points.chidot]),
        jnp.concatenate([still, points.chiddot]),
    )
    m = jnp.concatenate([system.mass[None], point_mass_values(system)])
    a = accelerations_of_masses(r, with_shell, Omega, Omegadot, arm)
    weight = motion.weight
    centre, foot = _places(system, motion)
    R = under.to_axes(motion.R)
    contact = Reaction(R[2], jnp.sum(R[:2] ** 2))
    # The velocity of the lowest point, and of the centre.
    lowest = add(under.velocity, None if slip is None else slip.velocity)
    velocity = add(velocity_by_turning(system, Lambda, Omega, under), lowest)
    # Momentum and energy are those of rolling on a plane at rest, with the velocity of the lowest point added to every
    # mass.
    square = None if system.shape is None else dot(arm, arm)
    drift = convert(lambda lowest: apply(Lambda.T, lowest), lowest)
    moved = convert(lambda drift: cross(body_moments.M * r * arm + body_moments.p, drift), drift)
    Pi = add(contact_momentum(body_moments, r, Omega, arm, square), moved)
    up = system.up
    lost = dissipation(acting, motion.dry, Lambda, velocity, omega)
    supplied = power_of_turning_ground(system, acting, motion.dry, Lambda)
    lost = add(lost, supplied)
    if slip is not None:
        lost = lost - dot(motion.R, slip.velocity)
    power = actuation_power(m, with_shell, a, weight) - lost
    if acting.applied is not None:
        power = power + external_power(acting.applied, Lambda, velocity, omega)
    power = add(power, supplied, convert(lambda w: dot(motion.R, w), under.velocity))
    # Energy is relative to the axes that move with the plane, in which −m Ẍ acts on each mass.
    if isinstance(system.ground, Ground) and system.ground.motion is not None:
        carried = convert(lambda drift: body_moments.M * drift, drift)
        P = apply(Lambda, add(linear_momentum(body_moments, r, Omega, arm), carried))
        power = power - dot(system.ground.motion.kinematics(t).chiddot, P)
    on_rails, places = along_rails(system, t, motion.angles), np.asarray(system.on_rails, dtype=int)
    joints = joint_motion(system, t, motion.angles, a[1:] + weight[None])
    return Observables(
        mass_positions_body=points.chi,
        mass_positions_space=jnp.sum(Lambda[None] * points.chi[:, None, :], axis=-1),
        centre_of_mass_body=body_moments.p / body_moments.M,
        centre_of_mass_space=apply(Lambda, body_moments.p) / body_moments.M,
        geometric_centre=centre,
        contact_point=foot,
        vertical_body=Lambda[2],
        angular_velocity_body=Omega,
        angular_velocity_space=omega,
        angular_acceleration_body=Omegadot,
        contact_momentum=Pi,
        kinetic_energy=kinetic_energy(m, principal_inertia(system), r, with_shell, Omega, arm, drift),
        potential_energy=potential_energy(m, g, with_shell, apply(Lambda.T, up), dot(up, centre)),
        power=power,
        dissipation=lost,
        contact_force=motion.R,
        normal_force=contact.normal,
        friction=R[:2],
        friction_ratio=contact.ratio if slip is None else jnp.where(contact.normal == 0, 0.0, contact.ratio),
        mass_angles=on_rails.theta[places],
        mass_rates=on_rails.thetadot[places],
        joint_angles=joints.theta,
        joint_rates=joints.thetadot,
        joint_efforts=joints.effort,
    )


def _places(system: AbstractBody, motion: Movement) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
    """Computes where the geometric centre is, and the contact point: on the ground below a body that flies."""
    in_space, under, r = motion.state, motion.acting.footing, system.radius
    centre = place_of_centre(system, in_space, under, None if motion.slip is None else motion.slip.height)
    if under.foot is not None:
        return centre, under.foot
    standing = place_of_centre(system, in_space, under, None)
    zero = jnp.zeros_like(r)
    arm = jnp.stack([zero, zero, r]) if system.shape is None else apply(in_space.Lambda, r * motion.acting.arm.along)
    return centre, standing - arm


def evaluate_schedules(
    system: AbstractBody, times: Float[Array, " T"]
) -> dict[int, tuple[Float[np.ndarray, " t"], Float[np.ndarray, " t"]]]:
    """Evaluates θ̈ of each mass with a schedule, by its index, at ``times`` and on both sides of the kinks between them.

    A jump at the last time is left out: that is evaluated just before it, and its time is the one returned.
    """
    evaluated, t = {}, np.asarray(times)
    for index, mass in enumerate(system.point_masses):
        if mass.schedule is None:
            continue
        kinks, end = map(np.asarray, _kinks_and_end(mass.schedule, times[-1]))
        kinks = kinks[(kinks > t[0]) & (kinks < end)]
        # With a time just before each kink, where a schedule has the value of the earlier side.
        sides = np.unique(np.concatenate([t[:-1], end[None], kinks, np.nextafter(kinks, t.dtype.type(-np.inf))]))
        evaluated[index] = sides, np.asarray(_accelerations(mass.schedule, to_array(sides)))
    return evaluated


@programs.filter_jit
def _kinks_and_end(schedule, end):
    kinks = schedule.kinks().astype(end.dtype)
    return kinks, just_before(kinks, end)


@programs.filter_jit
def _accelerations(schedule, times):
    return jax.vmap(schedule.prepare().derivatives)(times)[2]


def evaluate_law(system: AbstractBody, times: Float[Array, " T"], states: State) -> Float[Array, "T coordinates"]:
    """Evaluates θ̈ of every coordinate in the states' ``theta`` at their times; traceable.

    The states may be of any kind; accelerations that no law gives are 0.
    """
    prepared = system.prepare()
    return jax.vmap(lambda t, state: angles_in_state(prepared, t, state)[2])(times, states)
