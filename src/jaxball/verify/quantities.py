"""What the laws of mechanics say of a rolling body, from sums over its masses.

Each formula is another than the one that a solve advances, which knows moments alone, so that a wrong term in the
equations of motion breaks a law.
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

CENTRED = 1e-12  # of the radius of gyration: how near to the geometric centre counts as there


class Balance(NamedTuple):
    """A quantity and the rate at which the law says that it changes."""

    value: Float[Array, "*shape"]
    rate: Float[Array, "*shape"]


class Quantities(NamedTuple):
    """Balances by the name of their law, and the moments of the masses, on which it depends which laws hold."""

    balances: dict[str, Balance]
    moments: Moments | None
    axis: Float[Array, "3"] | None


def quantities(system: Any, t: Float[Array, ""], state: Any) -> Quantities:
    """What is balanced along a motion of any system."""
    return _of_rolling(system, t, state) if isinstance(system, AbstractBody) else _of_laws(system, t, state)


def _of_laws(system: AbstractSystem, t: Float[Array, ""], state: AbstractState) -> Quantities:
    found = system.laws(t, state)._asdict()
    return Quantities({name: _constant(value) for name, value in found.items()}, None, None)


def _of_rolling(system: AbstractBody, t: Float[Array, ""], state: BallState | DiskState) -> Quantities:
    seen, upright = observe(system, t, state), state.in_space()
    Lambda, Omega, r = upright.Lambda, upright.Omega, system.radius
    Gamma, omega = Lambda[2], apply(Lambda, Omega)
    at = moments(system, t, driven_angles(system, t, state))
    Fe = jnp.zeros_like(Omega) if system.force is None else system.force(t)
    place = at, r, Omega, Gamma
    axis = axis_of(at)
    axial = integrals.routh_integrals(*_about(axis, *place))
    vertical = jnp.zeros_like(Omega).at[2].set(1.0)
    rolling = cross(omega, r * vertical)
    momentum = contact_momentum_balance(system, t, state)
    balances = {
        "energy": Balance(seen.energy, seen.power),
        "momentum": momentum,
        "chaplygin": _constant(momentum.value),
        "jellett-rate": Balance(integrals.jellett(*place), integrals.jellett_rate(*place, apply(Lambda.T, Fe))),
        "jellett": _constant(axial.jellett),
        "routh": _constant(axial.routh),
        "norm": _constant(jnp.sqrt(jnp.sum(upright.q**2))),
        "rolling": Balance(upright.z, rolling[:2]),
    }
    return Quantities(balances, at, axis)


def contact_momentum_balance(system: AbstractBody, t: Float[Array, ""], state: BallState | DiskState) -> Balance:
    """The angular momentum about the contact point in space axes, ΛΠ, and its rate, mass by mass.

    About a point that moves with the velocity ċ, L̇ = Σ s × (−m g e3) + r e3 × Fe − ċ × P, with s from the contact
    point to a mass, and here ċ = ω × r e3: Goldstein, Poole & Safko, Classical Mechanics, 3rd edition, section 1.2,
    with a moving point of reference.
    """
    upright, angles, r = state.in_space(), driven_angles(system, t, state), system.radius
    Lambda, Omega = upright.Lambda, upright.Omega
    Gamma = Lambda[2]
    vertical = jnp.zeros_like(Omega).at[2].set(1.0)
    points = kinematics(system, t, angles)
    still = jnp.zeros((1, 3), dtype=Omega.dtype)
    chi = jnp.concatenate([system.offset[None], points.chi])
    chidot = jnp.concatenate([still, points.chidot])
    m = jnp.concatenate([system.mass[None], point_mass_values(system)])[:, None]
    s = r * Gamma[None] + chi
    Y = velocities(r, Kinematics(chi, chidot, jnp.zeros_like(chi)), Omega, Gamma)
    Pi = apply(principal_inertia(system), Omega) + jnp.sum(m * jax.vmap(cross)(s, Y), axis=0)
    P = jnp.sum(m * Y, axis=0)
    weight = cross(apply(Lambda, jnp.sum(m * s, axis=0)), -system.gravity * vertical)
    push = jnp.zeros_like(weight) if system.force is None else cross(r * vertical, system.force(t))
    cdot = cross(apply(Lambda, Omega), r * vertical)
    return Balance(apply(Lambda, Pi), weight + push - cross(cdot, apply(Lambda, P)))


def axis_of(at: Moments) -> Float[Array, "3"]:
    """The one axis about which the ball may be a body of revolution.

    That of its centre of mass; where this is the geometric centre, the body axis whose moment is the odd one out.
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
    about = Moments(at.M, p, pdot, turned(at.J), turned(at.Jdot), l, pddot, ldot)
    return about, r, apply(turn, Omega), apply(turn, Gamma)


def _constant(value: Float[Array, "*shape"]) -> Balance:
    return Balance(value, jnp.zeros_like(value))
