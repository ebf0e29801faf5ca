"""Operations on single numbers: each of every type against XLA's, on special numbers and on random ones."""

from fractions import Fraction

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from jax import lax

from jaxball.programs.native.emit import builder
from jaxball.programs.native.targets import machine

from .comparison import agree, native, same, special

FLOATS = ["float64", "float32"]
INTEGERS = [f"{kind}{bits}" for kind in ("int", "uint") for bits in (8, 16, 32, 64)]
COMPLEX = ["complex128", "complex64"]


def of_lax(names):
    return {name: getattr(lax, name) for name in names.split()}


# What the processor computes, which is the same to the last bit.
EXACT = of_lax("abs neg sign floor ceil sqrt is_finite square") | {
    "away": lambda x: lax.round(x, lax.RoundingMethod.AWAY_FROM_ZERO),
    "even": lambda x: lax.round(x, lax.RoundingMethod.TO_NEAREST_EVEN),
}
# Functions of C's library, and XLA's own, which differ by some roundings.
FUNCTIONS = of_lax(
    "exp log sin cos tan tanh log1p expm1 rsqrt cbrt logistic asin acos atan sinh cosh asinh acosh atanh erf erfc"
)
PAIRS, COMPARISONS = of_lax("add sub mul div rem max min"), of_lax("eq ne lt le gt ge")
BITS = {
    "and_": lax.bitwise_and,
    "or_": lax.bitwise_or,
    "xor": lax.bitwise_xor,
    "left": lax.shift_left,
    "arithmetic": lax.shift_right_arithmetic,
    "logical": lax.shift_right_logical,
}


def pairs(dtype):
    """All pairs of special numbers: too many for registers, so that they are computed in a loop."""
    x = special(dtype)
    return tuple(np.ascontiguousarray(array.ravel()) for array in np.meshgrid(x, x))


def each(operations, *operands):
    """All operations of the operands."""
    return lambda *xs: {name: operation(*xs) for name, operation in operations.items()}, *operands


@pytest.mark.parametrize("dtype", FLOATS)
def test_one_number_exactly(dtype):
    agree(*each(EXACT, special(dtype)))


@pytest.mark.parametrize("dtype", FLOATS)
def test_functions(dtype):
    f, x = each(FUNCTIONS, special(dtype))
    expected, limits = jax.jit(f)(x), np.finfo(dtype)
    for name, found in native(f, x).items():
        # XLA sets what is below the smallest normal number to 0; its cbrt is 60 roundings off at the largest one.
        np.testing.assert_allclose(found, expected[name], rtol=64 * limits.eps, atol=2 * limits.tiny, err_msg=name)


@pytest.mark.parametrize("dtype", FLOATS)
def test_two_numbers(dtype):
    agree(*each(PAIRS | COMPARISONS, *pairs(dtype)))


@pytest.mark.parametrize("dtype", FLOATS)
def test_signs_of_zero(dtype):
    zeros = np.array([0.0, -0.0], dtype)
    x, y = (array.ravel() for array in np.meshgrid(zeros, zeros))
    f, x, y = each({name: PAIRS[name] for name in ("add", "sub", "mul", "max", "min")}, x, y)
    expected = jax.jit(f)(x, y)
    for name, found in native(f, x, y).items():
        np.testing.assert_array_equal(np.signbit(found), np.signbit(expected[name]), err_msg=name)


@pytest.mark.parametrize("dtype", FLOATS)
def test_powers_angles_and_neighbours(dtype):
    agree(*each({"pow": lax.pow, "atan2": lax.atan2}, *pairs(dtype)), ulps=16)
    agree(*each({"next": lax.nextafter}, *pairs(dtype)))


@pytest.mark.thorough
@pytest.mark.parametrize("dtype", INTEGERS)
def test_integers(dtype):
    agree(*each(PAIRS | COMPARISONS | BITS, *pairs(dtype)))
    one = {"sign": lax.sign, "inverted": lax.bitwise_not, "ones": lax.population_count, "zeros": lax.clz}
    agree(*each(one | ({"abs": lax.abs, "neg": lax.neg} if dtype.startswith("i") else {}), special(dtype)))


def test_booleans():
    chosen = {name: BITS[name] for name in ("and_", "or_", "xor")} | COMPARISONS | {"max": lax.max, "min": lax.min}
    agree(*each(chosen, *pairs(bool)))
    agree(lax.bitwise_not, special(bool))


@pytest.mark.parametrize("dtype", COMPLEX)
def test_complex_arithmetic(dtype):
    def numbers(x, y):
        sums = {"add": x + y, "sub": x - y, "eq": lax.eq(x, y), "ne": lax.ne(x, y)}
        return sums | {"conj": lax.conj(x), "real": x.real, "imag": x.imag, "neg": -x}

    agree(numbers, *pairs(dtype))
    rng = np.random.default_rng(1)
    x, y = ((rng.normal(size=100) + 1j * rng.normal(size=100)).astype(dtype) for _ in range(2))
    products = {"mul": lambda x, y: x * y, "div": lambda x, y: x / y, "abs": lambda x, y: abs(x), "pow": lax.pow}
    functions = of_lax("exp log sqrt sin cos tanh sign")

    def numbers(x, y):
        return {name: f(x, y) for name, f in products.items()} | {name: f(x) for name, f in functions.items()}

    expected = jax.jit(numbers)(x, y)
    for name, found in native(numbers, x, y).items():
        error = np.abs(found - expected[name]) / (1 + np.abs(expected[name]))
        assert np.max(error) < 64 * np.finfo(dtype).eps, name


@pytest.mark.thorough
@pytest.mark.parametrize("source", [*FLOATS, *INTEGERS, *COMPLEX, "bool"])
def test_conversions(source):
    x = special(source)
    targets = COMPLEX if source in COMPLEX else [*FLOATS, *INTEGERS, *COMPLEX, "bool"]
    agree(lambda x: [lax.convert_element_type(x, dtype) for dtype in targets], x)


def test_bits_as_another_type():
    agree(lambda x: lax.bitcast_convert_type(x, np.int64), special("float64"))
    agree(lambda x: lax.bitcast_convert_type(x, np.float32), special("uint32"))
    agree(lambda x: lax.bitcast_convert_type(x, np.uint8), special("int8"))


@pytest.mark.parametrize("dtype", ["float64", "int32", "complex128", "bool"])
def test_selection(dtype):
    x, y = pairs(dtype)
    condition = np.arange(x.size) % 3 == 0
    agree(lambda c, x, y: (jnp.where(c, x, y), lax.select(c[0], x, y)), condition, x, y)


def test_clamping():
    x, y = pairs("float64")
    agree(lambda x, y: (lax.clamp(x, y, x + 1), lax.clamp(-1.0, y, 2.0)), x, y)


def test_subnormal_numbers_stay():
    """XLA sets them to 0; the processor need not."""
    least = np.float64(5e-324)
    assert native(lambda x: x * 3, least) == 3 * least


@pytest.mark.parametrize("shape", [(), (1,), (0,), (3, 0, 2), (1, 1), (65,), (1, 100, 1)])
def test_shapes(shape):
    x = np.random.default_rng(0).normal(size=shape)
    agree(lambda x: (x + 1, jnp.maximum(x, 0.0), x > 0), x)


def test_all_numbers_known():
    """Constants are folded as they are computed."""
    x = special("float64")
    agree(lambda: (jnp.asarray(x) * 2 - jnp.asarray(x), -jnp.asarray(x), jnp.asarray(x) > 1))
    y = special("int32")
    agree(lambda: (jnp.asarray(y) * y[1], jnp.asarray(y) - y[0], -jnp.asarray(y)))
    same(np.asarray(native(lambda: 1j * jnp.ones(3, complex))), 1j * np.ones(3))


def test_functions_are_right():
    """To three roundings, by mpmath."""
    x = np.random.default_rng(2).uniform(0.05, 0.95, 40)
    names = ("sin", "cos", "tan", "exp", "log", "tanh", "asin", "erf", "cbrt")
    found = native(lambda x: {name: FUNCTIONS[name](x) for name in names}, x)
    for name in names:
        expected = np.array([float(getattr(mpmath, name)(mpmath.mpf(number))) for number in x])
        np.testing.assert_allclose(found[name], expected, rtol=3 * np.finfo(float).eps, err_msg=name)


@pytest.mark.parametrize("dtype", FLOATS)
def test_fewer_bits(dtype):
    x = np.concatenate([special(dtype), np.random.default_rng(3).normal(size=200).astype(dtype) * 1e-4])
    agree(lambda x: [lax.reduce_precision(x, *bits) for bits in ((5, 10), (8, 7), (4, 3), (8, 23), (11, 52))], x)


@pytest.mark.parametrize("count", [3, 70])
def test_bits_as_numbers_of_another_length(count):
    x = np.random.default_rng(4).normal(size=count)

    def bits(x):
        halves = lax.bitcast_convert_type(x, np.uint32)
        return halves, lax.bitcast_convert_type(halves, np.float64), lax.bitcast_convert_type(x, np.int16) + 1

    agree(bits, x)


SPECIAL_FUNCTIONS = of_lax("erf_inv lgamma digamma bessel_i0e bessel_i1e")


@pytest.mark.thorough
@pytest.mark.parametrize("dtype", FLOATS)
def test_special_functions(dtype):
    """Written out by StableHLO's own rules, as XLA's."""
    x = np.concatenate([special(dtype), np.random.default_rng(5).uniform(-20, 20, 100).astype(dtype)])
    x = x[np.abs(x) < 1e30]

    def functions(x):
        y = jnp.abs(x) + 1
        more = (
            lax.igamma(y, y / 2),
            lax.betainc(y, y + 1, 1 / y),
            lax.zeta(y + 1, y),
            lax.polygamma(jnp.ones_like(y), y),
        )
        return {name: f(x) for name, f in SPECIAL_FUNCTIONS.items()}, more, lax.top_k(x, 5)

    found, expected = native(functions, x), jax.jit(functions)(x)
    eps = np.finfo(dtype).eps
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(one, other, rtol=500 * eps, atol=500 * eps)


def test_a_sum_with_a_product_is_rounded_once():
    """Where the processor can do that; the exact value is that of fractions."""
    x, y, z = (np.random.default_rng(k).normal(size=50) for k in range(3))
    signs = {(1, 1): lambda x, y, z: x * y + z, (1, -1): lambda x, y, z: x * y - z, (-1, 1): lambda x, y, z: z - x * y}
    for (of_product, of_other), f in signs.items():
        exact = [
            of_product * Fraction(a) * Fraction(b) + of_other * Fraction(c) for a, b, c in zip(x, y, z, strict=True)
        ]
        once = np.array([float(number) for number in exact])
        if machine.multiplies_and_adds():
            np.testing.assert_array_equal(native(f, x, y, z), once)
        else:
            np.testing.assert_array_equal(native(f, x, y, z), f(x, y, z))
    assert native(lambda x, y: x * y - x * y, x[0], y[0]) == 0.0  # one product, and no rounding of another


def test_without_the_instruction_products_and_sums_are_rounded_each(monkeypatch):
    monkeypatch.setattr(builder, "multiplies_and_adds", lambda: False)
    x, y, z = (np.random.default_rng(k).normal(size=50) for k in range(3))
    np.testing.assert_array_equal(native(lambda x, y, z: x * y + z, x, y, z), x * y + z)
