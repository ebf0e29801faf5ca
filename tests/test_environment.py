"""Whether the installed JAX computes right numbers and the tests run as they should."""

import sys

import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest

from jaxball.numerics import versor
from tests.support import checked
from tests.support.precision import X64


def test_jax_computes_batched_quadratic_forms_right():
    """jax 0.10.2 gives wrong rows for this program in float64 on the CPU (jax-ml/jax#39103)."""
    rng = np.random.default_rng(0)
    matrix, rows = rng.normal(size=(3, 3)), rng.normal(size=(40_000, 3))
    found = jax.jit(jax.vmap(lambda r: jnp.sum((jnp.asarray(matrix) @ r) ** 2)))(jnp.asarray(rows))
    np.testing.assert_allclose(found, np.sum((rows @ matrix.T) ** 2, axis=1), rtol=1e-12)


@pytest.mark.any_precision
def test_the_tests_run_in_the_type_that_was_asked_for():
    assert jnp.zeros(1).dtype == (jnp.float64 if X64 else jnp.float32)


def test_shapes_are_checked():
    if "beartype" not in sys.modules:
        pytest.skip("Shapes are checked where the default tests run, not where others alone do.")
    with pytest.raises(jaxtyping.TypeCheckError, match="'3'"):
        # In a process that has called it often, one of these calls is checked.
        [versor.exponential(jnp.zeros(4)) for _ in range(checked.LATER)]
