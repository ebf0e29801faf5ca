"""Elementary functions: against mpmath over all of their arguments, and where they have exceptions."""

import ctypes
import functools
import math

import mpmath
import numpy as np
import pytest

from jaxball.programs.native.emit.scalars import elementary
from jaxball.programs.native.emit.scalars.elementary import trigonometric
from jaxball.programs.native.targets.machine import Code, object_code

LANES = [1, 8]


@functools.cache
def compiled(name, lanes):
    """The function of arrays whose lengths are multiples of the lanes."""
    kind = "double" if lanes == 1 else f"<{lanes} x double>"
    count = elementary.FUNCTIONS[name][1]
    loads = [f"%x{k} = load {kind}, ptr %p{k}, align 8" for k in range(count)]
    steps = [
        f"%a{k} = getelementptr double, ptr %in{k}, i64 %i\n%p{k} = bitcast ptr %a{k} to ptr" for k in range(count)
    ]
    given = ", ".join(f"{kind} %x{k}" for k in range(count))
    returned = f"{{ {kind}, {kind} }}" if name == "sincos" else kind
    stores = [f"%y = call {returned} {elementary.name_of(name, lanes)}({given})"]
    outputs = 2 if name == "sincos" else 1
    for k in range(outputs):
        stores.append(f"%o{k} = getelementptr double, ptr %out{k}, i64 %i")
        value = f"%r{k}" if outputs == 2 else "%y"
        if outputs == 2:
            stores.append(f"%r{k} = extractvalue {returned} %y, {k}")
        stores.append(f"store {kind} {value}, ptr %o{k}, align 8")
    pointers = [f"ptr %in{k}" for k in range(count)] + [f"ptr %out{k}" for k in range(outputs)]
    lines = [
        *elementary.declarations(name, lanes).values(),
        elementary.definition(name, lanes),
        f"define void @run({', '.join(pointers)}, i64 %n) {{",
        "entry:\nbr label %loop\nloop:\n%i = phi i64 [ 0, %entry ], [ %next, %loop ]",
        *steps,
        *loads,
        *stores,
        f"%next = add i64 %i, {lanes}\n%more = icmp slt i64 %next, %n\nbr i1 %more, label %loop, label %end",
        "end:\nret void\n}",
    ]
    code = Code(object_code("\n".join(lines) + "\n"))
    run = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * (count + outputs), ctypes.c_int64)(code.address("run"))

    def function(*arrays):
        arrays = [np.ascontiguousarray(np.resize(x, -(-x.size // lanes) * lanes), float) for x in arrays]
        results = [np.empty_like(arrays[0]) for _ in range(outputs)]
        run(*(x.ctypes.data for x in (*arrays, *results)), arrays[0].size)
        return results

    function.code = code
    return function


def computed(name, lanes, *arrays):
    """sin and cos are one function."""
    of = "sincos" if name in ("sin", "cos") else name
    results = compiled(of, lanes)(*map(np.asarray, arrays))
    return results[1 if name == "cos" else 0][: len(arrays[0])]


EXACT = {
    "pow": mpmath.power,
    "cbrt": lambda x: mpmath.sign(x) * mpmath.cbrt(abs(x)),
    "erfc": lambda x: mpmath.erfc(x) if abs(x) < 50 else 1 - mpmath.sign(x),  # which mpmath has no more numbers for
    "log_hypot": lambda x, y: mpmath.log(x * x + y * y) / 2,
}


def ulps(found, name, *arrays):
    """The largest error, in units of the last place of the exact result, and where it is."""
    function = EXACT.get(name) or getattr(mpmath, name)
    worst, where = 0.0, None
    with mpmath.workprec(200):
        for y, *xs in zip(found, *arrays, strict=True):
            exact = function(*map(mpmath.mpf, map(float, xs)))
            unit = math.ulp(float(exact)) if math.isfinite(float(exact)) else None
            if unit is None or not math.isfinite(y):
                assert float(exact) == y, (name, xs)
                continue
            error = abs(float((mpmath.mpf(float(y)) - exact) / unit))
            if error > worst:
                worst, where = error, xs
    return worst, where


def signed(numbers):
    return np.concatenate([numbers, -numbers])


def beside(*numbers):
    """The numbers, and those next to them, of both signs."""
    numbers = np.array(numbers)
    return signed(np.concatenate([numbers, np.nextafter(numbers, 0), np.nextafter(numbers, np.inf)]))


RNG = np.random.default_rng(8)
WIDE = signed(10.0 ** RNG.uniform(-323, 308, 400))
NEAR = np.concatenate([signed(2.0 ** RNG.uniform(-30, 9.5, 1200)), RNG.uniform(-3, 3, 600)])
HUGE = signed(2.0 ** RNG.uniform(29, 1024, 500))
# Next to multiples of π/2, where nothing is left of the argument but its last bits; the last two are the hardest ones.
ANGLES = np.concatenate(
    [
        NEAR,
        WIDE,
        HUGE,
        np.round(2.0 ** RNG.uniform(0, 52, 900)) * (np.pi / 2),
        beside(2.0**30, 2.0**31, np.finfo(float).max / 2),
        [6381956970095103.0 * 2.0**-7, 6381956970095103.0 * 2.0**797],
    ]
)
POSITIVE = np.concatenate(
    [np.abs(NEAR), np.abs(WIDE), 1 + RNG.uniform(-0.1, 0.1, 300), 1 + signed(2.0 ** RNG.uniform(-52, -3, 200))]
)
UNIT = np.concatenate(
    [
        signed(1 - 2.0 ** RNG.uniform(-53, -1, 500)),
        RNG.uniform(-1, 1, 1000),
        signed(10.0 ** RNG.uniform(-323, 0, 300)),
        beside(2.0**-28, 0.5),
    ]
)
ERRORS = np.concatenate([NEAR, WIDE, RNG.uniform(-7, 27.3, 2000), beside(0.25, 0.84375, 1.25, 1 / 0.35, 6.0, 26.5)])
HYPERBOLIC = np.concatenate([NEAR, WIDE, RNG.uniform(-711, 711, 600), beside(1.0, 22.0, 300.0, 709.78, 710.4)])
POINTS = (
    np.concatenate([NEAR, WIDE, RNG.normal(size=1500)]),
    np.concatenate([RNG.permutation(NEAR), RNG.permutation(WIDE), RNG.normal(size=1500)]),
)
# Next to the unit circle, where the logarithm of the length is nearly 0.
_SIZES, _TURNS = 1 + signed(10.0 ** RNG.uniform(-17, -0.1, 500)), RNG.uniform(-4, 4, 1000)
ARGUMENTS = {
    "sin": (ANGLES,),
    "cos": (ANGLES,),
    "tan": (ANGLES,),
    "asin": (UNIT,),
    "acos": (UNIT,),
    "atan": (np.concatenate([NEAR, WIDE, beside(math.sqrt(2) - 1, 1.0)]),),
    "exp": (np.concatenate([NEAR, RNG.uniform(-745, 709.7, 1000)]),),
    "expm1": (np.concatenate([NEAR, WIDE, RNG.uniform(-50, 709.7, 500)]),),
    "log": (POSITIVE,),
    "log1p": (np.concatenate([POSITIVE, -(np.minimum(POSITIVE, 0.999) ** 2)]),),
    "sinh": (HYPERBOLIC,),
    "cosh": (HYPERBOLIC,),
    "tanh": (np.concatenate([NEAR, WIDE]),),
    "asinh": (np.concatenate([NEAR, WIDE, beside(2.0**-28, 2.0**28)]),),
    "acosh": (np.concatenate([1 + 2.0 ** RNG.uniform(-52, 10, 1000), 10.0 ** RNG.uniform(0, 308, 400), [2.0**28]]),),
    "atanh": (UNIT,),
    "cbrt": (np.concatenate([NEAR, WIDE, beside(math.sqrt(0.5), 1.0, math.sqrt(2))]),),
    "erf": (ERRORS,),
    "erfc": (ERRORS,),
    "pow": (
        np.concatenate([POSITIVE, POSITIVE]),
        np.concatenate(
            [
                RNG.uniform(-3, 3, POSITIVE.size),
                700 / np.maximum(np.abs(np.log(POSITIVE)), 1e-17) * RNG.uniform(-1, 1, POSITIVE.size),
            ]
        ),
    ),
    "atan2": POINTS,
    "hypot": POINTS,
    "log_hypot": tuple(
        np.concatenate([part, _SIZES * turned])
        for part, turned in zip(POINTS, (np.cos(_TURNS), np.sin(_TURNS)), strict=True)
    ),
}
# Units of the last place. Measured: acos 0.58, acosh 0.67, asin 0.57, asinh 0.70, atan 0.51, atan2 0.56, atanh 0.74,
# cbrt and hypot 0.51, cos 0.71, cosh 0.59, erf 0.77, exp and log1p 0.72, expm1 0.76, log 0.71, pow 0.82,
# sin 0.73, sinh 0.58, tan 0.83; erfc, a quotient of an exponential, 1.42; tanh, a quotient of two that are rounded,
# 1.67, as C's is; log_hypot 0.99, where next to nothing is left of x² + y² − 1.
MOST = dict.fromkeys(ARGUMENTS, 0.9) | {"erfc": 1.6, "log_hypot": 1.2, "tanh": 2.0}
SPECIAL = signed(
    np.array(
        [0, 5e-324, 2.0**-1022, 1e-300, 0.5, 1, 1.5, 2, 3, 2.0**53, 1e18, 1e300, np.finfo(float).max, np.inf, np.nan]
    )
)


# By other names.
OF_C = {
    "pow": np.power,
    "acos": np.arccos,
    "acosh": np.arccosh,
    "asin": np.arcsin,
    "asinh": np.arcsinh,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "atanh": np.arctanh,
    "erf": np.vectorize(math.erf),
    "erfc": np.vectorize(math.erfc),
    "log_hypot": np.vectorize(
        lambda x, y: (
            np.log(np.hypot(x, y))
            if x == y == 0 or not np.isfinite(x - x + y - y)
            else float(EXACT["log_hypot"](mpmath.mpf(x), mpmath.mpf(y)))
        )
    ),
}


@pytest.mark.thorough
@pytest.mark.parametrize("lanes", LANES)
@pytest.mark.parametrize("name", ARGUMENTS)
def test_accuracy(name, lanes):
    arrays = ARGUMENTS[name]
    worst, where = ulps(computed(name, lanes, *arrays), name, *arrays)
    assert worst < MOST[name], where


@pytest.mark.parametrize("lanes", LANES)
@pytest.mark.parametrize("name", ARGUMENTS)
@np.errstate(all="ignore")
def test_exceptions(name, lanes):
    """As C's library, to the signs of zeros."""
    arrays = [array.ravel() for array in np.meshgrid(SPECIAL, SPECIAL)][: len(ARGUMENTS[name])]
    found = computed(name, lanes, *arrays)
    expected = (OF_C.get(name) or getattr(np, name))(*arrays)
    np.testing.assert_allclose(found, expected, rtol=4e-16, atol=5e-324)
    known = ~np.isnan(expected)
    np.testing.assert_array_equal(np.signbit(found[known]), np.signbit(expected[known]))


@pytest.mark.parametrize("name", elementary.FUNCTIONS)
def test_vectors_and_numbers_agree_to_the_last_bit(name):
    rng = np.random.default_rng(9)
    numbers = np.concatenate([signed(10.0 ** rng.uniform(-5, 10, 2000)), rng.uniform(-1, 1, 1000), WIDE, SPECIAL])
    numbers = np.resize(numbers, -(-numbers.size // 8) * 8)
    arrays = [numbers, *(rng.permutation(numbers) for _ in range(elementary.FUNCTIONS[name][1] - 1))]
    for one, other in zip(compiled(name, 1)(*arrays), compiled(name, 8)(*arrays), strict=True):
        np.testing.assert_array_equal(one, other)
        known = ~np.isnan(one)
        np.testing.assert_array_equal(np.signbit(one[known]), np.signbit(other[known]))


@pytest.mark.parametrize("lanes", LANES)
@np.errstate(invalid="ignore")
def test_remainders_are_exact(lanes):
    """Of any numbers, of nearly whole quotients, of the least number, and as C has it of special ones."""
    rng = np.random.default_rng(10)
    x, y = (rng.permutation(signed(10.0 ** rng.uniform(-323.5, 308.2, 3000))) for _ in range(2))
    y[:2000] = x[:2000] / rng.integers(1, 1000, 2000) * (1 + rng.integers(-2, 3, 2000) * 2.0**-52)
    y[2000:2500] = 5e-324
    special = [array.ravel() for array in np.meshgrid(SPECIAL, SPECIAL)]
    x, y = (np.concatenate(arrays) for arrays in zip((x, y), special, strict=True))
    found, expected = computed("fmod", lanes, x, y), np.fmod(x, y)
    np.testing.assert_array_equal(found, expected)
    known = ~np.isnan(expected)
    np.testing.assert_array_equal(np.signbit(found[known]), np.signbit(expected[known]))


def test_bits_of_two_by_pi():
    with mpmath.workprec(1400):
        exact = int(mpmath.floor(2 / mpmath.pi * mpmath.mpf(2) ** (4 * len(trigonometric.BITS))))
    assert int(trigonometric.BITS, 16) == exact
