"""The equations of motion from the energies alone, by the principle of Lagrange and d'Alembert.

The Lagrangian l(Ω, Y_0, Γ, t) of section 3.1 is all that is written down here. Its derivatives are
automatic, and so are the velocities of the masses, which come from their places as functions of time.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.physics.dynamics.moments import kinematics, point_mass_values
from tests.support.systems import random_cases


def positions(ball, t):
    """χ_i(t) for i = 0 … n; their velocities are left to forward mode."""
    return jnp.concatenate([ball.offset[None], kinematics(ball, t, (jnp.zeros(0),) * 3).chi])


def lagrangian(ball, Omega, Y0, Gamma, t):
    """l = T − V with Y_i = Y_0 + Ω × (χ_i − χ_0) + χ̇_i, and Y_0 that of the shell's centre of mass."""
    m = jnp.concatenate([ball.mass[None], point_mass_values(ball)])
    chi, chidot = jax.jvp(lambda t: positions(ball, t), (t,), (jnp.ones_like(t),))
    Y = Y0[None] + jnp.cross(Omega[None], chi - chi[:1]) + chidot
    kinetic = 0.5 * jnp.sum(ball.inertia * Omega**2) + 0.5 * jnp.sum(m * jnp.sum(Y**2, axis=1))
    return kinetic - ball.gravity * jnp.sum(m * jnp.sum(chi * Gamma[None], axis=1))


def variation(ball, t, state, Omegadot):
    """The coefficient of the variation Σ in ``eq:rball_vars_p4`` on the constraint distribution Ψ = Σ × s_0.

    Integrated by parts, δl = (∂l/∂Ω)·δΩ + (∂l/∂Y_0)·δY_0 + (∂l/∂Γ)·δΓ with δΩ = Σ̇ + Ω × Σ,
    δY_0 = Ψ̇ + Ω × Ψ − Σ × Y_0 and δΓ = Γ × Σ. The force adds Fe·δz = F̃·(Σ × rΓ).
    """
    r, chi0 = ball.radius, ball.offset

    def slopes(Omega, Gamma, t):
        Y0 = jnp.cross(Omega, r * Gamma + chi0)
        return jax.grad(lambda *x: lagrangian(ball, *x, t), argnums=(0, 1, 2))(Omega, Y0, Gamma)

    Omega, Lambda = state.Omega, state.Lambda
    Gamma, Ftilde = Lambda[2], Lambda.T @ ball.force(t)
    rates = Omegadot, jnp.cross(Gamma, Omega), jnp.ones_like(t)
    (spin, slide, tilt), (spin_rate, slide_rate, _) = jax.jvp(slopes, (Omega, Gamma, t), rates)
    s0 = r * Gamma + chi0
    psi = -(slide_rate + jnp.cross(Omega, slide))
    sigma = -(spin_rate + jnp.cross(Omega, spin)) + jnp.cross(slide, jnp.cross(Omega, s0)) + jnp.cross(tilt, Gamma)
    return sigma + jnp.cross(s0, psi) + jnp.cross(r * Gamma, Ftilde), jnp.linalg.norm(spin_rate) + 1


@jax.jit
@jax.vmap
def variations(ball, t, state):
    Omegadot = jaxball.physics.vector_field(ball, t, state).Omega
    both = jnp.stack([Omegadot, Omegadot + 1e-3])
    found, scale = jax.vmap(lambda Omegadot: variation(ball, t, state, Omegadot))(both)
    return found / scale[:, None]


@pytest.mark.parametrize("kind", ["scheduled", "static", pytest.param("every motion", marks=pytest.mark.slow)])
def test_the_variation_vanishes_on_the_solution_and_only_there(kind):
    """A few hundred roundings of terms no larger than ``scale``: 1e-12."""
    at_solution, beside_it = np.moveaxis(variations(*random_cases(kind, seed=11)), 1, 0)
    assert np.max(np.abs(at_solution)) < 1e-12
    assert np.min(np.max(np.abs(beside_it), axis=1)) > 1e-5
