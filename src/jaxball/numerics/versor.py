"""Versors (unit quaternions, scalar first) and their rotations Λ.

Λ maps body vectors to space vectors. Source: appendix "Quaternions" of Putkaradze & Rogers (2018).
"""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .vectors import cross, dot

SMALL_ANGLE = 1e-4  # squared; the series below it have an error of a rounding


def product(p: Float[Array, "4"], q: Float[Array, "4"]) -> Float[Array, "4"]:
    """Returns the quaternion product p q."""
    scalar = p[0] * q[0] - dot(p[1:], q[1:])
    return jnp.concatenate([scalar[None], p[0] * q[1:] + q[0] * p[1:] + cross(p[1:], q[1:])])


def conjugate(q: Float[Array, "4"]) -> Float[Array, "4"]:
    """Returns the conjugate q*, which is the inverse of a versor."""
    return jnp.concatenate([q[:1], -q[1:]])


def normalize(q: Float[Array, "4"]) -> Float[Array, "4"]:
    """Returns the versor q / |q|."""
    return q / jnp.sqrt(jnp.sum(q * q))


def exponential(rotation: Float[Array, "3"]) -> Float[Array, "4"]:
    """Computes the versor of a rotation vector, whose direction is the axis and whose length the angle, rad."""
    s = dot(rotation, rotation)
    small = s < SMALL_ANGLE
    # Both branches are differentiated, so each must be finite where the other is taken.
    angle = jnp.sqrt(jnp.where(small, 1.0, s))
    real = jnp.where(small, 1 - s / 8 * (1 - s / 48 * (1 - s / 120)), jnp.cos(angle / 2))
    factor = jnp.where(small, 0.5 - s / 48 * (1 - s / 80 * (1 - s / 168)), jnp.sin(angle / 2) / angle)
    return jnp.concatenate([real[None], factor * rotation])


def logarithm(q: Float[Array, "4"]) -> Float[Array, "3"]:
    """Computes the rotation vector of a versor, of a length up to π; it is the same for q and −q, which are one
    rotation.
    """
    # Of q and −q the one that turns by at most π.
    real, imaginary = jnp.abs(q[0]), jnp.where(q[0] < 0, -q[1:], q[1:])
    s = dot(imaginary, imaginary)
    small = s < SMALL_ANGLE
    sine = jnp.sqrt(jnp.where(small, 1.0, s))
    cosine = jnp.where(small, real, 1.0)
    ratio = s / (cosine * cosine)
    series = 2 / cosine * (1 - ratio * (1 / 3 - ratio * (1 / 5 - ratio * (1 / 7 - ratio / 9))))
    return jnp.where(small, series, 2 * jnp.arctan2(sine, real) / sine) * imaginary


@functools.partial(jnp.vectorize, signature="(n,n)->(k)")
def from_rotation_matrix(Lambda: Float[Array, "3 3"]) -> Float[Array, "4"]:
    """Computes a versor of the rotation matrix Λ; of the two, the one whose largest component is positive.

    Of several, along any leading axes.
    """
    a = Lambda
    columns = jnp.stack(
        [
            jnp.stack([1 + a[0, 0] + a[1, 1] + a[2, 2], a[2, 1] - a[1, 2], a[0, 2] - a[2, 0], a[1, 0] - a[0, 1]]),
            jnp.stack([a[2, 1] - a[1, 2], 1 + a[0, 0] - a[1, 1] - a[2, 2], a[0, 1] + a[1, 0], a[0, 2] + a[2, 0]]),
            jnp.stack([a[0, 2] - a[2, 0], a[0, 1] + a[1, 0], 1 - a[0, 0] + a[1, 1] - a[2, 2], a[1, 2] + a[2, 1]]),
            jnp.stack([a[1, 0] - a[0, 1], a[0, 2] + a[2, 0], a[1, 2] + a[2, 1], 1 - a[0, 0] - a[1, 1] + a[2, 2]]),
        ]
    )
    # Each column is the versor times one of its components; the largest of these keeps digits, others may be 0.
    return normalize(columns[jnp.argmax(jnp.diagonal(columns))])


@jax.jit
def rotation_matrix(q: Float[Array, "*batch 4"]) -> Float[Array, "*batch 3 3"]:
    """Computes the rotation matrix Λ of a versor, ``eq_versor_rot``."""
    q0, q1, q2, q3 = _components(q)
    return jnp.stack(
        [
            jnp.stack([1 - 2 * (q2**2 + q3**2), 2 * (q1 * q2 - q0 * q3), 2 * (q1 * q3 + q0 * q2)], axis=-1),
            jnp.stack([2 * (q1 * q2 + q0 * q3), 1 - 2 * (q1**2 + q3**2), 2 * (q2 * q3 - q0 * q1)], axis=-1),
            jnp.stack([2 * (q1 * q3 - q0 * q2), 2 * (q2 * q3 + q0 * q1), 1 - 2 * (q1**2 + q2**2)], axis=-1),
        ],
        axis=-2,
    )


def derivative(q: Float[Array, "4"], Omega: Float[Array, "3"]) -> Float[Array, "4"]:
    """Computes q̇ = ½ q Ω♯ for the body angular velocity Ω."""
    scalar = -dot(q[1:], Omega)
    return 0.5 * jnp.concatenate([scalar[None], q[0] * Omega + cross(q[1:], Omega)])


def vertical_in_body(q: Float[Array, "*batch 4"]) -> Float[Array, "*batch 3"]:
    """Computes Γ = Λ⁻¹ e3, the upward vertical seen from the body."""
    q0, q1, q2, q3 = _components(q)
    return jnp.stack([2 * (q1 * q3 - q0 * q2), 2 * (q2 * q3 + q0 * q1), 1 - 2 * (q1**2 + q2**2)], axis=-1)


def _components(q: Float[Array, "*batch 4"]) -> tuple[Float[Array, "*batch"], ...]:
    return tuple(q[..., k] for k in range(4))
