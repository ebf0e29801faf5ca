"""Least squares against NumPy's."""

import jax
import numpy as np
import pytest

from jaxball.numerics.linear import least_squares


@pytest.mark.parametrize(("rows", "n", "decades"), [(5, 1, 0.0), (9, 9, 2.0), (19, 9, 6.0)])
def test_it_is_numpys(rows, n, decades):
    """The error is that of rounding times the condition number, and the residual is no larger than the least."""
    rng = np.random.default_rng(0)
    u, v = (np.linalg.qr(rng.normal(size=(size, n)))[0] for size in (rows, n))
    matrix, wanted = u * 10 ** np.linspace(0, -decades, n) @ v.T, rng.normal(size=rows)
    x = np.asarray(jax.jit(least_squares)(matrix, wanted))
    expected = np.linalg.lstsq(matrix, wanted)[0]
    np.testing.assert_allclose(x, expected, atol=1e-14 * 10 ** (2 * decades), rtol=1e-12)
    residuals = [np.linalg.norm(matrix @ one - wanted) for one in (x, expected)]
    assert residuals[0] <= residuals[1] * (1 + 1e-12) + 1e-13
