"""What results of programs depend on: where it is known from their formulas, also through branches and loops."""

import jax
import jax.numpy as jnp
import pytest
from jax import lax

from jaxball.programs.derivatives.dependence import evaluate_chosen, varying, varying_in_loop


def shifted(x, y, z):
    """After three turns, what began with z depends on x."""
    return lax.fori_loop(0, 3, lambda _, at: (at[0], at[0], at[1]), (x, y, z))


def summed(x, y, z):
    total, each = lax.scan(lambda at, item: (at + item, item * z), x, jnp.stack([y, y]))
    return total, each


CASES = [
    (lambda x, y, z: (x * y, z, lax.stop_gradient(x)), (True, False, False)),
    (lambda x, y, z: (x > y, jnp.where(x > y, z, y)), (False, False)),
    (lambda x, y, z: jax.jit(lambda u, v: (u, v))(x + y, z), (True, False)),
    (lambda x, y, z: lax.cond(y > z, lambda: (x, y), lambda: (y, z)), (True, False)),
    (shifted, (True, True, True)),
    (summed, (True, False)),
]


@pytest.mark.parametrize(("function", "expected"), CASES)
def test_what_varies_with_the_first_argument(function, expected):
    program = jax.make_jaxpr(function)(1.0, 2.0, 3.0)
    assert tuple(varying(program, [False] * len(program.consts), [True, False, False])) == expected


def test_what_varies_after_any_number_of_turns():
    program = jax.make_jaxpr(lambda x, y, z: (x, x, y))(1.0, 2.0, 3.0)
    assert varying_in_loop(program, [], [True, False, False]) == [True, True, True]
    assert varying_in_loop(program, [], [False, False, True]) == [False, False, True]


def test_only_what_is_needed_is_computed_and_some_of_it_is_known():
    program = jax.make_jaxpr(lambda x: (jnp.sin(x) + 1.0, jnp.cos(x)))(0.5)
    seen = []

    def known(equation, operands):
        seen.append(equation.primitive.name)
        return [2.0] if equation.primitive.name == "sin" else None

    assert evaluate_chosen(program, [], [0.5], [True, False], known) == [3.0]
    assert seen == ["sin", "add"]
