"""What comes back from a file is compared bit for bit."""

import jax
import numpy as np


def assert_same(again, saved):
    """Of the same structure, too: types, names of joints and what there is none of."""
    assert jax.tree.structure(again) == jax.tree.structure(saved)
    for one, other in zip(jax.tree.leaves(again), jax.tree.leaves(saved), strict=True):
        assert np.asarray(one).dtype.kind == np.asarray(other).dtype.kind
        np.testing.assert_array_equal(one, other)
