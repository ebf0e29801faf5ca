"""First excursions above zero: narrow ones, those between kinks, and none where a function only comes close."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.numerics.excursions import first_excursion

TIMES = jnp.array([0.0, 1.0])
NONE, MARGIN = jnp.zeros(0), jnp.asarray(1e-9)


@jax.jit
def begin_of_bell(at, width, level):
    """A bell of height 1 that is above ``level`` from ``at`` − w √(−ln level) on, beside a function that never is."""
    return first_excursion(
        lambda t: jnp.stack([jnp.exp(-(((t - at) / width) ** 2)) - level, jnp.sin(20 * t) - 1.1]), MARGIN, TIMES, NONE
    ).begin


@pytest.mark.parametrize("width", [0.1, 1e-2, 1e-3])
def test_a_bell_is_found_wherever_it_is(width):
    for at in np.random.default_rng(0).uniform(0.1, 0.9, 20):
        for level in (0.05, 0.99):
            wanted = max(at - width * np.sqrt(-np.log(level)), 0.0)
            np.testing.assert_allclose(begin_of_bell(at, width, level), wanted, rtol=0, atol=1e-12)
        assert begin_of_bell(at, width, 1.001) == np.inf


def test_many_swings_that_reach_zero_are_none():
    found = first_excursion(lambda t: jnp.sin(300 * t)[None] - 1, MARGIN, TIMES, NONE)
    assert found.begin == np.inf
    found = first_excursion(lambda t: jnp.sin(300 * t)[None] + 1e-3 * t - 1, MARGIN, TIMES, NONE)
    # The first of the tops, at (2 n + 1/2) π / 300, is above at once: 300²/2 (t − top)² = 1e-3 top there.
    top = np.pi / 600
    np.testing.assert_allclose(found.begin, top - np.sqrt(2e-3 * top) / 300, rtol=0, atol=1e-6)


def test_a_triangle_between_kinks_is_found_however_narrow_it_is():
    for width in (1e-3, 1e-5, 1e-8):
        kinks = 0.4321 + width * jnp.array([0.0, 1.0, 2.0])
        found = first_excursion(
            lambda t, width=width: jnp.maximum(1 - jnp.abs(t - 0.4321 - width) / width, 0.0)[None] - 0.5,
            MARGIN,
            TIMES,
            kinks,
        )
        np.testing.assert_allclose(found.begin, 0.4321 + width / 2, rtol=0, atol=1e-6 * width + 1e-15)


def test_one_that_begins_above_or_is_nowhere_finite():
    assert first_excursion(lambda t: (0.5 - t)[None], MARGIN, TIMES, NONE).begin == 0
    assert first_excursion(lambda t: (t * jnp.nan)[None], MARGIN, TIMES, NONE).begin == np.inf
