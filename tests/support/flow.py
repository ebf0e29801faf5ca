"""Time derivatives along the motion, by forward mode through the vector field."""

import jax
import jax.numpy as jnp

import jaxball


def along_flow(function, system, t, state):
    """``function(t, state)`` and its rate of change along the motion of ``system``."""
    rates = jaxball.physics.vector_field(system, t, state)
    return jax.jvp(function, (t, state), (jnp.ones_like(t), rates))
