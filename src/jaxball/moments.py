"""The moments of the masses: all that the equations of motion see of them.

Sums run over the shell (i = 0) and the point masses. The paper's equations, which sum over the masses
one by one, depend on these sums alone, so the cost of the ball's equation does not grow with n.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .body import AbstractBody, PointMass, System
from .motion import Driven, Kinematics
from .vectors import outer


class Moments(eqx.Module):
    """Moments of the masses about the geometric centre, in body axes, and their rates."""

    M: Float[Array, ""]  # Σ m
    p: Float[Array, "3"]  # Σ m χ
    pdot: Float[Array, "3"]
    pddot: Float[Array, "3"]
    J: Float[Array, "3 3"]  # 𝕀 − Σ m χ̂², the inertia about the geometric centre
    Jdot: Float[Array, "3 3"]
    l: Float[Array, "3"]  # Σ m χ × χ̇
    ldot: Float[Array, "3"]  # Σ m χ × χ̈


Rates = tuple[Float[Array, " driven"], Float[Array, " driven"], Float[Array, " driven"]]


def moments(system: System, t: Float[Array, ""], angles: Rates) -> Moments:
    """The moments at time ``t``, where ``angles`` are θ, θ̇, θ̈ of the driven masses."""
    m0, chi0 = system.mass, system.offset
    M, p = m0, m0 * chi0
    pdot = pddot = jnp.zeros_like(chi0)
    S = m0 * outer(chi0, chi0)
    Sdot = jnp.zeros_like(S)
    l = ldot = jnp.zeros_like(chi0)
    for group, (chi, chidot, chiddot) in _kinematics_by_group(system, t, angles):
        m = group.mass
        M = M + jnp.sum(m)
        p = p + jnp.sum(m[:, None] * chi, axis=0)
        pdot = pdot + jnp.sum(m[:, None] * chidot, axis=0)
        pddot = pddot + jnp.sum(m[:, None] * chiddot, axis=0)
        S = S + _second_moment(m, chi, chi)
        velocity, acceleration = _second_moment(m, chi, chidot), _second_moment(m, chi, chiddot)
        Sdot = Sdot + velocity + velocity.T
        l = l + _axial(velocity)
        ldot = ldot + _axial(acceleration)
    return Moments(
        M=M,
        p=p,
        pdot=pdot,
        pddot=pddot,
        J=principal_inertia(system) + _inertia_of(S),
        Jdot=_inertia_of(Sdot),
        l=l,
        ldot=ldot,
    )


def kinematics(system: System, t: Float[Array, ""], angles: Rates) -> Kinematics:
    """χ_i, χ̇_i and χ̈_i of the point masses i = 1 … n, in their own order, each of shape (n, 3)."""
    parts = [part for _, part in _kinematics_by_group(system, t, angles)]
    if not parts:
        nothing = jnp.zeros((0, 3), dtype=system.mass.dtype)
        return Kinematics(nothing, nothing, nothing)
    places = np.argsort(np.concatenate([np.asarray(indices) for indices in system.order]))
    return Kinematics(*(jnp.concatenate(arrays)[places] for arrays in zip(*parts, strict=True)))


def point_mass_values(system: AbstractBody) -> Float[Array, " n"]:
    """m_i of the point masses i = 1 … n, in their own order."""
    if not system.groups:
        return jnp.zeros((0,), dtype=system.mass.dtype)
    places = np.argsort(np.concatenate([np.asarray(indices) for indices in system.order]))
    return jnp.concatenate([group.mass for group in system.groups])[places]


def principal_inertia(system: System) -> Float[Array, "3 3"]:
    """𝕀 = diag(d1, d2, d3) of the shell; for a disk, the matrix that has d2 in every place of its diagonal."""
    return jnp.broadcast_to(system.inertia, (3,))[:, None] * jnp.eye(3, dtype=system.mass.dtype)


def _kinematics_by_group(system: System, t, angles: Rates) -> list[tuple[PointMass, Kinematics]]:
    slots = {index: slot for slot, index in enumerate(system.driven)}
    found = []
    for group, indices in zip(system.groups, system.order, strict=True):
        if isinstance(group.motion, Driven):
            places = np.asarray([slots[index] for index in indices])
            own = (values[places] for values in angles)
            found.append((group, eqx.filter_vmap(lambda motion, *x: motion.kinematics(*x))(group.motion, *own)))
        else:
            at_t = eqx.filter_vmap(lambda motion: motion.kinematics(t))
            found.append((group, at_t(group.motion)))
    return found


def _second_moment(m, a, b):
    return jnp.sum(m[:, None, None] * a[:, :, None] * b[:, None, :], axis=0)


def _inertia_of(S):
    trace = S[0, 0] + S[1, 1] + S[2, 2]
    return trace * jnp.eye(3, dtype=S.dtype) - S


def _axial(S):
    return jnp.stack([S[1, 2] - S[2, 1], S[2, 0] - S[0, 2], S[0, 1] - S[1, 0]])
