"""Mechanics in coordinates, from a Lagrangian and a constraint alone: derivatives are automatic."""

import jax
import jax.numpy as jnp


def free_accelerations(lagrangian, t, place, velocity):
    """q̈ by Lagrange's equations, d/dt ∂L/∂q̇ = ∂L/∂q."""
    return jnp.linalg.solve(*_equations(lagrangian, t, place, velocity))


def constrained_accelerations(lagrangian, constraint, t, place, velocity):
    """q̈ and λ by the principle of Lagrange and d'Alembert, ``LdA``, for one constraint A(t, q)·q̇ = 0.

    d/dt ∂L/∂q̇ − ∂L/∂q = λA and d/dt (A·q̇) = 0 are linear equations for both.
    """
    mass, force = _equations(lagrangian, t, place, velocity)
    A, Adot = jax.jvp(constraint, (t, place), (jnp.ones_like(t), velocity))
    n = len(place)
    matrix = jnp.block([[mass, -A[:, None]], [A[None, :], jnp.zeros((1, 1))]])
    solution = jnp.linalg.solve(matrix, jnp.concatenate([force, -(Adot @ velocity)[None]]))
    return solution[:n], solution[n]


def _equations(lagrangian, t, place, velocity):
    """∂²L/∂q̇² and ∂L/∂q − d/dt ∂L/∂q̇ at q̈ = 0."""
    slope = jax.grad(lagrangian, argnums=2)
    mass = jax.jacfwd(slope, argnums=2)(t, place, velocity)
    rates = jnp.ones_like(t), velocity, jnp.zeros_like(velocity)
    force = jax.grad(lagrangian, argnums=1)(t, place, velocity) - jax.jvp(slope, (t, place, velocity), rates)[1]
    return mass, force


def euler_lagrange(lagrangian, place, velocity, acceleration):
    """d/dt ∂L/∂q̇ − ∂L/∂q along a motion with the given q̇ and q̈."""
    slope = jax.grad(lagrangian, argnums=1)
    _, rate = jax.jvp(slope, (place, velocity), (velocity, acceleration))
    return rate - jax.grad(lagrangian)(place, velocity)


def rotation(angles):
    """Λ = R3(ψ) R1(θ) R3(φ) for Euler's angles (ψ, θ, φ)."""
    return turn(2, angles[0]) @ turn(0, angles[1]) @ turn(2, angles[2])


def turn(axis, angle):
    """The rotation by ``angle`` about one of the axes 0, 1 and 2."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    s, c = jnp.sin(angle), jnp.cos(angle)
    return jnp.eye(3).at[j, j].set(c).at[j, k].set(-s).at[k, j].set(s).at[k, k].set(c)


def body_rates(angles):
    """The matrix T with Ω = T d/dt (ψ, θ, φ): Landau & Lifshitz, Mechanics, § 35."""
    _, theta, phi = angles
    zero, one = jnp.zeros_like(theta), jnp.ones_like(theta)
    return jnp.stack(
        [
            jnp.stack([jnp.sin(theta) * jnp.sin(phi), jnp.cos(phi), zero]),
            jnp.stack([jnp.sin(theta) * jnp.cos(phi), -jnp.sin(phi), zero]),
            jnp.stack([jnp.cos(theta), zero, one]),
        ]
    )
