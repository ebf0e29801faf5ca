"""Projection goes with an explicit solver in forward mode, whose loop diffrax then chooses through the wrapper."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import simulate
from jaxball.physics.classical import FreeRigidBody, RigidBodyState
from tests.support.differences import slope


@pytest.mark.thorough
def test_the_derivative_of_a_projected_run_is_that_of_differences():
    def end(w):
        start = RigidBodyState(Omega=jnp.stack([w, jnp.full_like(w, 0.1), jnp.full_like(w, 1.5)]))
        body = FreeRigidBody(inertia=(1.0, 2.0, 3.0))
        return simulate(body, [0.0, 3.0], start, project=True, adjoint=diffrax.ForwardMode()).state.q[-1]

    end = jax.jit(end)
    q, found = jax.jvp(end, (0.4,), (1.0,))
    np.testing.assert_allclose(found, slope(end, 0.4, 1e-4, points=2), rtol=0, atol=1e-6)
    # The versor stays on the sphere, so it moves along it: that of the derivative's own steps, from which the run's
    # differs by its tolerance.
    np.testing.assert_allclose(jnp.sum(q * q), 1.0, rtol=0, atol=1e-14)
    np.testing.assert_allclose(jnp.sum(q * found), 0.0, rtol=0, atol=1e-10)
