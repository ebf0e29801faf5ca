"""The Jacobian of the vector field by forward mode against complex steps through the NumPy equations.

A complex step has no cancellation, so its derivative is exact to rounding: the two Jacobians agree to
1e-13 of their largest entry.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from tests.support import direct_sum

N = 3
SIZES = {"m": N + 1, "d": 3, "r": 1, "g": 1, "chi0": 3, "axes": 2 * N}
STEP = 1e-30


def unpacked(p):
    """The named parts of the parameter vector; works in NumPy and in JAX, real and complex."""
    parts, start = [], 0
    for size in SIZES.values():
        parts.append(p[start : start + size])
        start += size
    m, d, r, g, chi0, axes = parts
    return m, d, r[0], g[0], chi0, axes.reshape(N, 2)


def constant(t, state, u):
    """A feedback law that gives the same accelerations always."""
    return u


def ball(p, angles, u):
    """A ball whose masses are driven on ellipses by the constant accelerations ``u``."""
    m, d, r, g, chi0, axes = unpacked(p)
    masses = [
        jaxball.PointMass(m[k + 1], jaxball.Driven(jaxball.Ellipse(axes[k], frame=jaxball.SphericalFrame(*angles[k]))))
        for k in range(N)
    ]
    law = jaxball.FunctionLaw(constant, u)
    return jaxball.Ball(mass=m[0], inertia=d, radius=r, gravity=g, offset=chi0, masses=masses, law=law)


def columns(state):
    """The state as the vector x = (θ, θ̇, q, Ω, z)."""
    return jnp.concatenate([state.theta, state.thetadot, state.q, state.Omega, state.z])


def from_columns(x):
    return jaxball.BallState(x[2 * N : 2 * N + 4], x[2 * N + 4 : 2 * N + 7], x[2 * N + 7 :], x[:N], x[N : 2 * N])


@jax.jit
@jax.vmap
def jacobians(x, p, angles, u):
    def field(x, p):
        return columns(jaxball.physics.vector_field(ball(p, angles, u), jnp.asarray(0.0), from_columns(x)))

    return field(x, p), *jax.jacfwd(field, argnums=(0, 1))(x, p)


def complex_step(function, x):
    """The Jacobian of a real function that takes complex numbers."""
    return np.stack([function(x + 1j * STEP * e).imag / STEP for e in np.eye(len(x))], axis=1)


def along_versors(x):
    """The projector of changes of x to those that leave |q| = 1, where alone the equations hold."""
    projector = np.eye(len(x))
    place = slice(2 * N, 2 * N + 4)
    projector[place, place] -= np.outer(x[place], x[place])
    return projector


@pytest.fixture(scope="module")
def cases():
    rng = np.random.default_rng(51)
    count = 10
    x = rng.normal(size=(count, 2 * N + 9))
    x[:, 2 * N : 2 * N + 4] /= np.linalg.norm(x[:, 2 * N : 2 * N + 4], axis=1, keepdims=True)
    p = rng.uniform(0.4, 1.0, (count, sum(SIZES.values())))
    angles = rng.uniform(-1.5, 1.5, (count, N, 2))
    u = rng.normal(size=(count, N))
    found = jax.tree.map(np.asarray, jacobians(*map(jnp.asarray, (x, p, angles, u))))
    return zip(x, p, angles, u, *found, strict=True)


@pytest.mark.thorough
def test_jacobians_with_respect_to_state_and_parameters(cases):
    for x, p, angles, u, rates, by_state, by_parameters in cases:
        frames = [direct_sum.frisvad_frame(*pair) for pair in angles]

        def field(x, p, frames=frames, u=u):
            return direct_sum.driven_ball_field(x, (*unpacked(p), frames), u)

        np.testing.assert_allclose(rates, field(x, p), rtol=0, atol=1e-13 * np.max(np.abs(rates)))
        for found, expected in (
            (by_state @ along_versors(x), complex_step(lambda x, p=p: field(x, p), x) @ along_versors(x)),
            (by_parameters, complex_step(lambda p, x=x: field(x, p), p)),
        ):
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.max(np.abs(expected)))
            assert np.max(np.abs(expected)) > 0.1
