"""Turns of a loop computed side by side, in the lanes of vectors: what differs between lanes, and what does not."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jaxball.programs.native.emit.operations import loops
from jaxball.programs.native.ir import turns

from .comparison import agree, native

X = np.linspace(-3.0, 3.0, 37)
TABLE = np.arange(100.0) ** 2


@pytest.fixture(autouse=True)
def _in_lanes(monkeypatch):
    """Each test is of a loop that is computed in lanes."""
    entered = []

    def noted(*arguments):
        found = turns.independent(*arguments)
        entered.append(found is not None)
        return found

    monkeypatch.setattr(loops, "independent", noted)
    monkeypatch.setattr(turns, "LEAST_WORK", 0)  # also where they do not pay
    yield
    assert any(entered)


def mapped(f):
    return lambda x: lax.map(f, x)


def newtons(a):
    """√(|a| + 1), in as many turns as it takes."""
    square = abs(a) + 1

    def closer(carry):
        y, turns = carry
        return y - (y * y - square) / (2 * y), turns + 1

    return lax.while_loop(lambda c: (abs(c[0] ** 2 - square) > 1e-14 * square) & (c[1] < 50), closer, (9.0, 0))


def collatz(a):
    def following(carry):
        n, turns = carry
        return jnp.where(n % 2 == 1, 3 * n + 1, n // 2), turns + 1

    return lax.while_loop(lambda c: c[0] > 1, following, (1 + (a * 7 + 21).astype(int), 0))


def of_different_lengths(a):
    """Each lane fills another part of an array, and leaves the loop at another turn."""

    def turn(carry):
        i, filled = carry
        return i + 1, filled.at[i * 2].set(a * i)

    return lax.while_loop(lambda c: c[0] < 20 + a * 5, turn, (0, jnp.zeros(100)))


def loops_in_loops(a):
    def inner(carry):
        j, s = carry
        return j + 1, s + jnp.where(j % 2 == 1, 1.0, a)

    def outer(carry):
        i, s = carry
        return i + 1, lax.while_loop(lambda c: c[0] < jnp.where(a > 0, i, 0), inner, (0, s))[1]

    return lax.while_loop(lambda c: c[0] < 5 + abs(a), outer, (0, 0.0))


def branches_in_loops(a):
    """Lanes that go another way, and those that have left the loop, keep what they have, in registers and in memory."""

    def less(s, b, i):
        return s - 1.5, b.at[i].set(s)

    def more(s, b, i):
        return lax.while_loop(lambda s: s < 2 * a, lambda s: s + 1, s), b

    def turn(carry):
        i, s, b = carry
        s, b = lax.cond(s > 0, less, more, s, b, i)
        return i + 1, s, b

    return lax.while_loop(lambda c: c[0] < 70, turn, (0, a, jnp.zeros(70)))


def large_branches(a):
    return lax.switch(
        (a * 2).astype(int),
        [lambda a: jnp.ones(80) * a, lambda a: a + jnp.arange(80.0), lambda a: -a * jnp.arange(80.0)],
        a,
    )


def scattered(a):
    places = jnp.arange(5) * 3 + (a * 4).astype(int)
    empty = jnp.zeros((80, 2))
    return empty.at[places].add(a), empty.at[places, 1].set(3.0, mode="drop")


def far_outside(a):
    """An update that is left out in some lanes reads and writes nothing there."""
    kept, full = jnp.zeros(16), jnp.zeros((80, 2))
    far = jnp.where(a > 1, 3, jnp.where(a > 0, 2**31 - 1, -(2**31)))
    return kept.at[far].set(a, mode="drop"), full.at[far].add(a), full.at[far, 1].set(a, mode="drop")


def handed_on(a):
    """Lanes that go another way hand what they are given on twice, and all read it afterwards."""

    def turn(carry):
        i, x, y, count = carry
        z, w, more = lax.cond((i + a).astype(int) % 3 == 0, lambda: (x + a, 2 * x, 3), lambda: (x, x, 0))
        return i + 1, 0.5 * (z[::-1] + x), y.at[i].add(w[i]), count + more

    def loop(n):
        return lax.while_loop(lambda c: c[0] < 6 + a, turn, (0, a * jnp.arange(1.0 * n), jnp.ones(n), 0))[1:]

    return loop(10), loop(60)


def summed(a):
    wave = 1.5 + jnp.sin(a * jnp.arange(90.0))
    return jnp.sum(wave), jnp.argmax(wave), jnp.cumsum(wave), jnp.sort(wave), jnp.max(wave)


CASES = {
    "a polynomial": lambda a: a * a + 1,
    "a vector": lambda a: jnp.array([a, 2 * a, 3.0]),
    "complex numbers": lambda a: jnp.exp(lax.complex(0.0, a)) / lax.complex(2.0, a),
    "integers and booleans": lambda a: ((a * 7).astype(jnp.int32) // 3, (a * 7).astype(jnp.int8) % 4, a > 0),
    "bits": lambda a: (lax.population_count((a * 1e6).astype(jnp.int64)), lax.clz((a * 1e3).astype(jnp.int32))),
    "rounding": lambda a: (jnp.round(a), jnp.floor(a), jnp.sign(a), jnp.nextafter(a, jnp.inf), a.astype(jnp.int32)),
    "single precision": lambda a: (jnp.sin(a.astype(jnp.float32)), lax.bitcast_convert_type(a, jnp.int64)),
    "an index": lambda a: jnp.asarray(TABLE)[(a * 10).astype(int)],
    "a search": lambda a: jnp.searchsorted(jnp.asarray(TABLE), a * 50),
    "a slice": lambda a: lax.dynamic_slice(jnp.asarray(TABLE), ((a * 10).astype(int),), (90,)),
    "a branch": lambda a: lax.cond(a > 0, jnp.sin, lambda a: a * 2, a),
    "large branches": large_branches,
    "another number of turns": newtons,
    "integers of another number of turns": collatz,
    "arrays of another number of turns": of_different_lengths,
    "loops in loops": loops_in_loops,
    "branches in loops": branches_in_loops,
    "scattered": scattered,
    "scattered far outside": far_outside,
    "branches that hand on": handed_on,
    "sums and orders": summed,
    "products of matrices": lambda a: (a * jnp.arange(144.0).reshape(12, 12)) @ jnp.arange(144.0).reshape(12, 12),
    "a loop of as many turns in each lane": lambda a: lax.fori_loop(0, 30, lambda i, s: s * 0.9 + a * i, a),
    "a map in a map": lambda a: lax.map(lambda t: jnp.sin(a * t), jnp.arange(20.0)),
    "what is the same in all": lambda a: (jnp.arange(70.0), jnp.float64(1.0), a),
    "derivatives": jax.grad(lambda a: jnp.sin(a) * jnp.exp(a)),
}


@pytest.mark.thorough
@pytest.mark.parametrize("f", CASES.values(), ids=CASES)
def test_each_lane_has_its_own(f):
    agree(mapped(f), X, ulps=64)


@pytest.mark.parametrize("turns", [16, 17, 23, 24])
def test_the_last_lanes(turns):
    """Where turns do not fill the last vector."""
    agree(mapped(lambda a: jnp.array([a, -a])), X[:turns], ulps=0)


def test_trees_in_and_out():
    agree(lambda x, y: lax.map(lambda c: {"sum": c[0] + c[1]["y"], "sign": c[0] > 0}, (x, {"y": y})), X, X[::-1])


def test_the_jacobian_of_a_map():
    """Whose two terms nearly cancel for some of the numbers."""
    agree(jax.jacfwd(mapped(lambda a: jnp.sin(a) * jnp.exp(a))), X, ulps=16)


@pytest.mark.thorough
def test_functions_that_stay_functions():
    """A long function that is called twice: where all lanes are at it, and where some are."""

    @jax.jit
    def long(x):
        for k in range(220):
            x = x + 0.01 * jnp.sin(x * k)
        return x

    agree(mapped(lambda a: lax.cond(a > 0, lambda: long(a), lambda: long(2 * a + 1)) + long(3.0 * a)), X, ulps=2e3)


def test_a_lane_does_not_depend_on_the_others():
    """To the last bit, wherever it is and whatever the others do."""
    whole = native(mapped(branches_in_loops), X)
    order = np.random.default_rng(1).permutation(X.size)[:20]
    some = native(mapped(branches_in_loops), X[order])
    for one, other in zip(jax.tree.leaves(some), jax.tree.leaves(whole), strict=True):
        np.testing.assert_array_equal(one, other[order])
