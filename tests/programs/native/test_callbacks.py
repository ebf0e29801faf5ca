"""Functions of Python within programs."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from jax.experimental import io_callback

import jaxball
from jaxball.programs.native import CallbackReachedError
from jaxball.programs.native.ir.elements import UnsupportedError

from .comparison import native


def checked(x, n):
    """A square root, with an error in turn n of a loop."""

    def turn(i, y):
        return eqx.error_if(jnp.sqrt(y), i == n, "turn n")

    return lax.fori_loop(0, 9, turn, x)


def test_errors_that_are_raised_and_those_that_are_not():
    np.testing.assert_allclose(native(checked, 3.0, 99), 3.0 ** (1 / 512))
    with pytest.raises(CallbackReachedError):
        native(checked, 3.0, 5)
    with pytest.raises(Exception, match="turn n"):
        jax.block_until_ready(jaxball.jit(checked)(3.0, 5))


def test_a_callback_in_a_function_that_stays_one():
    """What called it ends as well."""
    calls = []

    @jax.jit
    def long(x, i):
        for k in range(120):
            x = jnp.sin(x) + 0.01 * k
        called = lambda x: io_callback(lambda x: calls.append(float(x)) or x, x, x)  # noqa: E731
        return lax.cond(i == 3, called, lambda x: x, x)

    def f(x, n):
        return lax.fori_loop(0, n, lambda i, y: long(long(y, i), 2 * i), x)

    assert native(f, 1.0, 1) == pytest.approx(float(jax.jit(f)(1.0, 1)))
    assert not calls
    with pytest.raises(CallbackReachedError):
        native(f, 1.0, 5)
    assert not calls
    found = jaxball.jit(f)(1.0, 5)
    assert len(calls) == 1
    assert found == pytest.approx(float(jax.jit(f)(1.0, 5)))


@pytest.mark.parametrize("ordered", [True, False])
def test_effects_that_are_always_wanted(ordered):
    seen = []

    def f(x):
        io_callback(lambda x: seen.append(int(x)) or np.int64(0), jax.ShapeDtypeStruct((), int), x, ordered=ordered)
        return 2 * x

    with pytest.raises(UnsupportedError, match=r"A callback of Python|A value of type !stablehlo.token"):
        native(f, 3)
    assert jaxball.jit(f)(3) == 6
    jax.effects_barrier()
    assert seen == [3]
