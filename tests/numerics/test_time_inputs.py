"""Which values of a function only sampling can follow over time, told apart from polynomials and a few sinusoids."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.numerics.time_inputs import MOST_DEGREES, MOST_PHASES, depends_on_time, find_inputs
from jaxball.numerics.vectors import sine_cosine

P = jnp.array([4.7, 0.01])
X = jnp.array([0.3, -0.2])
FEW, MANY = np.arange(1.0, MOST_PHASES + 1), np.arange(1.0, MOST_PHASES + 2)


def _push(t, p):
    return jnp.exp(-(((t - p[0]) / p[1]) ** 2))


@jax.jit
def _compiled(t, p):
    return _push(t, p)


def _slowly(t):
    return jax.lax.fori_loop(0, 3, lambda k, x: 0.5 * (x + t / x), 1.0 + t)


# Functions of (t, x, p), with their inputs at time t.
WITH_INPUTS = {
    "an exponential": (lambda t, x, p: _push(t, p) * x, lambda t: [_push(t, P)]),
    "in a compiled function": (lambda t, x, p: _compiled(t, p) * x, lambda t: [_push(t, P)]),
    "the same again in a derivative": (
        lambda t, x, p: jax.jvp(lambda t: _push(t, p), (t,), (1.0,))[1] * x,
        lambda t: [_push(t, P)],
    ),
    "a quotient": (lambda t, x, p: x / (1 + t**2), lambda t: [1 / (1 + t**2)]),
    "a root": (lambda t, x, p: x * jnp.sqrt(1 + t**2), lambda t: [jnp.sqrt(1 + t**2)]),
    "many sinusoids": (lambda t, x, p: jnp.sum(jnp.sin(MANY * t)) * x, lambda t: jnp.sin(MANY * t)),
    "a high power": (lambda t, x, p: x * t ** (MOST_DEGREES + 1), lambda t: [t ** (MOST_DEGREES + 1)]),
    "a bend where it is not linear": (
        lambda t, x, p: x * jnp.maximum(jnp.sin(t), 0.9),
        lambda t: [max(np.sin(t), 0.9)],
    ),
    "chosen by a wave": (
        lambda t, x, p: x * jnp.where(jnp.sin(t) > 0.9, p[0], 0.0),
        lambda t: [4.7 if np.sin(t) > 0.9 else 0.0],
    ),
    "an iteration": (lambda t, x, p: x * _slowly(t), lambda t: [np.sqrt(t)]),
    "of the state as well": (lambda t, x, p: jnp.exp(-((t - x) ** 2)), lambda t: jnp.exp(-((t - X) ** 2))),
    "bent where it meets the state": (
        lambda t, x, p: x * jnp.maximum(t - x, p[0]),
        lambda t: jnp.maximum(t - X, 4.7),
    ),
    "jumping where it meets the state": (
        lambda t, x, p: jnp.where(t * p[0] > 1 + x, p[0], x),
        lambda t: jnp.where(t * 4.7 > 1 + X, 4.7, X),
    ),
    "a power that is large near the state": (
        lambda t, x, p: x * (1 + (t - x) ** 2) ** -2,
        lambda t: (1 + (t - X) ** 2) ** -2,
    ),
}
WITHOUT = {
    "constant": lambda t, x, p: x * p,
    "of the state alone": lambda t, x, p: jnp.exp(-x) + jnp.sqrt(x**2),
    "of parameters": lambda t, x, p: x * jnp.exp(p) * t,
    "a polynomial": lambda t, x, p: x * (1 + t * (2 + t * p[0])),
    "a few sinusoids": lambda t, x, p: x * jnp.sum(jnp.sin(FEW * t + p[0])),
    "both of one angle": lambda t, x, p: x * jnp.stack(sine_cosine(p[0] * t**3)),
    "between kinks": lambda t, x, p: jnp.where((t > p[0]) & (t < 5.0), x * (t - p[0]) ** 2, jnp.abs(t - 1) * x),
    "a row of a table": lambda t, x, p: x * p[jnp.searchsorted(p, t)],
    "called back": lambda t, x, p: x * jnp.exp(jax.pure_callback(np.sin, jax.ShapeDtypeStruct((), "float64"), t)),
    "a quotient with the state": lambda t, x, p: x / (1 + x**2 + jnp.sin(t) ** 2),
    "a polynomial over the state": lambda t, x, p: t**2 / (1 + x**2) + jnp.sin(20 * t) / (1 + x**2),
    "compared, but of waves": lambda t, x, p: jnp.maximum(jnp.sin(t) - x, 0.0) * p,
}


@pytest.mark.parametrize("name", WITH_INPUTS)
def test_inputs_are_what_only_samples_tell(name):
    function, expected = WITH_INPUTS[name]
    inputs = find_inputs(jax.make_jaxpr(function)(0.0, X, P))
    assert inputs is not None
    for t in (4.703, 2.0):
        # To rounding; the three turns of the iteration come close to their limit only.
        tolerance = 1e-2 if name == "an iteration" else 1e-13
        np.testing.assert_allclose(inputs(jnp.asarray(t), X, P), expected(t), rtol=tolerance, atol=1e-300)


@pytest.mark.parametrize("name", WITHOUT)
def test_what_a_step_sees_is_no_input(name):
    assert find_inputs(jax.make_jaxpr(WITHOUT[name])(0.0, X, P)) is None


def test_what_tells_modes_is_no_input():
    program = jax.make_jaxpr(WITH_INPUTS["bent where it meets the state"][0])(0.0, X, P)
    assert find_inputs(program, modes=True) is None


def test_inputs_are_all_that_is_computed():
    def function(t, x, p):
        return _push(t, p) * jnp.linalg.solve(jnp.diag(1 + x**2), x)

    inputs = find_inputs(jax.make_jaxpr(function)(0.0, X, P))
    assert inputs is not None
    names = {equation.primitive.name for equation in jax.make_jaxpr(inputs)(0.0, X, P).eqns}
    assert "exp" in names
    assert not any("lu" in name or "solve" in name for name in names)


@pytest.mark.parametrize(
    ("function", "depends"),
    [
        (lambda t, x, p: p * x, False),
        (lambda t, x, p: jax.jit(lambda t: (x, jnp.ones_like(t)))(t)[0], False),
        (lambda t, x, p: x + jax.lax.stop_gradient(t), True),
        (lambda t, x, p: jnp.where(t < p, x, 2 * x), True),
    ],
)
def test_whether_a_function_depends_on_time_is_seen_in_its_trace(function, depends):
    assert depends_on_time(jax.make_jaxpr(function)(0.5, jnp.ones(3), 2.0)) is depends
