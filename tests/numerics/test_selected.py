import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.numerics.arrays import select_tree

FIRST = {"number": jnp.asarray(1.5), "vector": jnp.arange(3.0), "mode": jnp.asarray(2)}
SECOND = {"number": jnp.asarray(-0.0), "vector": jnp.full(3, jnp.nan), "mode": jnp.asarray(1)}


@pytest.mark.parametrize("holds", [True, False])
def test_arrays_are_those_of_one_side_to_the_last_bit(holds):
    found = jax.jit(select_tree)(holds, FIRST, SECOND)
    for name, array in (FIRST if holds else SECOND).items():
        assert np.asarray(found[name]).tobytes() == np.asarray(array).tobytes()


def test_in_a_batch_each_row_has_its_own():
    found = jax.vmap(lambda holds: select_tree(holds, FIRST, SECOND))(jnp.asarray([True, False]))
    np.testing.assert_array_equal(found["vector"], jnp.stack([FIRST["vector"], SECOND["vector"]]))


def test_derivatives_are_those_of_the_side_that_is_selected():
    def of(x):
        return select_tree(x > 0, 3 * x, x**2)

    assert jax.jacfwd(of)(4.0) == jax.jacrev(of)(4.0) == 3.0
    assert jax.jacfwd(of)(-4.0) == jax.jacrev(of)(-4.0) == -8.0


def test_conditions_and_arrays_may_have_other_shapes():
    condition = jnp.asarray([True, False, True])
    np.testing.assert_array_equal(select_tree(condition, FIRST["vector"], jnp.asarray(7.0)), [0.0, 7.0, 2.0])
    np.testing.assert_array_equal(select_tree(jnp.asarray(False), FIRST["vector"], jnp.asarray(7.0)), np.full(3, 7.0))
    np.testing.assert_array_equal(select_tree(condition, *[jnp.asarray(7.0)] * 2), np.full(3, 7.0))


def test_what_is_the_same_in_both_is_not_selected():
    text = str(jax.make_jaxpr(lambda holds, x: select_tree(holds, x, x))(True, 1.0))
    assert "select" not in text
