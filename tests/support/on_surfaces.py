"""Balances of a ball on a surface, from its places alone, by automatic derivatives along the field.

A mass is at c(t, u) + Λχ. Its velocity and acceleration are derivatives of that along the field, so that neither the
rolling constraint nor the equations of motion are used.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from jaxball import observe, vector_field
from jaxball.physics.moments import kinematics, point_mass_values


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
