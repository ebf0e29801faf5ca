"""Everything that can be read off a state: positions, energies, forces."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..interface.printing import Printed, in_short
from ..numerics.vectors import apply, dot
from .body import AbstractBody
from .contact import contact_force, reaction_in_body
from .dynamics import accelerations
from .energy import accelerations_of_masses, actuation_power, dissipation, kinetic_energy, potential_energy
from .load import in_three, load
from .moments import joint_motion, kinematics, point_mass_values, principal_inertia
from .momentum import linear_momentum
from .motion import Kinematics
from .state import BallState, DiskState, centre_velocity


class Observables(Printed):
    """What is observed at one time, or along a leading axis of times.

    Positions named ``…_body`` are in body axes and drawn from the geometric centre; those named
    ``…_space`` are in space axes, drawn from it too. ``geometric_centre`` and ``contact_point`` are
    places in space, with the plane at height −r. The contact force acts on the ball.

    **Arguments:** each with the times, if there are many, as leading axes.

    - ``mass_positions_body``, ``mass_positions_space``: of the point masses, and then of those of mechanisms, length,
      shape (n, 3).
    - ``centre_of_mass_body``, ``centre_of_mass_space``: length, shape (3,).
    - ``geometric_centre``, ``contact_point``: length, shape (3,).
    - ``vertical_body``: Γ, shape (3,).
    - ``angular_velocity_body``, ``angular_velocity_space``, ``angular_acceleration_body``: Ω, ω = ΛΩ and Ω̇, in
      rad/time and rad/time², shape (3,).
    - ``kinetic_energy``, ``potential_energy``: T and V, mass length²/time².
    - ``power``: Ė, of all that does work together: the actuation, the external force, resistance and the ground's
      motion, mass length²/time³.
    - ``dissipation``: what of it resistance takes away, 0 or positive unless a coefficient is negative.
    - ``normal_force``, ``friction``: N, and the two components of f, shape (2,), mass length/time².
    - ``friction_ratio``: |f| / N.
    - ``joint_angles``, ``joint_rates``: θ and θ̇ of every joint of every mechanism, in their order, shape (joints,).
    - ``joint_efforts``: Q of each, the torque of a hinge and the force along a slider, shape (joints,); that of the
      motor that a joint needs which a schedule or a law moves. Its power is Q θ̇.

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
    kinetic_energy: Float[Array, "*t"]
    potential_energy: Float[Array, "*t"]
    power: Float[Array, "*t"]  # Ė
    dissipation: Float[Array, "*t"]
    normal_force: Float[Array, "*t"]  # N
    friction: Float[Array, "*t 2"]  # f
    friction_ratio: Float[Array, "*t"]  # |f| / N
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
    """The observables of a ball or a disk at time ``t``. A disk is observed in space.

    **Arguments:**

    - ``system``: a :class:`~jaxball.Ball` or a :class:`~jaxball.Disk`.
    - ``t``: time.
    - ``state``: of one of the kinds that know where the body is.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Ball, BallState, observe
    >>> ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), radius=0.5)
    >>> observe(ball, jnp.array(0.0), BallState(z=(3.0, 4.0))).contact_point
    Array([ 3. ,  4. , -0.5], dtype=float64)
    """
    acting = load(system, t, state)
    found = accelerations(system, t, state, acting)
    in_space = state.in_space()
    r, g, Omega, Lambda = system.radius, system.gravity, in_space.Omega, in_space.Lambda
    Gamma, omega, Omegadot = Lambda[2], apply(Lambda, Omega), found.Omegadot
    at, points = found.at, kinematics(system, t, found.angles)
    still = jnp.zeros((1, 3), dtype=Omega.dtype)
    with_shell = Kinematics(
        jnp.concatenate([system.offset[None], points.chi]),
        jnp.concatenate([still, points.chidot]),
        jnp.concatenate([still, points.chiddot]),
    )
    m = jnp.concatenate([system.mass[None], point_mass_values(system)])
    a = accelerations_of_masses(r, with_shell, Omega, Omegadot, Gamma)
    contact = contact_force(reaction_in_body(at, r, acting, Omega, Omegadot), Lambda)
    u = system.drift(t, in_space)
    drift = None if u is None else apply(Lambda.T, in_three(u))
    up = jnp.zeros_like(Omega).at[2].set(1.0) if system.ground is None else system.ground.up()
    centre = in_three(in_space.z)
    force = jnp.zeros_like(Omega) if system.force is None else system.force(t)
    velocity = in_three(centre_velocity(Lambda, Omega, r, u))
    lost = dissipation(acting, found.dry, force, Lambda, velocity, omega)
    power = actuation_power(m, with_shell, a, acting.weight) + dot(force, velocity) - lost
    if u is not None:
        power = power + jnp.sum(contact.friction * u)
    if system.ground is not None and system.ground.motion is not None:
        P = apply(Lambda, linear_momentum(at, r, Omega, Gamma) + (0.0 if drift is None else at.M * drift))
        power = power - dot(system.ground.motion.kinematics(t).chiddot, P)
    joints = joint_motion(system, t, found.angles, a[1:] + acting.weight[None])
    return Observables(
        mass_positions_body=points.chi,
        mass_positions_space=jnp.sum(Lambda[None] * points.chi[:, None, :], axis=-1),
        centre_of_mass_body=at.p / at.M,
        centre_of_mass_space=apply(Lambda, at.p) / at.M,
        geometric_centre=centre,
        contact_point=centre - jnp.stack([jnp.zeros_like(r), jnp.zeros_like(r), r]),
        vertical_body=Gamma,
        angular_velocity_body=Omega,
        angular_velocity_space=omega,
        angular_acceleration_body=Omegadot,
        kinetic_energy=kinetic_energy(m, principal_inertia(system), r, with_shell, Omega, Gamma, drift),
        potential_energy=potential_energy(m, g, with_shell, apply(Lambda.T, up), dot(up, centre)),
        power=power,
        dissipation=lost,
        normal_force=contact.normal,
        friction=contact.friction,
        friction_ratio=contact.ratio,
        joint_angles=joints.theta,
        joint_rates=joints.thetadot,
        joint_efforts=joints.effort,
    )
