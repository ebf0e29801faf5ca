"""The Illinois method against zeros known in closed form, and its order."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.numerics.roots import Sample, next_point, other_end

CASES = [
    pytest.param(lambda x, xp: x**2 - 2, 0.0, 2.0, np.sqrt(2), id="square-root"),
    pytest.param(lambda x, xp: xp.exp(-x) - x, 0.0, 1.0, 0.5671432904097838730, id="omega-constant"),
    pytest.param(lambda x, xp: xp.cos(x), 3.0, 0.0, np.pi / 2, id="decreasing"),
    pytest.param(lambda x, xp: x**9, -0.5, 1.0, 0.0, id="flat"),
]


def samples(f, a, b, count, xp):
    old, new = Sample(a, f(a, xp)), Sample(b, f(b, xp))
    places = []
    for _ in range(count):
        x = next_point(old, new, xp)
        newest = Sample(x, f(x, xp))
        old, new = other_end(old, new, newest, xp), newest
        assert newest.f * old.f <= 0 or newest.f == 0  # still a bracket
        places.append(float(x))
    return np.array(places)


@pytest.mark.parametrize(("f", "a", "b", "zero"), CASES[:3])
def test_zeros_in_closed_form(f, a, b, zero):
    assert samples(f, a, b, 12, np)[-1] == pytest.approx(zero, abs=4e-16)


def test_a_zero_of_high_order_stays_bracketed():
    f, a, b, _ = CASES[3].values
    assert abs(samples(f, a, b, 200, np)[-1]) < 1e-4


def test_three_evaluations_cube_the_error():
    # Dowell & Jarratt (1971): the errors of three steps multiply to the third power, an order of 3^(1/3).
    errors = np.abs(samples(lambda x, xp: xp.exp(x) - 2, 0.0, 2.0, 9, np) - np.log(2))
    assert np.all(errors[5:8] < errors[2:5] ** 2.2)


def test_in_a_loop_of_jax():
    def improve(_, bracket):
        old, new = bracket
        x = next_point(old, new)
        newest = Sample(x, jnp.cos(x))
        return other_end(old, new, newest), newest

    ends = [Sample(x, jnp.cos(x)) for x in jnp.array([[1.0, 4.0], [2.0, 5.0]])]
    _, zero = jax.lax.fori_loop(0, 12, improve, tuple(ends))
    np.testing.assert_allclose(zero.x, [np.pi / 2, 3 * np.pi / 2], rtol=0, atol=1e-15)


def test_a_zero_that_is_found_stays():
    found = samples(lambda x, xp: x - 0.25, 0.0, 1.0, 4, np)
    assert np.all(found == 0.25)
