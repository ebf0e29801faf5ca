"""Norms where squares vanish or overflow, against exact arithmetic."""

from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.numerics.vectors import length, norm, room, root


@pytest.mark.thorough
def test_derivatives_where_a_vector_vanishes():
    assert not np.any(jax.grad(norm)(jnp.zeros(3)))
    assert jax.grad(root)(0.0) == 0
    np.testing.assert_allclose(jax.grad(norm)(jnp.array([3.0, 0.0, -4.0])), [0.6, 0.0, -0.8], rtol=1e-15)
    assert np.all(np.isfinite(jax.hessian(norm)(jnp.zeros(3))))


def test_rounding_has_no_direction():
    assert norm(jnp.array([1e-16, 0.0])) == 0
    assert norm(jnp.array([1e-14, 0.0])) == pytest.approx(1e-14)


@pytest.mark.parametrize("scale", [1e-300, 1.0, 1e300])
def test_lengths_of_any_size(scale):
    x = np.array([2.0, 3.0, 6.0]) * scale
    square = sum(Fraction(float(part)) ** 2 for part in x)
    found = Fraction(float(length(x)))
    assert abs(found**2 / square - 1) < Fraction(1, 2**50)


def test_a_length_beyond_all_numbers_is_infinite():
    assert length(np.full(3, 1.5e308)) == np.inf
    assert np.isnan(length(np.array([np.nan, 1.0])))


def test_room_is_the_distance_to_the_sphere_to_first_order():
    x, most = jnp.array([0.0, 0.6, 0.8]), jnp.array(1.0 + 1e-9)
    assert room(x, most) == pytest.approx(1e-9, rel=1e-6)
    np.testing.assert_allclose(jax.grad(room)(x, most), -x / most, rtol=1e-15)
