"""What the compiler gives beside what XLA gives."""

import jax
import numpy as np

from jaxball.programs.native import Lowered, Refusal
from jaxball.programs.native.ir.elements import UnsupportedError


def native(f, *args, quickly=False):
    """The result of a function, compiled natively whatever it contains; an operation that is not known raises.

    - ``quickly``: whether LLVM optimises it less.
    """
    leaves, structure = jax.tree.flatten(args)
    results = []

    def of_leaves(leaves):
        arrays, result = jax.tree.flatten(f(*structure.unflatten(leaves)))
        results.append(result)
        return arrays

    program = Lowered(of_leaves, leaves, "program").compile_natively(quickly=quickly)
    if isinstance(program, Refusal):
        raise UnsupportedError(program.reason)
    return results[-1].unflatten(program(leaves))


def agree(f, *args, ulps=0.0):
    """Asserts that both compilers give the same, of the same types, NaN where NaN is: to so many roundings."""
    found, expected = native(f, *args), jax.jit(f)(*args)
    assert jax.tree.structure(found) == jax.tree.structure(expected)
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        assert one.aval == other.aval
        same(np.asarray(one), np.asarray(other), ulps)
    return found


def same(found, expected, ulps=0.0):
    """Asserts that arrays are equal to so many roundings of each number."""
    assert found.shape == expected.shape
    assert found.dtype == expected.dtype
    if found.dtype.kind == "c":
        same(found.real, expected.real, ulps)
        same(found.imag, expected.imag, ulps)
    elif found.dtype.kind == "f":
        limits = np.finfo(found.dtype)
        found, expected = (np.where(np.abs(x) <= limits.tiny, 0, x) for x in (found, expected))  # as XLA does
        np.testing.assert_allclose(found, expected, rtol=ulps * limits.eps, atol=0)
    else:
        np.testing.assert_array_equal(found, expected)


def special(dtype):
    """Numbers of a type at which operations differ: signed zeros, infinities, NaN, ties, the largest and the least."""
    dtype = np.dtype(dtype)
    if dtype.kind == "b":
        return np.array([False, True])
    if dtype.kind in "iu":
        limits = np.iinfo(dtype)
        numbers = [limits.min, limits.max, 0, 1, 2, 3, 7, 8, limits.max // 2, limits.max - 1]
        if dtype.kind == "i":
            numbers += [-1, -2, -3, -7, limits.min + 1]
        return np.array(numbers, dtype)
    if dtype.kind == "c":
        parts = np.array([0.0, -0.0, 1.0, -2.5, 0.3, 1e3], dtype.type(0).real.dtype)
        return (parts[:, None] + 1j * parts).astype(dtype).ravel()
    limits = np.finfo(dtype)
    numbers = [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 0.7, 5.25, 1e3, limits.max, limits.tiny, np.inf, np.nan]
    positive = np.array([*numbers, 1 + limits.eps, 1 - limits.eps / 2], dtype)
    return np.concatenate([positive, -positive])
