"""A ball on a slope with a pendulum inside, by time stepping: contact, slip, rolling, spinning and a joint at once.

The scheme of Moreau and Jean: at each step an impulse for every law, each within its cone, is found by projections in
turn (J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics, in Nonsmooth Mechanics and
Applications, Springer 1988). It is of first order, knows no modes and no events, and shares nothing with the package.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

SWEEPS = 150  # of projections in a step
IMPACT = 1e-4  # the speed at which a body comes down that strikes the ground


class Ball(NamedTuple):
    """A ball of radius 1 and what acts on it; a law with the limit 0 is none, one with an infinite limit always holds.

    ``axes`` are those of the pendulum: the axis of its hinge, its direction at θ = 0, and the product of both.
    """

    mass: Float[Array, ""]
    inertia: Float[Array, "3"]
    offset: Float[Array, "3"]
    pendulum: Float[Array, ""]
    length: Float[Array, ""]
    axes: Float[Array, "3 3"]
    gravity: Float[Array, "3"]
    torque: Float[Array, ""]  # torque · sin(frequency · t) drives the hinge
    frequency: Float[Array, ""]
    friction: Float[Array, ""]
    rolling: Float[Array, ""]
    spinning: Float[Array, ""]
    joint: Float[Array, ""]


class Motion(NamedTuple):
    """Where the centre is, the attitude, the angle of the pendulum, and the rates V, ω (space axes) and θ̇ in one."""

    place: Float[Array, "3"]
    turn: Float[Array, "3 3"]
    theta: Float[Array, ""]
    rates: Float[Array, "7"]


def cross_matrix(a: Float[Array, "3"]) -> Float[Array, "3 3"]:
    return jnp.cross(a[None], -jnp.eye(3))


def turned(turn: Float[Array, "3 3"], angle: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """Turns an attitude by a vector of rotation in space axes, by Rodrigues' formula."""
    size = jnp.sqrt(jnp.sum(angle**2) + 1e-30)
    K = cross_matrix(angle / size)
    return (jnp.eye(3) + jnp.sin(size) * K + (1 - jnp.cos(size)) * K @ K) @ turn


def moved(at: Motion, time: Float[Array, ""]) -> Motion:
    V, omega, thetadot = at.rates[:3], at.rates[3:6], at.rates[6]
    return at._replace(place=at.place + time * V, turn=turned(at.turn, time * omega), theta=at.theta + time * thetadot)


def inertia_and_force(ball: Ball, at: Motion, t: Float[Array, ""]) -> tuple[Float[Array, "7 7"], Float[Array, "7"]]:
    """Computes M and F of M ν̇ = F, without the forces of the laws."""
    omega, thetadot = at.rates[3:6], at.rates[6]
    _, down, across = ball.axes
    sine, cosine = jnp.sin(at.theta), jnp.cos(at.theta)
    bob = at.turn @ (ball.length * (cosine * down + sine * across))
    swing = at.turn @ (ball.length * (cosine * across - sine * down))
    shell, none = at.turn @ ball.offset, jnp.zeros(3)
    moments = at.turn @ jnp.diag(ball.inertia) @ at.turn.T
    M, F = jnp.zeros((7, 7)).at[3:6, 3:6].set(moments), jnp.zeros(7)
    F = F.at[3:6].set(-jnp.cross(omega, moments @ omega)).at[6].set(ball.torque * jnp.sin(ball.frequency * t))
    for mass, arm, along in ((ball.mass, shell, none), (ball.pendulum, bob, swing)):
        J = jnp.concatenate([jnp.eye(3), -cross_matrix(arm), along[:, None]], axis=1)
        apparent = jnp.cross(omega, jnp.cross(omega, arm)) + 2 * thetadot * jnp.cross(omega, along)
        apparent += thetadot**2 * jnp.where(jnp.any(along != 0), -arm, 0.0)
        M += mass * J.T @ J
        F += mass * J.T @ (ball.gravity - apparent)
    return M, F


# What the laws act on: the velocity of the lowest point along the slope and across it, ω over it and about its normal,
# and the joint.
ROWS = jnp.zeros((7, 7)).at[:3, :3].set(jnp.eye(3)).at[0, 4].set(-1.0).at[1, 3].set(1.0)
ROWS = ROWS.at[3:, 3:].set(jnp.eye(4))


def within(impulse: Float[Array, " n"], limit: Float[Array, ""]) -> Float[Array, " n"]:
    """Returns the nearest impulse that is not larger than the limit."""
    size = jnp.sqrt(jnp.sum(impulse**2) + 1e-300)
    return jnp.where(size > limit, limit / size, 1.0) * impulse


def step(ball: Ball, at: Motion, t: Float[Array, ""], h: Float[Array, ""]) -> Motion:
    half = moved(at, h / 2)
    M, F = inertia_and_force(ball, half, t + h / 2)
    response = jnp.linalg.solve(M, ROWS.T)
    free = at.rates + h * jnp.linalg.solve(M, F)
    G, u0 = ROWS @ response, ROWS @ free
    touches = half.place[2] <= 1.0 + 1e-9
    # An impact is so short that the torques of rolling and spinning do nothing in it.
    turning = jnp.where(at.rates[2] < -IMPACT, 0.0, 1.0)
    laws = (
        (slice(0, 2), lambda p: ball.friction * p[2]),
        (slice(3, 5), lambda p: turning * ball.rolling * p[2]),
        (slice(5, 6), lambda p: turning * ball.spinning * p[2]),
        (slice(6, 7), lambda p: ball.joint * h),
    )
    largest = [jnp.linalg.eigvalsh(G[rows, rows])[-1] for rows, _ in laws]

    def sweep(p: Float[Array, "7"], _: None) -> tuple[Float[Array, "7"], None]:
        for (rows, limit), most in zip(laws, largest, strict=True):
            u = u0 + G @ p
            p = p.at[rows].set(within(p[rows] - u[rows] / most, limit(p)))
        u = u0 + G @ p
        p = p.at[2].set(jnp.where(touches, jnp.maximum(p[2] - u[2] / G[2, 2], 0.0), 0.0))
        return p, None

    start = jnp.zeros(7).at[2].set(jnp.maximum(-u0[2] / G[2, 2], 0.0))
    impulses = jax.lax.scan(sweep, start, None, length=SWEEPS)[0]
    new = at._replace(rates=free + response @ impulses)
    # The place moves by the new rates: on the ground it then stays there.
    return moved(new, h)


def run(ball: Ball, start: Motion, end: float, steps: int) -> Motion:
    """Returns the motion at the end."""
    h = jnp.asarray(end / steps)

    def take(at: Motion, k: Float[Array, ""]) -> tuple[Motion, None]:
        return step(ball, at, k * h, h), None

    return jax.lax.scan(take, start, jnp.arange(steps, dtype=float))[0]
