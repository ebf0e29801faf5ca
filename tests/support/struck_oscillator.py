"""A driven oscillator that strikes a wall."""

import jax.numpy as jnp

from jaxball.physics.classical import LagrangianSystem, UnilateralContact


def struck_oscillator(damping: float, rate: float, e: float) -> LagrangianSystem:
    """x″ = −x − damping x′ + cos(rate t) for x ≥ 0, which rebounds from 0 with the restitution ``e``."""
    return LagrangianSystem(
        lambda t, q, qdot: 0.5 * qdot[0] ** 2 - 0.5 * q[0] ** 2,
        ("x",),
        forces=lambda t, q, qdot: jnp.stack([jnp.cos(rate * t) - damping * qdot[0]]),
        unilateral=UnilateralContact(lambda t, q: q[0], restitution=e),
    )
