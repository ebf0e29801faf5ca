"""`jaxball.jit` and `jaxball.compiler`: what a user calls, and what compiles it."""

import functools
import os
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Disk, DiskState, programs
from jaxball.programs import native
from jaxball.programs.native import choice
from jaxball.programs.native.targets import machine
from jaxball.programs.store import current
from tests.support.scripts import printed_by
from tests.support.sentences import refuses


@pytest.fixture
def compiled_natively(monkeypatch):
    """The names of the programs that are compiled natively, of which none is at hand from other tests."""
    names = []
    original = native.Lowered.compile_natively

    def noted(lowered, *how):
        program = original(lowered, *how)
        names.append((lowered.name, not isinstance(program, native.Refusal)))
        return program

    monkeypatch.setattr(native.Lowered, "compile_natively", noted)
    programs.forget()
    with current.keep_within(None):
        yield names


def test_as_jax_jit(compiled_natively):
    def f(x, *, scale=2.0):
        return {"y": x["a"] * scale, "z": (x["b"], None)}

    x = {"a": np.arange(3.0), "b": jnp.int32(4)}
    found, expected = jaxball.jit(f)(x, scale=3.0), jax.jit(f)(x, scale=3.0)
    assert jax.tree.structure(found) == jax.tree.structure(expected)
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        assert isinstance(one, jax.Array)
        assert one.aval == other.aval
        np.testing.assert_array_equal(one, other)
    assert compiled_natively == [("f", True)]


def test_types_are_those_of_jax():
    """Python's numbers are of no type of their own, and stay so."""
    f = jaxball.jit(lambda x, y: (x, x + y, 1.0))
    for x in (1, 1.5, np.float32(2), jnp.float32(2), np.arange(2)):
        for one, other in zip(f(x, x), jax.jit(lambda x, y: (x, x + y, 1.0))(x, x), strict=True):
            assert one.aval == other.aval
            np.testing.assert_array_equal(one, other)


def test_derivatives_of_integers():
    """They have no numbers, and are arrays of NumPy."""

    def f(x):
        return jax.jvp(lambda x: (x * x, x > 0, jnp.arange(3)), (x,), (1.0,))

    for found, expected in zip(jax.tree.leaves(jaxball.jit(f)(2.0)), jax.tree.leaves(jax.jit(f)(2.0)), strict=True):
        assert found.dtype == expected.dtype or found.dtype == jax.dtypes.float0
        assert found.shape == expected.shape
        assert found.dtype.itemsize == 0 or np.array_equal(found, expected)


def test_one_program_for_equal_types(compiled_natively):
    f = jaxball.jit(lambda x: x + 1)
    f(np.ones(3)), f(np.zeros(3)), f(jnp.zeros(3)), f(jnp.ones(3))
    assert len(compiled_natively) <= 2  # an array of NumPy and one of JAX may be told apart
    f(np.ones(4))
    assert len(compiled_natively) <= 3


def test_within_other_transformations():
    f = jaxball.jit(lambda x: jnp.sum(x**3))
    x = np.arange(4.0)
    np.testing.assert_allclose(jax.grad(f)(x), 3 * x**2)
    np.testing.assert_allclose(jax.vmap(f)(np.ones((2, 3))), [3, 3])
    np.testing.assert_allclose(jax.jit(lambda x: f(2 * x))(x), 8 * f(x))
    np.testing.assert_allclose(jaxball.jit(jax.hessian(f))(x), np.diag(6 * x))


def test_arrays_that_do_not_lie_row_by_row():
    x = np.arange(12.0).reshape(3, 4)
    f = jaxball.jit(lambda x: x * 1)
    for given in (x.T, x[:, ::2], x[::-1], np.asfortranarray(x), np.broadcast_to(x[0], (2, 4))):
        np.testing.assert_array_equal(f(given), given)


def test_what_is_not_known_runs_through_xla(compiled_natively):
    f = jaxball.jit(lambda x: jnp.fft.fft(x))
    np.testing.assert_allclose(f(np.ones(4)), [4, 0, 0, 0])
    assert compiled_natively == [("<lambda>", False)]


def test_and_says_so_where_the_compiler_was_asked_for_by_name():
    with jaxball.compiler("native"), pytest.warns(match=r"stablehlo.fft is not compiled natively: XLA .* `<lambda>`"):
        jaxball.jit(lambda x: jnp.fft.fft(x))(np.ones(4))


def test_xla_by_name(compiled_natively):
    with jaxball.compiler("xla"):
        assert jaxball.jit(lambda x: x + 1)(1) == 2
    assert compiled_natively == []


@pytest.mark.thorough
def test_programs_of_the_library(compiled_natively, monkeypatch):
    """Natively, where that is their default and XLA is not asked for."""
    monkeypatch.setattr(choice, "DEFAULT", "native")
    disk = Disk(mass=1.0, inertia=0.5)
    with jaxball.compiler("xla"):
        expected = jaxball.simulate(disk, [0.0, 1.0], DiskState(phidot=-1.0))
    assert compiled_natively == []
    run = jaxball.simulate(disk, [0.0, 1.0], DiskState(phidot=-1.0))
    assert ("simulate_arrays", True) in compiled_natively
    np.testing.assert_allclose(run.state.z, expected.state.z, rtol=1e-14)
    assert jax.tree.structure(run) == jax.tree.structure(expected)
    for one, other in zip(jax.tree.leaves(run), jax.tree.leaves(expected), strict=True):
        assert jax.typeof(one) == jax.typeof(other)


def _over_many(x):
    def turn(i, x):
        for _ in range(10):
            x = jnp.sin(x) + x
        return x

    return jax.lax.fori_loop(0, 5, turn, x)


def test_loops_over_large_arrays_are_left_to_xla_unless_the_compiler_is_named(compiled_natively, monkeypatch):
    monkeypatch.setattr(choice, "DEFAULT", "native")
    solve = programs.jit(_over_many)
    few, many = np.linspace(0.0, 1.0, 63), np.linspace(0.0, 1.0, 64)
    solve(few), solve(many), jaxball.jit(_over_many)(many)
    with jaxball.compiler("native"):
        np.testing.assert_allclose(solve(many), jax.jit(_over_many)(many), rtol=1e-12)
    assert compiled_natively == [("_over_many", natively) for natively in (True, False, True, True)]
    compiled_natively.clear()
    # What is straight on is compiled natively, however large.
    programs.filter_jit(functools.partial(_scaled, 3.0))(jnp.ones(1000))
    assert compiled_natively == [("_scaled", True)]


def _scaled(factor, x):
    return {"x": x * factor, "name": "scaled"}


def test_arguments_that_are_no_arrays():
    f = programs.filter_jit(functools.partial(_scaled, 3.0))
    with jaxball.compiler("native"):
        assert f(np.ones(2))["name"] == "scaled"
        np.testing.assert_array_equal(f(np.ones(2))["x"], [3, 3])


@pytest.mark.thorough
def test_by_an_environment_variable():
    text = """if True:
        import jax.numpy as jnp
        from jaxball import programs
        from jaxball.programs.native import Lowered
        made, original = [], Lowered.compile_natively
        Lowered.compile_natively = lambda self, *how: made.append(self) or original(self, *how)
        programs.jit(jnp.sin)(0.5)
        print(len(made))
    """
    for name, expected in (("native", True), ("", True), ("xla", False)):
        assert (int(printed_by("-c", text, env={**os.environ, "JAXBALL_COMPILER": name})) > 0) == expected, name


def test_a_compiler_that_is_none(monkeypatch):
    with refuses(ValueError, "name"):  # noqa: SIM117
        with jaxball.compiler("gcc"):
            pass
    monkeypatch.setenv("JAXBALL_COMPILER", "gcc")
    with refuses(ValueError, "JAXBALL_COMPILER"):
        jaxball.jit(lambda x: x)(1)


def test_without_llvmlite(monkeypatch):
    monkeypatch.setitem(sys.modules, "llvmlite", None)
    machine.is_present.cache_clear()
    try:
        assert jaxball.jit(lambda x: x + 1)(1) == 2
    finally:
        machine.is_present.cache_clear()


def test_random_keys(compiled_natively):
    """As arguments and as results, of each kind that makes its numbers of threefry's."""
    key = jax.random.key(0)
    f = lambda key: (jax.random.split(key), jax.random.normal(key, (3,)), {"old": key})  # noqa: E731
    found, expected = jaxball.jit(f)(key), jax.jit(f)(key)
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        assert one.dtype == other.dtype
        if one.dtype == key.dtype:
            one, other = jax.random.key_data(one), jax.random.key_data(other)
        np.testing.assert_allclose(one, other, rtol=1e-14)
    assert jaxball.jit(lambda: jax.random.key(3))().dtype == key.dtype
    assert [native for _, native in compiled_natively] == [True, True]
