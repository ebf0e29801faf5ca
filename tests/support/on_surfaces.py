"""Balances of a ball on a surface, from its places alone, by automatic derivatives along the field.

A mass is at c(t, u) + Λχ. Its velocity and acceleration are derivatives of that along the field, so that neither the
rolling constraint nor the equations of motion are used.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from jaxball import observe, vector_field
from jaxball.physics.moments import point_mass_values


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
    """The laws of a ball at a state; ``place(t, u1, u2)`` is the foot, and ``torque`` is on the ball, in space."""
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
        seen = observe(ball, t, state)
        own = jnp.concatenate([(state.Lambda @ ball.offset)[None], seen.mass_positions_space])
        return centre(t, state)[None] + own

    def along(function):
        return lambda t, state: directional(function, t, state, vector_field(ball, t, state))[1]

    m = jnp.concatenate([ball.mass[None], point_mass_values(ball)])[:, None]

    def momenta(t, state):
        x, v = directional(places, t, state, vector_field(ball, t, state))
        spin = state.Lambda @ (ball.inertia * state.Omega)
        return jnp.sum(m * v, axis=0), spin + jnp.sum(jnp.cross(x, m * v), axis=0)

    seen, weight = observe(ball, t, state), jnp.array([0.0, 0.0, -1.0]) * g
    P, L = along(momenta)(t, state)
    force = jnp.zeros(3) if ball.force is None else ball.force(t)
    push = seen.contact_force + force
    turning = jnp.cross(foot(t, state), seen.contact_force) + jnp.cross(centre(t, state), force)
    turning = turning if torque is None else turning + torque
    turning = turning + jnp.sum(jnp.cross(places(t, state), m * weight[None]), axis=0)
    omega = state.Lambda @ state.Omega
    w = jax.jvp(lambda t: foot(t, state), (t,), (1.0,))[1]
    rolling = along(centre)(t, state) - w - r * jnp.cross(omega, normal(t, state))
    power = along(lambda t, state: observe(ball, t, state).energy)(t, state) - seen.power
    return Residuals(
        rolling,
        P - push - jnp.sum(m) * weight,
        L - turning,
        seen.normal_force - normal(t, state) @ seen.contact_force,
        power,
    )
