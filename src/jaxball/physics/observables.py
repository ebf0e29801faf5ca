"""Everything that can be read off a state: positions, energies, forces."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..interface.printing import Printed, in_short
from ..numerics.vectors import apply
from .body import AbstractBody
from .contact import contact_force
from .dynamics import driven_angles
from .energy import actuation_power, force_power, kinetic_energy, potential_energy
from .moments import kinematics, moments, point_mass_values, principal_inertia
from .motion import Kinematics
from .state import BallState, DiskState


class Observables(Printed):
    """What is observed at one time, or along a leading axis of times.

    Positions named ``…_body`` are in body axes and drawn from the geometric centre; those named
    ``…_space`` are in space axes, drawn from it too. ``geometric_centre`` and ``contact_point`` are
    places in space, with the plane at height −r. The contact force acts on the ball.

    **Arguments:** each with the times, if there are many, as leading axes.

    - ``mass_positions_body``, ``mass_positions_space``: length, shape (n, 3).
    - ``centre_of_mass_body``, ``centre_of_mass_space``: length, shape (3,).
    - ``geometric_centre``, ``contact_point``: length, shape (3,).
    - ``vertical_body``: Γ, shape (3,).
    - ``angular_velocity_body``, ``angular_velocity_space``, ``angular_acceleration_body``: Ω, ω = ΛΩ and Ω̇, in
      rad/time and rad/time², shape (3,).
    - ``kinetic_energy``, ``potential_energy``: T and V, mass length²/time².
    - ``power``: Ė, of the actuation and the external force together, mass length²/time³.
    - ``normal_force``, ``friction``: N, and the two components of f, shape (2,), mass length/time².
    - ``friction_ratio``: |f| / N.

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
    power: Float[Array, "*t"]  # Ė, of the actuation and the external force together
    normal_force: Float[Array, "*t"]  # N
    friction: Float[Array, "*t 2"]  # f
    friction_ratio: Float[Array, "*t"]  # |f| / N

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
    angles = driven_angles(system, t, state)
    rates = system.field(t, state)
    return _observe(system, t, state.in_space(), rates.in_space().Omega, angles)


def _observe(system: AbstractBody, t, state: BallState, Omegadot, angles) -> Observables:
    r, g, Omega, Lambda = system.radius, system.gravity, state.Omega, state.Lambda
    Gamma, omega = Lambda[2], apply(Lambda, Omega)
    Fe = jnp.zeros_like(Omega) if system.force is None else system.force(t)

    at = moments(system, t, angles)
    points = kinematics(system, t, angles)
    still = jnp.zeros((1, 3), dtype=Omega.dtype)
    with_shell = Kinematics(
        jnp.concatenate([system.offset[None], points.chi]),
        jnp.concatenate([still, points.chidot]),
        jnp.concatenate([still, points.chiddot]),
    )
    m = jnp.concatenate([system.mass[None], point_mass_values(system)])
    contact = contact_force(at, r, g, Lambda, Omega, Omegadot, Fe)
    centre = jnp.concatenate([state.z, jnp.zeros_like(state.z[:1])])
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
        kinetic_energy=kinetic_energy(m, principal_inertia(system), r, with_shell, Omega, Gamma),
        potential_energy=potential_energy(m, g, with_shell, Gamma),
        power=actuation_power(m, g, r, with_shell, Omega, Omegadot, Gamma) + force_power(Fe, r, omega),
        normal_force=contact.normal,
        friction=contact.friction,
        friction_ratio=contact.ratio,
    )
