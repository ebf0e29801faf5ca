"""The free rigid body against Jacobi's elliptic functions, on the separatrix, and in the symmetric case.

Runs are at tolerance 1e-12, and drift by a few hundred times that.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special

import jaxball
from jaxball.physics import classical

TIMES = np.linspace(0.0, 10.0, 41)
TOLERANCES = {"rtol": 1e-12, "atol": 1e-12}
d1, d2, d3 = MOMENTS = np.array([1.0, 1.6, 2.1])


def amplitudes(E2, M2):
    """The amplitudes of Ω for 2E and |𝕀Ω|², and the rate of the argument: Landau & Lifshitz, Mechanics, § 37."""
    low, high = E2 * d3 - M2, M2 - E2 * d1
    a = np.sqrt([low / (d1 * (d3 - d1)), low / (d2 * (d3 - d2)), high / (d3 * (d3 - d1))])
    return a, np.sqrt((d3 - d2) * high / (d1 * d2 * d3)), (d2 - d1) * low / ((d3 - d2) * high)


def run(inertia, Omega, q=(1.0, 0.0, 0.0, 0.0), times=TIMES):
    start = classical.RigidBodyState(q, Omega)
    return jaxball.simulate(classical.FreeRigidBody(inertia=inertia), times, start, **TOLERANCES).raise_if_failed()


@pytest.mark.parametrize("modulus", [0.3, 0.97])
def test_elliptic_functions(modulus):
    """Near the separatrix, k² → 1, the period is long and the motion is all jumps between rests."""
    # For 2E = 1, k² = modulus is a linear equation for |𝕀Ω|².
    ratio = modulus * (d3 - d2) / (d2 - d1)
    M2 = (d3 + ratio * d1) / (1 + ratio)
    a, rate, k2 = amplitudes(1.0, M2)
    np.testing.assert_allclose(k2, modulus, rtol=1e-12)
    trajectory = run(MOMENTS, [a[0], 0.0, a[2]])
    sn, cn, dn, _ = scipy.special.ellipj(rate * TIMES, k2)
    np.testing.assert_allclose(
        trajectory.state.Omega, np.stack([a[0] * cn, a[1] * sn, a[2] * dn], axis=1), rtol=0, atol=2e-10
    )


def test_separatrix():
    """|𝕀Ω|² = 2E d2: from the middle of the jump to rest on the unstable axis, where errors grow by e^5."""
    a, rate, k2 = amplitudes(1.0, d2)
    np.testing.assert_allclose(k2, 1.0, rtol=1e-12)
    times = TIMES * (5.0 / (rate * TIMES[-1]))
    trajectory = run(MOMENTS, [a[0], 0.0, a[2]], times=times)
    sech, tanh = 1 / np.cosh(rate * times), np.tanh(rate * times)
    np.testing.assert_allclose(
        trajectory.state.Omega, np.stack([a[0] * sech, a[1] * tanh, a[2] * sech], axis=1), rtol=0, atol=1e-10
    )


def test_laws():
    laws = run(MOMENTS, [0.3, 1.0, -0.4], q=[0.9, 0.3, -0.3, 0.1]).laws
    for name, value in laws._asdict().items():
        np.testing.assert_allclose(value, np.broadcast_to(value[0], value.shape), rtol=0, atol=5e-9, err_msg=name)
    np.testing.assert_allclose(laws.energy[0], 0.5 * np.sum(MOMENTS * np.array([0.3, 1.0, -0.4]) ** 2), rtol=1e-14)
    np.testing.assert_allclose(
        np.sum(np.asarray(laws.spatial_momentum) ** 2, axis=1), laws.momentum_squared, rtol=0, atol=1e-8
    )


def test_the_symmetric_body_turns_about_its_momentum_and_about_its_axis():
    """d1 = d2: Ω = 𝕀Ω / d1 + Ω3 (1 − d3/d1) E3, and so Λ = R(Λ𝕀Ω t / d1) Λ0 R(Ω3 (1 − d3/d1) t E3)."""
    a, c = 1.4, 2.0
    Omega0 = np.array([0.5, -0.2, 0.9])
    trajectory = run((a, a, c), Omega0)
    momentum = np.array([a, a, c]) * Omega0

    @jax.vmap
    def expected(t):
        return jax.scipy.linalg.expm(t * _hat(momentum / a)) @ jax.scipy.linalg.expm(
            t * _hat(np.array([0.0, 0.0, Omega0[2] * (1 - c / a)]))
        )

    Lambda = jax.vmap(lambda s: s.Lambda)(trajectory.state)
    np.testing.assert_allclose(Lambda, expected(jnp.asarray(TIMES)), rtol=0, atol=3e-9)


def _hat(a):
    return jnp.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
