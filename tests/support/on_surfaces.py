"""Balances of a ball on a surface, from its places alone, by automatic derivatives along the field.

A mass is at c(t, u) + Λχ. Its velocity and acceleration are derivatives of that along the field, so that neither the
rolling constraint nor the equations of motion are used.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import brentq, minimize_scalar

from jaxball import observe
from jaxball.physics import vector_field
from jaxball.physics.dynamics.moments import kinematics, point_mass_values
from jaxball.physics.observables import compute_observables, movement


def directional(function, t, state, rates):
    """The rate of a function of (t, state) along the motion."""
    return jax.jvp(function, (t, state), (jnp.ones_like(t), rates))


class Residuals(NamedTuple):
    """What is left of each law: all are zero."""

    rolling: jax.Array
    momentum: jax.Array
    angular_momentum: jax.Array
    normal_force: jax.Array
    power: jax.Array


def residuals(ball, t, state, place, torque=None):
    """The laws of a ball at a state; ``place(t, u1, u2)`` is the foot, and ``torque(t, state, N)`` is on the ball,
    in space."""
    r, g = ball.radius, ball.gravity

    def foot(t, state):
        return place(t, state.z[0], state.z[1])

    def normal(t, state):
        along = [jax.jvp(lambda x, k=k: place(t, *state.z.at[k].set(x)), (state.z[k],), (1.0,))[1] for k in (0, 1)]
        n = jnp.cross(*along)
        return n / jnp.linalg.norm(n)

    def centre(t, state):
        return foot(t, state) + r * normal(t, state)

    def places(t, state):
        chi = kinematics(ball, t, (state.theta, state.thetadot, state.thetadot)).chi
        own = jnp.concatenate([ball.offset[None], chi])
        return centre(t, state)[None] + own @ state.Lambda.T

    m = jnp.concatenate([ball.mass[None], point_mass_values(ball)])[:, None]

    def moving(t, state):
        """ċ, P, L about the origin of space, and the energy without that of springs."""
        rates = vector_field(ball, t, state)
        (_, x), (v_c, v) = directional(lambda *at: (centre(*at), places(*at)), t, state, rates)
        body = ball.inertia * state.Omega
        energy = 0.5 * (state.Omega @ body + jnp.sum(m * v**2)) + g * jnp.sum(m[:, 0] * x[:, 2])
        return v_c, jnp.sum(m * v, axis=0), state.Lambda @ body + jnp.sum(jnp.cross(x, m * v), axis=0), energy

    (v_c, *_), (_, P, L, power) = directional(moving, t, state, vector_field(ball, t, state))
    seen, weight = observe(ball, t, state), jnp.array([0.0, 0.0, -1.0]) * g
    force = jnp.zeros(3) if ball.force is None else ball.force(t)
    turning = jnp.cross(foot(t, state), seen.contact_force) + jnp.cross(centre(t, state), force)
    turning = turning if torque is None else turning + torque(t, state, seen.normal_force)
    turning = turning + jnp.sum(jnp.cross(places(t, state), m * weight[None]), axis=0)
    omega, n = state.Lambda @ state.Omega, normal(t, state)
    w = jax.jvp(lambda t: foot(t, state), (t,), (1.0,))[1]
    return Residuals(
        v_c - w - r * jnp.cross(omega, n),
        P - seen.contact_force - force - jnp.sum(m) * weight,
        L - turning,
        seen.normal_force - n @ seen.contact_force,
        power - seen.power,
    )


class ReleasedResiduals(NamedTuple):
    """What is left of each law of a ball that may slip and fly: all are zero."""

    momentum: jax.Array
    angular_momentum: jax.Array
    gap: jax.Array
    rise: jax.Array
    friction: jax.Array
    power: jax.Array


def released_residuals(plane, t, state, place, torque=None):
    """The laws of a ball on its ground in the mode that a ``ContactState`` is in.

    Masses are at c + Λχ with ċ = V, so nothing is taken from the contact but R. ``place(t, u1, u2)`` is the foot, and
    ``torque(t, state, N)`` is on the ball while it touches the ground, in space.
    """
    ball, mu = plane.body, plane.contact.friction
    r, g = ball.radius, ball.gravity

    def normal(t, u):
        along = [jax.jvp(lambda x, k=k: place(t, *u.at[k].set(x)), (u[k],), (1.0,))[1] for k in (0, 1)]
        n = jnp.cross(*along)
        return n / jnp.linalg.norm(n)

    def places(c, state):
        chi = kinematics(ball, t, (state.body.theta, state.body.thetadot, state.body.thetadot)).chi
        return c[None] + jnp.concatenate([ball.offset[None], chi]) @ state.body.Lambda.T

    m = jnp.concatenate([ball.mass[None], point_mass_values(ball)])[:, None]

    def moving(t, c, state, rates):
        """P, L about the origin of space, and the energy, with the rate of Λ from Ω."""

        def at(t, c, state):
            chi = kinematics(ball, t, (state.body.theta, state.body.thetadot, state.body.thetadot)).chi
            return c[None] + jnp.concatenate([ball.offset[None], chi]) @ state.body.Lambda.T

        x, v = jax.jvp(at, (t, c, state), (jnp.ones_like(t), state.V, rates))
        body = ball.inertia * state.body.Omega
        energy = 0.5 * (state.body.Omega @ body + jnp.sum(m * v**2)) + g * jnp.sum(m[:, 0] * x[:, 2])
        return jnp.sum(m * v, axis=0), state.body.Lambda @ body + jnp.sum(jnp.cross(x, m * v), axis=0), energy

    def along(t, c, state):
        return moving(t, c, state, plane.field(t, state))

    u = state.body.z
    foot, n = place(t, *u), normal(t, u)
    c, rates = foot + (r + state.height) * n, plane.field(t, state)
    _, (P, L, power) = jax.jvp(along, (t, c, state), (jnp.ones_like(t), state.V, rates))
    seen = compute_observables(ball, t, movement(plane, t, state))
    R, weight = seen.contact_force, jnp.array([0.0, 0.0, -1.0]) * g
    turning = jnp.cross(foot, R) + jnp.sum(jnp.cross(places(c, state), m * weight[None]), axis=0)
    if torque is not None:
        turning = turning + jnp.where(state.mode < 2, torque(t, state.body, seen.normal_force), 0.0)

    def apart(u, s):
        x = c + s * state.V + 0.5 * s**2 * rates.V
        return x - place(t + s, *u)

    def gap(s):
        """The height while the centre goes on with V and V̇, by Newton's method for the foot, which is u at s = 0."""
        near = u
        for _ in range(2):
            slope = jax.grad(lambda u: 0.5 * jnp.sum(apart(u, s) ** 2))
            near = near - jnp.linalg.solve(jax.hessian(lambda u: 0.5 * jnp.sum(apart(u, s) ** 2))(near), slope(near))
        return normal(t + s, near) @ apart(near, s) - r

    zero = jnp.zeros_like(t)
    (height, rise), (_, curved) = jax.jvp(
        lambda s: jax.jvp(gap, (s,), (jnp.ones_like(s),)), (zero,), (jnp.ones_like(zero),)
    )
    omega = state.body.Lambda @ state.body.Omega
    slip = state.V - r * jnp.cross(omega, n) - jax.jvp(lambda t: place(t, *u), (t,), (1.0,))[1]
    across = slip - (slip @ n) * n
    N = R @ n
    slides = -mu * N * across / jnp.where(state.mode == 1, jnp.linalg.norm(across), 1.0)
    return ReleasedResiduals(
        P - R - jnp.sum(m) * weight,
        L - turning,
        jnp.stack([height - state.height, jnp.where(state.mode < 2, curved, 0.0)]),
        rise - rates.height,
        jnp.where(state.mode == 1, R - N * n - slides, 0.0),
        power - seen.power,
    )


def time_of_landing(curve, c, V, r, g):
    """When a ball that flies from c with V is next as near as its radius to a curve z = curve(x), by SciPy."""

    def gap(s):
        x, z = c[0] + V[0] * s, c[2] + V[2] * s - 0.5 * g * s**2

        def apart(u):
            return np.hypot(u - x, curve(u) - z)

        near, step = min(np.linspace(x - 5 * r, x + 5 * r, 101), key=apart), 0.2 * r
        return minimize_scalar(apart, bounds=(near - step, near + step), options={"xatol": 1e-9 * r}).fun - r

    later = np.sqrt(r / g) * np.linspace(0.2, 15.0, 149)
    first = next(s for s in later if gap(s) < 0)
    return brentq(gap, first - later[1] + later[0], first, xtol=1e-13)
