"""The quantities that the laws of mechanics balance or conserve, as sums over the masses.

A solve advances other formulas, those with the moments of the masses, so a wrong term in the equations of motion breaks
a law here.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..numerics.vectors import apply, cross
from ..physics import integrals
from ..physics.body import AbstractBody
from ..physics.dynamics import driven_angles
from ..physics.energy import velocities
from ..physics.frames import frisvad
from ..physics.moments import Moments, kinematics, moments, point_mass_values, principal_inertia
from ..physics.motion import Kinematics
from ..physics.observables import observe
from ..physics.state import BallState, DiskState
from ..physics.system import AbstractState, AbstractSystem

CENTRED = 1e-12  # of the radius of gyration: a distance from the geometric centre that counts as zero


class Balance(NamedTuple):
    """A quantity and its rate of change according to the law."""

    value: Float[Array, "*shape"]
    rate: Float[Array, "*shape"]


class Quantities(NamedTuple):
    """Balances by the name of their law, and the moments of the masses, which decide which laws hold."""

    balances: dict[str, Balance]
    moments: Moments | None
    axis: Float[Array, "3"] | None


def quantities(system: Any, t: Float[Array, ""], state: Any) -> Quantities:
    """The balances of any system in one state."""
    return _of_rolling(system, t, state) if isinstance(system, AbstractBody) else _of_laws(system, t, state)


def _of_laws(system: AbstractSystem, t: Float[Array, ""], state: AbstractState) -> Quantities:
    return Quantities({name: _constant(value) for name, value in system.laws(t, state)._asdict().items()}, None, None)


def _of_rolling(system: AbstractBody, t: Float[Array, ""], state: BallState | DiskState) -> Quantities:
    observables, in_space = observe(system, t, state), state.in_space()
    Lambda, Omega, r = in_space.Lambda, in_space.Omega, system.radius
    Gamma, omega = Lambda[2], apply(Lambda, Omega)
    at = moments(system, t, driven_angles(system, t, state))
    Fe = jnp.zeros_like(Omega) if system.force is None else system.force(t)
    arguments = at, r, Omega, Gamma
    axis = axis_of(at)
    axial = integrals.routh_integrals(*_about(axis, *arguments))
    vertical = jnp.zeros_like(Omega).at[2].set(1.0)
    rolling = cross(omega, r * vertical)
    momentum = contact_momentum_balance(system, t, state)
    balances = {
        "energy": Balance(observables.energy, observables.power),
        "momentum": momentum,
        "chaplygin": _constant(momentum.value),
        "jellett-rate": Balance(integrals.jellett(*arguments), integrals.jellett_rate(*arguments, apply(Lambda.T, Fe))),
        "jellett": _constant(axial.jellett),
        "routh": _constant(axial.routh),
        "norm": _constant(jnp.sqrt(jnp.sum(in_space.q**2))),
        "rolling": Balance(in_space.z, rolling[:2]),
    }
    return Quantities(balances, at, axis)


def contact_momentum_balance(system: AbstractBody, t: Float[Array, ""], state: BallState | DiskState) -> Balance:
    """The angular momentum about the contact point in space axes, ΛΠ, and its rate, mass by mass.

    About a point that moves with the velocity ċ, L̇ = Σ s × (−m g e3) + r e3 × Fe − ċ × P, with s from the contact
    point to a mass, and here ċ = ω × r e3: Goldstein, Poole & Safko, Classical Mechanics, 3rd edition, section 1.2,
    with a moving point of reference.
    """
    in_space, angles, r = state.in_space(), driven_angles(system, t, state), system.radius
    Lambda, Omega = in_space.Lambda, in_space.Omega
    Gamma = Lambda[2]
    vertical = jnp.zeros_like(Omega).at[2].set(1.0)
    points = kinematics(system, t, angles)
    chi = jnp.concatenate([system.offset[None], points.chi])
    chidot = jnp.concatenate([jnp.zeros((1, 3), dtype=Omega.dtype), points.chidot])
    m = jnp.concatenate([system.mass[None], point_mass_values(system)])[:, None]
    s = r * Gamma[None] + chi
    Y = velocities(r, Kinematics(chi, chidot, jnp.zeros_like(chi)), Omega, Gamma)
    Pi = apply(principal_inertia(system), Omega) + jnp.sum(m * jax.vmap(cross)(s, Y), axis=0)
    P = jnp.sum(m * Y, axis=0)
    weight = cross(apply(Lambda, jnp.sum(m * s, axis=0)), -system.gravity * vertical)
    force = jnp.zeros_like(weight) if system.force is None else cross(r * vertical, system.force(t))
    cdot = cross(apply(Lambda, Omega), r * vertical)
    return Balance(apply(Lambda, Pi), weight + force - cross(cdot, apply(Lambda, P)))


def axis_of(at: Moments) -> Float[Array, "3"]:
    """The only axis about which the ball can be a body of revolution.

    It leads through the centre of mass; where that is the geometric centre, it is the body axis whose moment differs
    most from the others.
    """
    J = jnp.diagonal(at.J)
    height = jnp.sqrt(jnp.sum(at.p**2))
    centred = height <= CENTRED * jnp.sqrt(at.M * jnp.max(J))
    odd = jnp.argmax(jnp.abs(J - jnp.median(J)))
    coordinate = jnp.where(jnp.arange(3) == odd, jnp.ones_like(J), 0.0)
    return jnp.where(centred, coordinate, at.p / jnp.where(centred, 1.0, height))


def _about(axis: Float[Array, "3"], at: Moments, r, Omega, Gamma):
    """The moments and vectors in axes turned so that E3 is ``axis``."""
    turn = jnp.stack([*frisvad(axis), axis])

    def turned(matrix):
        half = jnp.sum(turn[:, :, None] * matrix[None], axis=1)
        return jnp.sum(half[:, None, :] * turn[None], axis=2)

    p, pdot, pddot, l, ldot = (apply(turn, v) for v in (at.p, at.pdot, at.pddot, at.l, at.ldot))
    J, Jdot = turned(at.J), turned(at.Jdot)
    about = Moments(M=at.M, p=p, pdot=pdot, J=J, Jdot=Jdot, l=l, pddot=pddot, ldot=ldot)
    return about, r, apply(turn, Omega), apply(turn, Gamma)


def _constant(value: Float[Array, "*shape"]) -> Balance:
    return Balance(value, jnp.zeros_like(value))
