"""Elementary functions: against mpmath over all of their arguments, and where they have exceptions."""

import ctypes
import functools
import math

import mpmath
import numpy as np
import pytest

from jaxball.native.machine import Code, object_code
from jaxball.native.operations import elementary

LANES = [1, 8]


@functools.cache
def compiled(name, lanes):
    """The function of arrays whose lengths are multiples of the lanes."""
    w = elementary.Writer(lanes)
    kind = w.type("double")
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


def ulps(found, name, *arrays):
    """The largest error, in units of the last place of the exact result, and where it is."""
    function = {"pow": mpmath.power}.get(name) or getattr(mpmath, name)
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


RNG = np.random.default_rng(8)
WIDE = signed(10.0 ** RNG.uniform(-320, 308, 400))
NEAR = np.concatenate([signed(2.0 ** RNG.uniform(-30, 9.5, 1200)), RNG.uniform(-3, 3, 600)])
# Next to multiples of π/2, where nothing is left of the argument but its last bits; the last is the hardest one.
ANGLES = np.concatenate(
    [
        NEAR,
        WIDE,
        np.round(2.0 ** RNG.uniform(0, 29, 600)) * (np.pi / 2),
        [6381956970095103.0 * 2.0**-7, 2.0**30, 2.0**31],
    ]
)
POSITIVE = np.concatenate(
    [np.abs(NEAR), np.abs(WIDE), 1 + RNG.uniform(-0.1, 0.1, 300), 1 + signed(2.0 ** RNG.uniform(-52, -3, 200))]
)
ARGUMENTS = {
    "sin": (ANGLES,),
    "cos": (ANGLES,),
    "exp": (np.concatenate([NEAR, RNG.uniform(-745, 709.7, 1000)]),),
    "expm1": (np.concatenate([NEAR, WIDE, RNG.uniform(-50, 709.7, 500)]),),
    "log": (POSITIVE,),
    "log1p": (np.concatenate([POSITIVE, -(np.minimum(POSITIVE, 0.999) ** 2)]),),
    "tanh": (np.concatenate([NEAR, WIDE]),),
    "pow": (
        np.concatenate([POSITIVE, POSITIVE]),
        np.concatenate(
            [
                RNG.uniform(-3, 3, POSITIVE.size),
                700 / np.maximum(np.abs(np.log(POSITIVE)), 1e-17) * RNG.uniform(-1, 1, POSITIVE.size),
            ]
        ),
    ),
    "atan2": (
        np.concatenate([NEAR, WIDE, RNG.normal(size=1500)]),
        np.concatenate([RNG.permutation(NEAR), RNG.permutation(WIDE), RNG.normal(size=1500)]),
    ),
}
# Units of the last place. Measured: sin 0.73, cos 0.67, exp and log1p 0.72, expm1 0.76, log 0.71, pow 0.82, atan2 0.56;
# tanh is a quotient of two that are rounded, 1.67, as C's is.
MOST = dict.fromkeys(ARGUMENTS, 0.9) | {"tanh": 2.0}
SPECIAL = signed(
    np.array(
        [0, 5e-324, 2.0**-1022, 1e-300, 0.5, 1, 1.5, 2, 3, 2.0**53, 1e18, 1e300, np.finfo(float).max, np.inf, np.nan]
    )
)


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
    expected = {"pow": np.power, "atan2": np.arctan2}.get(name, getattr(np, name, None))(*arrays)
    np.testing.assert_allclose(found, expected, rtol=4e-16, atol=5e-324)
    known = ~np.isnan(expected)
    np.testing.assert_array_equal(np.signbit(found[known]), np.signbit(expected[known]))


@pytest.mark.parametrize("name", elementary.FUNCTIONS)
def test_vectors_and_numbers_agree_to_the_last_bit(name):
    rng = np.random.default_rng(9)
    arrays = [signed(10.0 ** rng.uniform(-5, 10, 2000)) for _ in range(elementary.FUNCTIONS[name][1])]
    for one, other in zip(compiled(name, 1)(*arrays), compiled(name, 8)(*arrays), strict=True):
        np.testing.assert_array_equal(one, other)
