"""Programs for machines without C's library: what they call, and what they compute beside what C's library does."""

import functools
import re

import jax
import jax.numpy as jnp
import llvmlite.binding as llvm
import mpmath
import numpy as np
import pytest
from jax import lax

from jaxball.programs.native import Lowered
from jaxball.programs.native.emit import lowering
from jaxball.programs.native.emit.scalars import complex, real
from jaxball.programs.native.ir.elements import UnsupportedError
from jaxball.programs.native.ir.module import Module
from jaxball.programs.native.limits import LANES
from tests.support.sentences import refuses

from .arrays import Compiled, written_program

# What processors and GPUs compute without a library.
INSTRUCTIONS = {"ceil", "copysign", "ctlz", "ctpop", "fabs", "floor", "fma", "fshl", "maximum", "maxnum", "minimum"}
INSTRUCTIONS |= {"rint", "round", "roundeven", "sqrt", "trunc", "vector.reduce.or"}
OF_TWO = {"add", "atan2", "divide", "maximum", "minimum", "multiply", "next_after", "power", "remainder", "subtract"}
OF_BITS = {"and", "count_leading_zeros", "not", "or", "popcnt", "xor"}
OF_BITS |= {f"shift_{name}" for name in ("left", "right_arithmetic", "right_logical")}
OF_REAL = sorted(real.SCALARS.keys() - OF_BITS)
OF_COMPLEX = sorted(complex.SCALARS)
INVERSE = ("acos", "acosh", "asin", "asinh", "atan", "atanh")
FUNCTIONS = {name: name for name in (*INVERSE, "cosh", "log", "sinh", "sqrt", "tan", "tanh")}
FUNCTIONS |= {"cosine": "cos", "exponential": "exp", "sine": "sin"}


OF_C = {
    "acos",
    "acosh",
    "asin",
    "asinh",
    "atan",
    "atan2",
    "atanh",
    "cbrt",
    "cexp",
    "cos",
    "cosh",
    "csqrt",
    "erf",
    "erfc",
}
OF_C |= {"exp", "expm1", "fmod", "hypot", "log", "log1p", "nextafter", "pow", "sin", "sinh", "tan", "tanh"}


def result_of(name, dtype):
    """The type of a function's result."""
    if name == "is_finite":
        return np.dtype(bool)
    return np.dtype(f"f{dtype.itemsize // 2}") if dtype.kind == "c" and name in ("abs", "imag", "real") else dtype


def assert_calls_no_library(text):
    assert "frem" not in text
    for symbol in re.findall(r"^declare .*?@([\w.]+)\(", text, re.MULTILINE):
        assert symbol.startswith("llvm."), symbol
        assert symbol.removeprefix("llvm.").rpartition(".")[0] in INSTRUCTIONS, symbol


@functools.cache
def compiled(family, name, dtype, has_library, in_lanes=False):
    dtype = np.dtype(dtype)
    operands = 1 + (name in OF_TWO)
    return Compiled(family.SCALARS[name], dtype, result_of(name, dtype), operands, has_library, in_lanes)


@pytest.mark.parametrize("in_lanes", [False, True])
@pytest.mark.parametrize(("family", "dtype"), [(real, "f8"), (real, "f4"), (complex, "c16"), (complex, "c8")])
def test_no_operation_calls_the_library(family, dtype, in_lanes):
    dtype = np.dtype(dtype)
    for name in OF_REAL if family is real else OF_COMPLEX:
        compute, operands = family.SCALARS[name], 1 + (name in OF_TWO)
        text = written_program(compute, dtype, result_of(name, dtype), operands, False, in_lanes)
        assert_calls_no_library(text)


def test_no_known_number_is_left_to_the_library():
    compute = lambda b, dtype, x: real.add(b, dtype, x, real.SCALARS["sine"](b, dtype, dtype.type(2.0)))  # noqa: E731
    assert_calls_no_library(written_program(compute, np.dtype(float), np.dtype(float), 1, False))


@pytest.mark.thorough
def test_a_whole_program_calls_no_library(monkeypatch):
    """Functions of arrays in registers, in vectors and in memory, differentiated, of both precisions."""
    monkeypatch.setattr(lowering, "Module", lambda target: Module(target._replace(has_library=False)))
    unary = [lax.exp, lax.log, lax.sin, lax.cos, lax.tan, lax.tanh, lax.log1p, lax.expm1, lax.cbrt, lax.logistic]
    unary += [lax.asin, lax.acos, lax.atan, lax.sinh, lax.cosh, lax.asinh, lax.acosh, lax.atanh, lax.erf, lax.erfc]

    def f(x):
        numbers = jnp.stack([function(x) for function in unary])
        pairs = lax.pow(x, x) + lax.atan2(x, x) + lax.rem(x, x + 1)
        return numbers.sum() + pairs.sum() + abs(jnp.exp(lax.complex(x, x)) + jnp.sqrt(lax.complex(x, x))).sum()

    def of_leaves(leaves):
        (x,) = leaves
        return [*jax.value_and_grad(f)(x), lax.nextafter(x, x + 1)]

    for dtype in (jnp.float64, jnp.float32):
        for size in (2, 8, 100):
            text = Lowered(of_leaves, [jnp.linspace(0.1, 0.9, size, dtype=dtype)], "program").as_text()
            assert "@elementary.asinh." in text
            assert "frem" not in text
            calls = set(re.findall(r"call [^@\n]*@([\w.]+)\(", text))
            assert not calls & {name + end for name in OF_C for end in ("", "f")}
            assert not {name for name in calls if name.startswith(tuple(f"llvm.{function}." for function in OF_C))}


def test_functions_that_only_the_library_has_are_refused():
    with refuses(UnsupportedError, "The function lgamma where there"):
        written_program(real.library("lgamma"), np.dtype(float), np.dtype(float), 1, has_library=False)


@pytest.mark.thorough
def test_gpus_have_all_that_is_called():
    """Compiled for NVIDIA's: LLVM leaves no function to be found elsewhere, and contracts no products and sums."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    triple = "nvptx64-nvidia-cuda"
    machine = llvm.Target.from_triple(triple).create_target_machine(cpu="sm_70", opt=2)
    for family, dtype in ((real, "f8"), (real, "f4"), (complex, "c16")):
        dtype = np.dtype(dtype)
        for name in OF_REAL if family is real else OF_COMPLEX:
            compute, operands = family.SCALARS[name], 1 + (name in OF_TWO)
            module = llvm.parse_assembly(written_program(compute, dtype, result_of(name, dtype), operands, False))
            module.triple, module.data_layout = triple, str(machine.target_data)
            text = machine.emit_assembly(module)
            assert ".extern" not in text, name
            assert not re.search(r"\b(add|sub|mul)\.f(32|64)", text), name  # without .rn, ptxas may fuse them


NUMBERS = np.concatenate(
    [np.random.default_rng(1).uniform(-3, 3, 400), 10.0 ** np.random.default_rng(2).uniform(-40, 38, 400)]
)
NUMBERS = np.concatenate([NUMBERS, -NUMBERS, [0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 1e-45]])


@pytest.mark.thorough
@np.errstate(all="ignore")
@pytest.mark.parametrize("has_library", [False, True])
def test_of_32_bits_are_those_of_64_rounded(has_library):
    """In vectors, where there is a C library, too; and the same everywhere."""
    x = NUMBERS.astype("f4")
    for name in OF_REAL:
        if name in ("is_finite", "logistic", "next_after", "rsqrt"):
            continue
        others = [np.roll(x, 3)] * (name in OF_TWO)
        found = compiled(real, name, "f4", has_library, has_library)(x, *others)
        exact = compiled(real, name, "f8", False)(x, *others).astype("f4")
        np.testing.assert_array_equal(found, exact, err_msg=name)


@np.errstate(all="ignore")
@pytest.mark.parametrize("in_lanes", [False, True])
@pytest.mark.parametrize("dtype", ["f8", "f4"])
def test_neighbours_and_remainders_are_exact(dtype, in_lanes):
    limits = np.finfo(dtype)
    ends = [limits.max, -limits.max, limits.tiny, -limits.tiny, limits.smallest_subnormal, -limits.smallest_subnormal]
    numbers = np.concatenate([ends, NUMBERS[-8:], NUMBERS[::40]]).astype(dtype)
    x, y = (np.resize(array, -(-array.size // LANES) * LANES) for array in np.meshgrid(numbers, numbers))
    for name, expected in {"next_after": np.nextafter(x, y), "remainder": np.fmod(x, y)}.items():
        found = compiled(real, name, dtype, False, in_lanes)(x, y)
        np.testing.assert_array_equal(found, expected)
        known = ~np.isnan(expected)
        np.testing.assert_array_equal(np.signbit(found[known]), np.signbit(expected[known]))


def complex_numbers():
    """Numbers of all sizes, next to branch points, on the unit circle and where exponentials nearly overflow."""
    rng = np.random.default_rng(3)
    turned = lambda n: np.exp(2j * np.pi * rng.random(n))  # noqa: E731
    wide = lambda n, most: rng.choice([-1, 1], n) * 10.0 ** rng.uniform(-most, min(most, 2.6), n)  # noqa: E731
    rows = [rng.normal(size=(150, 2)), np.stack([wide(150, 12), wide(150, 12)], axis=1)]
    rows.append(np.stack([wide(60, 300), wide(60, 300)], axis=1))
    points = [row[:, 0] + 1j * row[:, 1] for row in rows]
    points += [centre + 10.0 ** rng.uniform(-15, 0, 60) * turned(60) for centre in (1, -1, 1j, -1j)]
    return np.concatenate([*points, turned(60), 710 * np.exp(0.1j * rng.random(40))])


@pytest.mark.thorough
@pytest.mark.parametrize("name", FUNCTIONS)
def test_complex_functions(name):
    """Each part to three units of its last place: 2.2 was the most."""
    z = complex_numbers()
    with mpmath.workprec(2300):
        function = getattr(mpmath, FUNCTIONS[name])
        for point, found in zip(z, compiled(complex, name, "c16", False)(z), strict=True):
            exact = function(mpmath.mpc(point))
            for part, of in ((found.real, exact.real), (found.imag, exact.imag)):
                if np.isinf(float(of)):
                    assert part == float(of), point
                    continue
                least = abs(of) if abs(of) > 2.0**-1000 else 2.0**-1000
                assert abs(mpmath.mpf(float(part)) - of) <= 3 * 2.0**-52 * least, point


@pytest.mark.thorough
@pytest.mark.parametrize("name", FUNCTIONS)
def test_complex_numbers_beside_cuts_and_infinite_ones(name):
    """As C's library, to the signs of zeros; of the exponential of −∞ ± ∞ i, C99 leaves these open."""
    parts = np.array([0, 0.5, 1, 2.5, 1e3, 1e-300, 5e-324, 1e308, np.inf])
    x, y = (array.ravel() for array in np.meshgrid(*[np.concatenate([parts, -parts])] * 2))
    if name in ("cosh", "cosine", "exponential", "sine", "sinh", "tan", "tanh"):
        across = x if name in ("cosine", "sine", "tan") else y  # along which they are periodic
        x, y = x[np.isfinite(across)], y[np.isfinite(across)]
    z = np.empty(x.size, np.complex128)
    z.real, z.imag = x, y
    found, expected = (compiled(complex, name, "c16", has_library)(z) for has_library in (False, True))
    for one, other in ((found.real, expected.real), (found.imag, expected.imag)):
        np.testing.assert_allclose(one, other, rtol=1e-15, atol=1e-323)
        known = ~np.isnan(other)
        np.testing.assert_array_equal(np.signbit(one[known]), np.signbit(other[known]))


@pytest.mark.thorough
def test_complex_powers():
    """To the roundings of the exponent w log z."""
    z, w = complex_numbers()[:300], np.roll(complex_numbers()[:300], 7)
    with mpmath.workprec(2300):
        for point, exponent, found in zip(z, w, compiled(complex, "power", "c16", False)(z, w), strict=True):
            power = mpmath.mpc(exponent) * mpmath.log(mpmath.mpc(point))
            if abs(power.real) < 700:
                exact = mpmath.exp(power)
                assert abs(mpmath.mpc(found) - exact) <= (4 + 4 * abs(power)) * 2.0**-52 * abs(exact), (point, exponent)


@pytest.mark.thorough
@pytest.mark.parametrize("name", [*FUNCTIONS, "power"])
def test_complex_functions_are_the_same_in_lanes(name):
    z = np.resize(complex_numbers(), 600)
    arrays = [z, *[np.roll(z, 7)] * (name in OF_TWO)]
    one, other = (compiled(complex, name, "c16", False, in_lanes)(*arrays) for in_lanes in (False, True))
    np.testing.assert_array_equal(one, other)
