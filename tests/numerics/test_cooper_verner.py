"""The Runge–Kutta method of order 8: conditions on its coefficients, and the order that it shows."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxball.numerics import cooper_verner
from tests.support.precision import differences_need_float64


def test_moments_of_its_nodes_and_weights():
    """Σ b c^k = 1/(k + 1) for k < 8: with weights of Lobatto's rule, and nodes that are the sums of rows."""
    nodes = np.array([0.0, *(sum(row) for row in cooper_verner.STAGES)])
    moments = [np.sum(np.asarray(cooper_verner.WEIGHTS) * nodes**k) for k in range(8)]
    np.testing.assert_allclose(moments, 1 / np.arange(1, 9), rtol=1e-14)


@differences_need_float64
def test_order_on_the_free_rigid_body():
    """Errors at t = 4 fall as h⁸, as do those of Euler's equations, against a hundred times as many steps."""
    moments = jnp.asarray([0.9, 1.4, 2.0])

    def slope(Omega):
        return -jnp.cross(Omega, moments * Omega) / moments

    @jax.jit
    def after(count):
        h = 4.0 / count
        return jax.lax.fori_loop(0, count, lambda _, x: cooper_verner.step(slope, x, h), jnp.asarray([1.0, 0.1, 1.2]))

    exact = after(jnp.asarray(400))
    coarse, fine = (float(jnp.max(jnp.abs(after(jnp.asarray(n)) - exact))) for n in (8, 16))
    assert fine < 1e-8
    assert 7.5 < np.log2(coarse / fine) < 9.5
