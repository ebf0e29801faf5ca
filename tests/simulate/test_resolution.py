"""How long steps may be by samples, against Chebyshev series and the widths of what was sampled."""

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial import chebyshev

from jaxball.simulation.inputs import (
    CELLS,
    INTERVALS,
    LONG,
    SHORT,
    Range,
    extent_of,
    failing_windows,
    in_cell,
    longest_step,
)

PLACES = np.arange(INTERVALS + 1.0)


def _failing(samples, tolerance, breaks=None):
    samples = jnp.asarray(samples)[:, None]
    extent = Range.none(samples[0]).including(samples)
    return failing_windows(samples, breaks, extent, jnp.asarray(tolerance))


def _longest(failing):
    return np.array([float(longest_step(in_cell(failing, jnp.asarray(cell)))) for cell in range(CELLS)])


@pytest.mark.parametrize("window", LONG + SHORT)
def test_weights_give_the_last_coefficient_of_a_polynomial(window):
    n = window.order
    coefficients = np.random.default_rng(n).normal(size=n + 1)
    samples = chebyshev.chebval(np.linspace(-1, 1, n + 1), coefficients)
    # The difference of order n takes up to 2ⁿ roundings of the samples, which the weights hold.
    rounding = np.finfo(float).eps * np.sum(np.abs(window.weights)) * n
    np.testing.assert_allclose(np.dot(window.weights, samples), coefficients[-1], atol=rounding)


@pytest.mark.parametrize("degree", [0, 1, 7, 15])
def test_polynomials_are_followed_everywhere(degree):
    samples = ((PLACES - 100) / 150) ** degree
    assert np.all(_failing(samples, 1e-12) == 0)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-12])
@pytest.mark.parametrize("width", [0.3, 1.0, 4.0])
@pytest.mark.parametrize("centre", [3.3, 100.4, 131.9, 250.0])
def test_steps_are_short_at_a_push_and_free_far_from_it(width, centre, tolerance):
    samples = np.exp(-(((PLACES - centre) / width) ** 2))
    longest = _longest(_failing(samples, tolerance))
    at_push = longest[int(centre * CELLS / INTERVALS)]
    # Within 4 widths on either side it is above 1e-7 of its peak.
    assert at_push <= max(1.0, 8 * width)
    # A window of the highest order that fails is within 16 samples of a narrow push.
    edges = np.arange(CELLS + 1) * INTERVALS / CELLS
    far = (edges[:-1] > centre + 32 + 8 * width) | (edges[1:] < centre - 32 - 8 * width)
    assert np.all(longest[far] >= LONG[-1].longest)


def test_jumps_at_which_steps_end_do_not_count():
    samples = np.where(PLACES < 100.5, 0.0, 1.0)
    assert np.any(_failing(samples, 1e-6) > 0)
    breaks = jnp.asarray((PLACES > 100.5).astype(int))
    assert np.all(_failing(samples, 1e-6, breaks) == 0)


def test_constants_with_rounding_errors_do_not_count():
    noise = np.random.default_rng(3).uniform(-1, 1, PLACES.size)
    assert np.all(_failing(7.0 + 8 * np.finfo(float).eps * noise, 1e-12) == 0)


def test_the_extent_of_cells():
    assert [int(end) for end in extent_of(jnp.asarray(0b0110_1000, jnp.uint32))] == [3, 7]
    assert [int(end) for end in extent_of(jnp.asarray(0, jnp.uint32))] == [CELLS, 0]
    assert [int(end) for end in extent_of(jnp.asarray(2**32 - 1, jnp.uint32))] == [0, CELLS]
