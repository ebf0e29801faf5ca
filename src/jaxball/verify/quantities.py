"""The quantities that the laws of mechanics balance or conserve, as sums over the masses.

A solve uses other formulas, those with the moments of the masses, so a wrong term in the equations of motion violates a
law here.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..numerics.vectors import apply, cross, dot
from ..physics import integrals
from ..physics.body import AbstractBody
from ..physics.dynamics import accelerations
from ..physics.energy import velocities
from ..physics.frames import frisvad
from ..physics.load import in_three, load
from ..physics.moments import Moments, kinematics, point_mass_values, principal_inertia
from ..physics.motion import Kinematics
from ..physics.observables import Observables, observe
from ..physics.state import BallState, DiskState
from ..physics.system import AbstractState, AbstractSystem

CENTRED = 1e-12  # of the radius of gyration: a distance from the geometric centre that counts as zero


class Balance(NamedTuple):
    """A quantity and its rate of change according to the law."""

    value: Float[Array, "*shape"]
    rate: Float[Array, "*shape"]


class Quantities(NamedTuple):
    """Balances by the name of their law, and the moments of the masses, which determine which laws hold."""

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
    found, r = accelerations(system, t, state), system.radius
    acting = load(system, t, state).with_torque(found.dry)
    Lambda, Omega = in_space.Lambda, in_space.Omega
    Gamma = Lambda[2]
    at = found.at
    arguments = at, r, Omega, Gamma
    axis = axis_of(at)
    axial = integrals.routh_integrals(*_about(axis, *arguments))
    momentum = contact_momentum_balance(system, t, state)
    jellett_rate = integrals.jellett_rate(*arguments, acting.force, acting.torque)
    balances = {
        "energy": Balance(observables.energy, observables.power),
        "momentum": momentum,
        "chaplygin": _constant(momentum.value),
        "jellett-rate": Balance(integrals.jellett(*arguments), jellett_rate),
        "jellett": _constant(axial.jellett),
        "routh": _constant(axial.routh),
        "norm": _constant(jnp.sqrt(jnp.sum(in_space.q**2))),
        "rolling": Balance(in_space.z, _centre_velocity(system, t, in_space)[:2]),
    }
    if system.ground is not None and system.ground.turntable is not None:
        balances["moving-energy"] = moving_energy_balance(system, t, in_space, observables)
    return Quantities(balances, at, axis)


def _centre_velocity(system: AbstractBody, t: Float[Array, ""], state: BallState) -> Float[Array, "3"]:
    """ż = ω × r e3 + u, with u that of a turntable."""
    vertical = jnp.zeros_like(state.Omega).at[2].set(1.0)
    rolling = cross(apply(state.Lambda, state.Omega), system.radius * vertical)
    drift = system.drift(t, state)
    return rolling if drift is None else rolling + in_three(drift)


def contact_momentum_balance(system: AbstractBody, t: Float[Array, ""], state: BallState | DiskState) -> Balance:
    """The angular momentum about the contact point in space axes, ΛΠ, and its rate, mass by mass.

    About a point that moves with the velocity ċ, L̇ = Σ s × m(**g** − Ẍ) + r e3 × F + T − ċ × P, with s from the contact
    point to a mass, and here ċ = ω × r e3 + u: Goldstein, Poole & Safko, Classical Mechanics, 3rd edition, section 1.2,
    with a moving point of reference, in axes that move by X.
    """
    in_space, r = state.in_space(), system.radius
    acting = load(system, t, state).with_torque(accelerations(system, t, state).dry)
    Lambda, vertical = in_space.Lambda, jnp.zeros_like(in_space.Omega).at[2].set(1.0)
    seen = _in_space(system, t, state)
    lift = system.gravity * vertical if system.ground is None else system.ground.lift(t, system.gravity)
    rate = cross(seen.moment, -lift) - cross(_centre_velocity(system, t, in_space), seen.P)
    if acting.force is not None:
        rate = rate + cross(r * vertical, apply(Lambda, acting.force))
    if acting.torque is not None:
        rate = rate + apply(Lambda, acting.torque)
    return Balance(seen.Pi, rate)


def moving_energy_balance(
    system: AbstractBody, t: Float[Array, ""], state: BallState, observables: Observables
) -> Balance:
    """The moving energy E − W L on a level turntable at the rate W, and its rate of change.

    L = e3·(ΛΠ + (z − c) × ΛP) is the angular momentum about the turntable's axis. Forces that do work on E through the
    velocity u of the table do none on E − W L: its rate is Ė minus (f + F)·u, W T₃ and ẆL. It is constant for steady W
    without actuation inside (Bizyaev, Borisov & Mamaev, arXiv:1807.08438).
    """
    ground = system.ground
    assert ground is not None
    assert ground.turntable is not None
    _, W, Wdot = ground.turntable.turning.derivatives(t)
    acting = load(system, t, state).with_torque(accelerations(system, t, state).dry)
    seen, aside = _in_space(system, t, state), in_three(state.z - ground.turntable.centre)
    L = seen.Pi[2] + cross(aside, seen.P)[2]
    push, drift = observables.friction, ground.velocity(t, state.z)
    if acting.force is not None:
        push = push + apply(state.Lambda, acting.force)[:2]
    assert drift is not None
    rate = observables.power - jnp.sum(push * drift) - Wdot * L
    if acting.torque is not None:
        rate = rate - W * dot(acting.torque, state.Gamma)
    return Balance(observables.energy - W * L, rate)


class _InSpace(NamedTuple):
    """ΛP, ΛΠ, and Σ m Λs with s from the contact point, over all masses; velocities are relative to the plane."""

    P: Float[Array, "3"]
    Pi: Float[Array, "3"]
    moment: Float[Array, "3"]


def _in_space(system: AbstractBody, t: Float[Array, ""], state: BallState | DiskState) -> _InSpace:
    in_space, r = state.in_space(), system.radius
    Lambda, Omega = in_space.Lambda, in_space.Omega
    Gamma = Lambda[2]
    points = kinematics(system, t, (state.theta, state.thetadot, state.thetadot))  # accelerations are not used
    chi = jnp.concatenate([system.offset[None], points.chi])
    chidot = jnp.concatenate([jnp.zeros((1, 3), dtype=Omega.dtype), points.chidot])
    m = jnp.concatenate([system.mass[None], point_mass_values(system)])[:, None]
    s = r * Gamma[None] + chi
    drift = system.drift(t, in_space)
    Y = velocities(r, Kinematics(chi, chidot, jnp.zeros_like(chi)), Omega, Gamma)
    Y = Y if drift is None else Y + apply(Lambda.T, in_three(drift))[None]
    Pi = apply(principal_inertia(system), Omega) + jnp.sum(m * jax.vmap(cross)(s, Y), axis=0)
    return _InSpace(*(apply(Lambda, v) for v in (jnp.sum(m * Y, axis=0), Pi, jnp.sum(m * s, axis=0))))


def axis_of(at: Moments) -> Float[Array, "3"]:
    """The only axis about which the ball can be a body of revolution.

    It passes through the centre of mass; where that is the geometric centre, it is the body axis whose moment differs
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
