"""The moments of the masses: all that the equations of motion see of them.

Sums run over the shell (i = 0) and the point masses. The paper's equations, which sum over the masses
one by one, depend on these sums alone, so the cost of the ball's equation does not grow with n.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..numerics.vectors import outer
from .motion import Driven, Kinematics
from .parameters import BodyParameters, PointMass
from .state import Angles, Rates


class AbstractMoments(eqx.Module):
    """Moments of the masses about the geometric centre, in body axes, and their rates."""

    M: eqx.AbstractVar[Float[Array, ""]]  # Σ m
    p: eqx.AbstractVar[Float[Array, "3"]]  # Σ m χ
    pdot: eqx.AbstractVar[Float[Array, "3"]]
    J: eqx.AbstractVar[Float[Array, "3 3"]]  # 𝕀 − Σ m χ̂², the inertia about the geometric centre
    Jdot: eqx.AbstractVar[Float[Array, "3 3"]]
    l: eqx.AbstractVar[Float[Array, "3"]]  # Σ m χ × χ̇


class VelocityMoments(AbstractMoments):
    """The moments that need no acceleration of a mass."""

    M: Float[Array, ""]
    p: Float[Array, "3"]
    pdot: Float[Array, "3"]
    J: Float[Array, "3 3"]
    Jdot: Float[Array, "3 3"]
    l: Float[Array, "3"]


class Moments(AbstractMoments):
    """All moments."""

    M: Float[Array, ""]
    p: Float[Array, "3"]
    pdot: Float[Array, "3"]
    J: Float[Array, "3 3"]
    Jdot: Float[Array, "3 3"]
    l: Float[Array, "3"]
    pddot: Float[Array, "3"]
    ldot: Float[Array, "3"]  # Σ m χ × χ̈


def velocity_moments(system: BodyParameters, t: Float[Array, ""], angles: Angles) -> VelocityMoments:
    """The moments without accelerations at time ``t``, where ``angles`` are θ, θ̇ of the driven masses."""
    parts = _by_group(system, angles, lambda motion: motion.velocity(t), lambda motion, *x: motion.velocity(*x))
    m0, chi0 = system.mass, system.offset
    M, p, S = m0, m0 * chi0, m0 * outer(chi0, chi0)
    pdot, V = jnp.zeros_like(chi0), jnp.zeros_like(S)
    for group, (chi, chidot) in parts:
        m = group.mass
        M = M + jnp.sum(m)
        p = p + jnp.sum(m[:, None] * chi, axis=0)
        pdot = pdot + jnp.sum(m[:, None] * chidot, axis=0)
        S = S + _second_moment(m, chi, chi)
        V = V + _second_moment(m, chi, chidot)
    return VelocityMoments(
        M=M, p=p, pdot=pdot, J=principal_inertia(system) + _inertia_of(S), Jdot=_inertia_of(V + V.T), l=_axial(V)
    )


def moments(system: BodyParameters, t: Float[Array, ""], angles: Rates) -> Moments:
    """All moments at time ``t``, where ``angles`` are θ, θ̇, θ̈ of the driven masses."""
    at = velocity_moments(system, t, angles[:2])
    pddot = ldot = jnp.zeros_like(system.offset)
    for group, (chi, _, chiddot) in _kinematics_by_group(system, t, angles):
        m = group.mass
        pddot = pddot + jnp.sum(m[:, None] * chiddot, axis=0)
        ldot = ldot + _axial(_second_moment(m, chi, chiddot))
    return Moments(M=at.M, p=at.p, pdot=at.pdot, J=at.J, Jdot=at.Jdot, l=at.l, pddot=pddot, ldot=ldot)


def kinematics(system: BodyParameters, t: Float[Array, ""], angles: Rates) -> Kinematics:
    """χ_i, χ̇_i and χ̈_i of the point masses i = 1 … n, in their own order, each of shape (n, 3)."""
    parts = [part for _, part in _kinematics_by_group(system, t, angles)]
    if not parts:
        nothing = jnp.zeros((0, 3), dtype=system.mass.dtype)
        return Kinematics(nothing, nothing, nothing)
    places = np.argsort(np.concatenate([np.asarray(indices) for indices in system.order]))
    return Kinematics(*(jnp.concatenate(arrays)[places] for arrays in zip(*parts, strict=True)))


def point_mass_values(system: BodyParameters) -> Float[Array, " n"]:
    """m_i of the point masses i = 1 … n, in their own order."""
    if not system.groups:
        return jnp.zeros((0,), dtype=system.mass.dtype)
    places = np.argsort(np.concatenate([np.asarray(indices) for indices in system.order]))
    return jnp.concatenate([group.mass for group in system.groups])[places]


def principal_inertia(system: BodyParameters) -> Float[Array, "3 3"]:
    """𝕀 = diag(d1, d2, d3) of the shell; for a disk, the matrix that has d2 in every place of its diagonal."""
    return jnp.broadcast_to(system.inertia, (3,))[:, None] * jnp.eye(3, dtype=system.mass.dtype)


def _kinematics_by_group(system: BodyParameters, t, angles: Rates) -> list[tuple[PointMass, Kinematics]]:
    return _by_group(system, angles, lambda motion: motion.kinematics(t), lambda motion, *x: motion.kinematics(*x))


def _by_group(system: BodyParameters, angles, prescribed: Callable[..., Any], driven: Callable[..., Any]) -> list:
    """Each group with what ``prescribed`` finds of its motion, or ``driven`` of its motion and its own angles."""
    slots = {index: slot for slot, index in enumerate(system.driven)}
    parts = []
    for group, indices in zip(system.groups, system.order, strict=True):
        if isinstance(group.motion, Driven):
            places = np.asarray([slots[index] for index in indices])
            parts.append((group, eqx.filter_vmap(driven)(group.motion, *(values[places] for values in angles))))
        else:
            parts.append((group, eqx.filter_vmap(prescribed)(group.motion)))
    return parts


def _second_moment(m, a, b):
    return jnp.sum(m[:, None, None] * a[:, :, None] * b[:, None, :], axis=0)


def _inertia_of(S):
    trace = S[0, 0] + S[1, 1] + S[2, 2]
    return trace * jnp.eye(3, dtype=S.dtype) - S


def _axial(S):
    return jnp.stack([S[1, 2] - S[2, 1], S[2, 0] - S[0, 2], S[0, 1] - S[1, 0]])
