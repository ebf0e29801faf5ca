"""The moments of the masses, on which the equations of motion depend.

Sums run over the shell (i = 0) and the point masses. The paper's equations, which sum over the masses
one by one, depend only on these sums, so the cost of the ball's equation does not grow with n.

Sensors, files, figures, designs and controllers read here where masses on rails are, whatever moves them, and ask no
schedule of their own.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...numerics.vectors import on_diagonal, outer, symmetric
from ..prescribed.motion import Driven, Kinematics, rail_of, schedule_of
from ..state import Angles, Rates
from .coupling import Linkage, linkages
from .parameters import BodyParameters


class AlongRails(NamedTuple):
    """θ, θ̇ and θ̈ of each mass on its rail; zero for masses without one."""

    theta: Float[Array, "*t n"]
    thetadot: Float[Array, "*t n"]
    thetaddot: Float[Array, "*t n"]


def along_rails(system: BodyParameters, t: Float[Array, ""], angles: Rates) -> AlongRails:
    """Returns the coordinates of all masses; ``angles`` are θ, θ̇ and θ̈ of the coordinates in a state's ``theta``."""
    slots = {index: slot for slot, index in enumerate(system.driven)}
    parts = []
    for group, order in zip(system.groups, system.order, strict=True):
        motion = group.motion
        if isinstance(motion, Driven):
            places = np.asarray([slots[index] for index in order])
            parts.append(AlongRails(*(values[places] for values in angles)))
        elif schedule_of(motion) is not None:
            parts.append(AlongRails(*eqx.filter_vmap(lambda motion: motion.schedule.derivatives(t))(motion)))
        else:
            parts.append(AlongRails(*(jnp.zeros_like(group.mass),) * 3))
    if not parts:
        return AlongRails(*(jnp.zeros_like(t, shape=(0,)),) * 3)
    return AlongRails(*(_in_order(system, arrays) for arrays in zip(*parts, strict=True)))


def rail_tangents(system: BodyParameters, theta: Float[Array, " n"]) -> Float[Array, "n 3"]:
    """Returns the unit tangents of the rails at θ, in body axes; zero for masses without one."""
    parts = []
    for group, order in zip(system.groups, system.order, strict=True):
        rail = rail_of(group.motion)
        if rail is None:
            parts.append(jnp.zeros_like(group.mass, shape=(len(order), 3)))
            continue
        tangents = eqx.filter_vmap(lambda rail, theta: rail.derivatives(theta)[1])(rail, theta[np.asarray(order)])
        parts.append(tangents / jnp.sqrt(jnp.sum(tangents**2, axis=-1, keepdims=True)))
    return _in_order(system, parts) if parts else jnp.zeros_like(theta, shape=(0, 3))


def _in_order(system: BodyParameters, parts: Sequence[Array]) -> Array:
    """Joins the arrays of the groups to one in the order of the masses."""
    return jnp.concatenate(parts)[np.argsort(np.concatenate(system.order))]


def rates_of_mass(system: BodyParameters, t: Float[Array, ""], angles: Rates, index: int) -> Rates:
    """Returns θ, θ̇ and θ̈ of one mass on a rail; the arguments are those of :func:`along_rails`."""
    schedule = schedule_of(system.point_masses[index].motion)
    if schedule is not None:
        return schedule.derivatives(t)
    theta, thetadot, thetaddot = angles
    slot = system.driven.index(index)
    return theta[slot], thetadot[slot], thetaddot[slot]


class VelocityMoments(eqx.Module):
    """Moments of the masses about the geometric centre, in body axes, and their rates: those that need no acceleration
    of a mass.
    """

    M: Float[Array, ""]  # Σ m
    p: Float[Array, "3"]  # Σ m χ
    pdot: Float[Array, "3"]
    J: Float[Array, "3 3"]  # 𝕀 − Σ m χ̂², the inertia about the geometric centre
    Jdot: Float[Array, "3 3"]
    l: Float[Array, "3"]  # Σ m χ × χ̇


class Moments(VelocityMoments):
    """All moments."""

    pddot: Float[Array, "3"]
    ldot: Float[Array, "3"]  # Σ m χ × χ̈


def velocity_moments(
    system: BodyParameters, t: Float[Array, ""], angles: Angles, links: list[Linkage] | None = None
) -> VelocityMoments:
    """Computes the moments without accelerations at time ``t``, where ``angles`` are θ, θ̇ of the state.

    ``links`` are the mechanisms then, if they have been found.
    """
    return _moments_of_velocities(system, _velocities_by_group(system, t, angles, links))


def _moments_of_velocities(system: BodyParameters, parts: list["Part"]) -> VelocityMoments:
    """Computes the moments without accelerations, from the masses of each group and their χ and χ̇."""
    m0, chi0 = system.mass, system.offset
    # J and J̇ follow from S = Σ m χχᵀ and V = Σ m χχ̇ᵀ, of which ℓ is the antisymmetric part: fewer sums than one for
    # each.
    M, p, S = m0, m0 * chi0, m0 * outer(chi0, chi0)
    pdot, V = jnp.zeros_like(chi0), jnp.zeros_like(S)
    for m, (chi, chidot) in parts:
        M = M + jnp.sum(m)
        p = p + jnp.sum(m[:, None] * chi, axis=0)
        pdot = pdot + jnp.sum(m[:, None] * chidot, axis=0)
        S = S + symmetric(_second_moment(m, chi, chi))
        V = V + _second_moment(m, chi, chidot)
    return VelocityMoments(
        M=M, p=p, pdot=pdot, J=principal_inertia(system) + _inertia_of(S), Jdot=_inertia_of(V + V.T), l=_axial(V)
    )


def moments(system: BodyParameters, t: Float[Array, ""], angles: Rates, links: list[Linkage] | None = None) -> Moments:
    """Computes all moments at time ``t``, where ``angles`` are θ, θ̇, θ̈ of the state.

    ``links`` are the mechanisms then, if they have been found.
    """
    links = linkages(system, t, angles) if links is None else links
    parts = _kinematics_by_group(system, t, angles, links)
    # χ̇ is taken from them as well: `velocity` of a motion computes it by other operations, so that no compiler would
    # find that it is there already.
    body_moments = _moments_of_velocities(system, [(m, (chi, chidot)) for m, (chi, chidot, _) in parts])
    pddot = ldot = jnp.zeros_like(system.offset)
    for m, (chi, _, chiddot) in parts:
        pddot = pddot + jnp.sum(m[:, None] * chiddot, axis=0)
        ldot = ldot + _axial(_second_moment(m, chi, chiddot))
    return Moments(**vars(body_moments), pddot=pddot, ldot=ldot)


def kinematics(system: BodyParameters, t: Float[Array, ""], angles: Rates) -> Kinematics:
    """Computes χ_i, χ̇_i and χ̈_i of the point masses i = 1 … n, in their own order, then of the masses of mechanisms,
    each (n, 3).
    """
    links = linkages(system, t, angles)
    parts = [part for _, part in _kinematics_by_group(system, t, angles, links)]
    if not parts:
        nothing = jnp.zeros((0, 3), dtype=system.mass.dtype)
        return Kinematics(nothing, nothing, nothing)
    places = _places(system)
    return Kinematics(*(jnp.concatenate(arrays)[places] for arrays in zip(*parts, strict=True)))


def point_mass_values(system: BodyParameters) -> Float[Array, " n"]:
    """Returns m_i of the point masses i = 1 … n, in the order of :func:`kinematics`."""
    groups = (*system.groups, *system.mechanism_groups)
    if not groups:
        return jnp.zeros((0,), dtype=system.mass.dtype)
    return jnp.concatenate([jnp.ravel(group.mass) for group in groups])[_places(system)]


class JointMotion(NamedTuple):
    """θ, θ̇ and the effort of every joint of every mechanism, in their order."""

    theta: Float[Array, " joints"]
    thetadot: Float[Array, " joints"]
    effort: Float[Array, " joints"]


def joint_motion(
    system: BodyParameters, t: Float[Array, ""], angles: Rates, lifted: Float[Array, "n 3"]
) -> JointMotion:
    """Computes the motion of the joints, with efforts Q_a = Σ m χ_a·(a + γ), where ``lifted`` has a + γ in the order of
    :func:`kinematics`.
    """
    if not system.mechanism_groups:
        nothing = jnp.zeros((0,), dtype=system.mass.dtype)
        return JointMotion(nothing, nothing, nothing)
    back = np.argsort(_places(system))  # from the order of kinematics to that of the groups
    start, parts, keys = sum(len(indices) for indices in system.order), [], []
    for link, indices in zip(linkages(system, t, angles), system.mechanism_order, strict=True):
        count = link.m.size
        forces = link.m[..., None] * lifted[back[start : start + count]].reshape(*link.m.shape, 3)
        parts.append((link.rates[0], link.rates[1], jnp.sum(link.places.partial * forces[:, None], axis=(-2, -1))))
        keys += [(index, a) for index in indices for a in range(link.group.n_joints)]
        start += count
    places = np.asarray(sorted(range(len(keys)), key=keys.__getitem__), dtype=int)
    return JointMotion(
        *(jnp.concatenate([jnp.ravel(x) for x in column])[places] for column in zip(*parts, strict=True))
    )


def principal_inertia(system: BodyParameters) -> Float[Array, "3 3"]:
    """Returns 𝕀 = diag(d1, d2, d3) of the shell; for a disk, the matrix that has d2 in every place of its diagonal."""
    return on_diagonal(system.inertia)


def _places(system: BodyParameters) -> Int[np.ndarray, " n"]:
    """Finds where each mass is in the arrays of the groups, one after the other."""
    keys = [(0, index, 0) for indices in system.order for index in indices]
    for group, indices in zip(system.mechanism_groups, system.mechanism_order, strict=True):
        keys += [(1, index, i) for index in indices for i in range(group.mass.shape[-1])]
    return np.asarray(sorted(range(len(keys)), key=keys.__getitem__), dtype=int)


Part = tuple[Float[Array, " _"], Any]


def _velocities_by_group(
    system: BodyParameters, t: Float[Array, ""], angles: Angles, links: list[Linkage] | None
) -> list[Part]:
    """Lists the masses of each group, and their χ and χ̇."""
    links = linkages(system, t, (*angles, angles[1])) if links is None else links  # θ̈ is not used
    carried = (
        (jnp.ravel(link.m), (jnp.reshape(link.chi, (-1, 3)), jnp.reshape(link.chidot, (-1, 3)))) for link in links
    )
    return [*_by_group(system, t, angles, "velocity"), *carried]


def _kinematics_by_group(
    system: BodyParameters, t: Float[Array, ""], angles: Rates, links: list[Linkage]
) -> list[Part]:
    """Lists the masses of each group, and their χ, χ̇ and χ̈."""
    carried = ((jnp.ravel(link.m), link.kinematics()) for link in links)
    return [*_by_group(system, t, angles, "kinematics"), *carried]


def _by_group(system: BodyParameters, t: Float[Array, ""], angles: tuple[Array, ...], method: str) -> Iterator[Part]:
    """Yields each group's masses, with what a method of its motion returns of the time, or of its own angles."""
    slots = {index: slot for slot, index in enumerate(system.driven)}
    for group, indices in zip(system.groups, system.order, strict=True):
        own: tuple[Array, ...] = ()
        if isinstance(group.motion, Driven):
            places = np.asarray([slots[index] for index in indices])
            own = tuple(values[places] for values in angles)
        evaluate = eqx.filter_vmap(lambda motion, *own: getattr(motion, method)(*(own or (t,))))
        yield group.mass, evaluate(group.motion, *own)


def _second_moment(m, a, b):
    return jnp.sum(m[:, None, None] * a[:, :, None] * b[:, None, :], axis=0)


def _inertia_of(S):
    return on_diagonal(S[0, 0] + S[1, 1] + S[2, 2]) - S


def _axial(S):
    return jnp.stack([S[1, 2] - S[2, 1], S[2, 0] - S[0, 2], S[0, 1] - S[1, 0]])
