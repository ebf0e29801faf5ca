"""A computation as one operation of JAX: every transformation gives what it gives of the same function of JAX's own."""

import _thread
import os
import textwrap
import threading
import warnings
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import programs
from jaxball.programs.computation import ROWS_OF_BLOCK
from jaxball.programs.operation import in_threads
from tests.support.precision import enable_x64
from tests.support.scripts import printed_by


def plain(x, y, count):
    """Numbers of every kind, with a loop of unknown length and one that is differentiated in both modes."""
    grown = jax.lax.fori_loop(0, 3, lambda _, z: jnp.sin(z) * y + z, x)
    halvings = jax.lax.while_loop(lambda z: z > 0.1, lambda z: z / 2, jnp.sum(jax.lax.stop_gradient(x) ** 2))
    return {"grown": grown, "sum": jnp.sum(grown * y), "next": count + 1, "large": jnp.sum(x) > 1.0, "last": halvings}


operated = programs.jit(plain)
X, Y, COUNT = jnp.array([0.3, -1.2, 2.0]), jnp.asarray(0.7), jnp.asarray(4)


def same(found, wanted, rtol=1e-12):
    assert jax.tree.structure(found) == jax.tree.structure(wanted)
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(wanted), strict=True):
        assert one.shape == other.shape
        assert one.dtype == other.dtype
        if one.dtype != jax.dtypes.float0:
            np.testing.assert_allclose(one, other, rtol=rtol, atol=1e-13)


def is_one_operation(f, *args):
    return "run" in [equation.primitive.name for equation in jax.make_jaxpr(f)(*args).jaxpr.eqns]


def numbers(f):
    """Of the results of ``f`` those that have derivatives."""
    return lambda x, y: (lambda results: (results["grown"], results["sum"]))(f(x, y, COUNT))


TRANSFORMED = {
    "grad": lambda f: jax.grad(lambda x, y: numbers(f)(x, y)[1], argnums=(0, 1))(X, Y),
    "jacfwd": lambda f: jax.jit(jax.jacfwd(numbers(f), argnums=(0, 1)))(X, Y),
    "jacrev": lambda f: jax.jit(jax.jacrev(numbers(f), argnums=(0, 1)))(X, Y),
    "hessian": lambda f: jax.jit(jax.hessian(lambda x: numbers(f)(x, Y)[1]))(X),
    "reverse over forward": lambda f: jax.jit(jax.jacrev(jax.jacfwd(lambda x: numbers(f)(x, Y)[1])))(X),
    "forward over forward": lambda f: jax.jit(jax.jacfwd(jax.jacfwd(lambda x: numbers(f)(x, Y)[1])))(X),
    "third": lambda f: jax.jit(jax.grad(jax.grad(jax.grad(lambda y: numbers(f)(X, y)[1]))))(Y),
    "linearize": lambda f: jax.linearize(lambda x: numbers(f)(x, Y), X)[1](X),
    "integers": lambda f: jax.jvp(f, (X, Y, COUNT), (X, Y, np.zeros((), jax.dtypes.float0))),
    "checkpoint": lambda f: jax.jit(jax.grad(lambda x: numbers(jax.checkpoint(f))(x, Y)[1]))(X),
    "scan": lambda f: jax.jit(lambda x: jax.lax.scan(lambda x, _: (numbers(f)(x, Y)[0] / 9, x), x, None, length=4))(X),
    "grad of scan": lambda f: jax.jit(
        jax.grad(lambda x: jnp.sum(jax.lax.scan(lambda x, _: (numbers(f)(x, Y)[0] / 9, x), x, None, length=4)[0]))
    )(X),
    "while": lambda f: jax.jit(
        lambda x: jax.lax.while_loop(lambda x: x[0] < 9.0, lambda x: 1.5 * f(x, Y, COUNT)["grown"] + 1.0, x)
    )(X),
    "cond": lambda f: jax.jit(lambda x: jax.lax.cond(x[0] > 0, lambda x: f(x, Y, COUNT)["sum"], jnp.sum, x))(X),
    "map": lambda f: jax.jit(lambda x: jax.lax.map(lambda y: f(x, y, COUNT), jnp.stack([Y, 2 * Y])))(X),
    "custom root": lambda f: jax.jit(jax.grad(lambda y: root(f, y)))(Y),
}


def root(f, y):
    """x with 3 x + 0.1 sum(x e1, y) = 1."""

    def residual(x):
        return 3 * x + 0.1 * f(x * jnp.array([1.0, 0.0, 0.0]), y, COUNT)["sum"] - 1

    def newton(g, x):
        return jax.lax.fori_loop(0, 8, lambda _, x: x - g(x) / jax.grad(g)(x), x)

    return jax.lax.custom_root(residual, jnp.asarray(0.1), newton, lambda g, b: b / g(jnp.ones_like(b)))


@pytest.mark.thorough
@pytest.mark.parametrize("name", TRANSFORMED)
def test_transformations(name):
    same(TRANSFORMED[name](operated), TRANSFORMED[name](plain))


XS, YS = jnp.linspace(-1.0, 2.0, 3 * 37).reshape(37, 3), jnp.linspace(0.2, 0.9, 37)
MAPPED = {
    "all": lambda f: jax.vmap(f)(XS, YS, jnp.arange(37)),
    "some": lambda f: jax.jit(jax.vmap(f, in_axes=(None, 0, None)))(X, YS, COUNT),
    "another axis": lambda f: jax.jit(jax.vmap(f, in_axes=(1, None, None)))(XS.T, Y, COUNT),
    "one row": lambda f: jax.jit(jax.vmap(f, in_axes=(0, None, None)))(XS[:1], Y, COUNT),
    "no rows, as typed": lambda f: jax.vmap(f, in_axes=(0, None, None))(XS[:0], Y, COUNT),
    "blocks": lambda f: jax.jit(jax.vmap(f, in_axes=(0, None, None)))(XS[: 2 * ROWS_OF_BLOCK], Y, COUNT),
    "of maps": lambda f: jax.jit(jax.vmap(jax.vmap(f, in_axes=(None, 0, None)), in_axes=(0, None, None)))(
        XS, YS, COUNT
    ),
    "of jacobians": lambda f: jax.jit(jax.vmap(jax.jacfwd(numbers(f), argnums=(0, 1))))(XS, YS),
    "of hessians": lambda f: jax.jit(jax.vmap(jax.hessian(lambda x, y: numbers(f)(x, y)[1])))(XS, YS),
    "many directions": lambda f: jax.jit(jax.vmap(lambda v: jax.jvp(lambda x: numbers(f)(x, Y)[0], (X,), (v,))[1]))(XS),
    "within a gradient": lambda f: jax.jit(
        jax.grad(lambda x, ys: jnp.sum(jax.vmap(f, in_axes=(None, 0, None))(x, ys, COUNT)["sum"]), argnums=(0, 1))
    )(X, YS),
    "within a jacobian": lambda f: jax.jit(jax.jacfwd(lambda y: jax.vmap(f, (0, None, None))(XS, y, COUNT)["sum"]))(Y),
    "of a pull": lambda f: jax.vmap(jax.vjp(lambda x: numbers(f)(x, Y)[0], X)[1])(XS),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", MAPPED)
def test_maps(name):
    same(MAPPED[name](operated), MAPPED[name](plain), rtol=1e-11)


def test_it_is_one_operation_and_native():
    assert is_one_operation(operated, X, Y, COUNT)
    assert "jaxball_" in jax.jit(operated).lower(X, Y, COUNT).as_text()
    assert "jaxball_" in jax.jit(jax.vmap(operated)).lower(XS, YS, jnp.arange(37)).as_text()


def test_rows_do_not_depend_on_the_others_nor_on_how_often_they_are_computed():
    mapped = jax.jit(jax.vmap(operated, in_axes=(0, None, None)))
    whole = mapped(XS, Y, COUNT)
    for part in (slice(0, 2), slice(3, 20), slice(30, 37)):
        for one, other in zip(jax.tree.leaves(mapped(XS[part], Y, COUNT)), jax.tree.leaves(whole), strict=True):
            np.testing.assert_array_equal(one, other[part])
    for _ in range(20):
        for one, other in zip(jax.tree.leaves(mapped(XS, Y, COUNT)), jax.tree.leaves(whole), strict=True):
            np.testing.assert_array_equal(one, other)


def test_numbers_below_the_smallest_normal_one_are_kept():
    """XLA's threads take them for 0."""
    half = programs.jit(lambda x: x / 2)
    smallest = jnp.finfo(X.dtype).tiny
    assert np.asarray(half(smallest)) > 0
    assert np.asarray(jax.jit(half)(smallest)) > 0
    assert np.all(np.asarray(jax.jit(jax.vmap(half))(jnp.full(100, smallest))) > 0)


@pytest.mark.thorough
def test_ctrl_c_ends_rows_as_typed():
    """Of which each would take minutes."""
    endless = programs.jit(lambda x: jax.lax.fori_loop(0, 10**10, lambda _, x: jnp.sin(x), x))
    begun = threading.Timer(2.0, _thread.interrupt_main)
    jax.vmap(programs.jit(lambda x: jnp.sin(x)))(YS)  # whatever is compiled once
    begun.start()
    with pytest.raises(KeyboardInterrupt):
        jax.vmap(endless)(YS)


def test_any_number_of_threads_gives_the_same():
    wanted = jax.tree.map(np.asarray, MAPPED["all"](operated))
    for threads in (1, 2, 5):
        with in_threads(threads):
            jax.tree.map(np.testing.assert_array_equal, MAPPED["all"](operated), wanted)
    jax.tree.map(np.testing.assert_array_equal, jax.jit(jax.vmap(operated))(XS, YS, jnp.arange(37)), wanted)


def test_random_keys():
    draw = programs.jit(lambda key, scale: (jax.random.split(key), scale * jax.random.normal(key)))
    key = jax.random.key(3)
    for around in (
        lambda f: f,
        jax.jit,
        lambda f: lambda *args: jax.jit(jax.vmap(f, (0, None)))(args[0][None], args[1]),
    ):
        keys, number = around(draw)(key, 2.0)
        np.testing.assert_array_equal(
            jax.random.key_data(keys).ravel(), jax.random.key_data(jax.random.split(key)).ravel()
        )
        np.testing.assert_allclose(jnp.ravel(number)[0], 2.0 * jax.random.normal(key), rtol=1e-14)


def test_without_arrays_and_with_empty_ones():
    nothing = programs.jit(lambda x: (jnp.sum(x), x))
    total, same_array = jax.jit(nothing)(jnp.zeros((0, 3)))
    assert (float(total), same_array.shape) == (0.0, (0, 3))


def test_weak_types_stay_weak():
    counted = programs.jit(lambda x: (x, 3, 2.0))
    for mapped in (jax.vmap(counted), jax.jit(jax.vmap(counted))):
        assert [one.weak_type for one in mapped(YS)] == [False, True, True]


def test_static_parts_are_part_of_the_result():
    described = programs.filter_jit(lambda x, name: (name, 2 * x, None))
    inner = []

    @jax.jit
    def outer(x):
        name, doubled, none = described(x, "name")
        inner.append((name, none))
        return doubled

    assert float(outer(Y)) == pytest.approx(1.4)
    assert inner == [("name", None)]


def test_a_callback_and_an_effect_are_written_out():
    seen = []
    called = programs.jit(
        lambda x: jax.pure_callback(lambda x: 2 * np.asarray(x), jax.ShapeDtypeStruct((), X.dtype), x)
    )
    assert float(jax.jit(called)(Y)) == pytest.approx(1.4)
    noted = programs.jit(lambda x: (jax.debug.callback(lambda x: seen.append(float(x)), x), 2 * x)[1])
    jax.block_until_ready(jax.jit(noted)(Y))
    jax.effects_barrier()
    assert seen == [pytest.approx(0.7)]


def test_a_callback_in_a_branch_is_reached():
    def doubled(x):
        result = jax.ShapeDtypeStruct((), X.dtype)
        return jax.lax.cond(x > 0, lambda x: jax.pure_callback(lambda x: 2 * np.asarray(x), result, x), lambda x: x, x)

    assert float(jax.jit(programs.jit(doubled))(Y)) == pytest.approx(1.4)
    assert float(jax.jit(programs.jit(doubled))(-Y)) == pytest.approx(-0.7)


def test_what_is_traced_around_it_is_seen():
    def captured(y):
        return programs.jit(lambda x: jnp.sum(x) * y**2)(X * y)

    np.testing.assert_allclose(jax.grad(captured)(Y), 3 * jnp.sum(X) * Y**2, rtol=1e-12)
    np.testing.assert_allclose(jax.jit(jax.jacfwd(captured))(Y), 3 * jnp.sum(X) * Y**2, rtol=1e-12)


CAPTURED = {
    "map": lambda f: jax.vmap(f, in_axes=(0, None))(YS, COUNT),
    "compiled map": lambda f: jax.jit(jax.vmap(f))(YS, jnp.arange(37)),
    "map of integers": lambda f: jax.vmap(f, in_axes=(None, 0))(Y, jnp.arange(37)),
    "gradient": lambda f: jax.grad(f)(Y, COUNT),
    "compiled second derivative": lambda f: jax.jit(jax.hessian(f))(Y, COUNT),
    "reverse over reverse": lambda f: jax.grad(jax.grad(f))(Y, COUNT),
    "map of derivatives": lambda f: jax.jit(jax.vmap(jax.jacfwd(f), in_axes=(0, None)))(YS, COUNT),
    "derivatives of a map": lambda f: jax.jit(jax.jacrev(jax.vmap(f, in_axes=(0, None))))(YS[:3], COUNT),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", CAPTURED)
def test_what_is_traced_around_a_function_is_an_argument_of_it(name):
    def around(inner):
        return lambda y, n: inner(
            lambda x: jnp.sum(plain(x, y, n)["grown"]) + (jnp.sum(x) + jnp.asarray(n, x.dtype)) * y**2
        )(X)

    np.testing.assert_allclose(CAPTURED[name](around(programs.jit)), CAPTURED[name](around(lambda f: f)), rtol=1e-12)


def test_what_has_captured_something_is_compiled_natively():
    text = jax.jit(lambda y: programs.jit(lambda x: jnp.sum(x) * y**2)(X)).lower(Y).as_text()
    assert text.count("jaxball_") == 1


def test_for_debugging_it_is_written_out():
    with jax.disable_jit():
        same(jax.grad(lambda y: numbers(operated)(X, y)[1])(Y), jax.grad(lambda y: numbers(plain)(X, y)[1])(Y))
    with jax.debug_nans(True):
        assert not is_one_operation(programs.jit(plain), X, Y, COUNT)
        with pytest.raises(FloatingPointError):
            jax.jit(programs.jit(lambda x: jnp.log(-x)))(Y)


def test_an_exported_function_runs_anywhere():
    exported = jax.export.export(jax.jit(jax.vmap(operated)))(XS, YS, jnp.arange(37))
    assert "jaxball_" not in exported.mlir_module()
    same(exported.call(XS, YS, jnp.arange(37)), MAPPED["all"](plain))


def test_xla_may_be_chosen():
    with jaxball.compiler("xla"):
        fresh = programs.jit(plain)
        assert "jaxball_" not in jax.jit(fresh).lower(X, Y, COUNT).as_text()
        same(jax.jit(jax.vmap(jax.grad(lambda x, y: numbers(fresh)(x, y)[1])))(XS, YS), _gradients())


def _gradients():
    return jax.vmap(jax.grad(lambda x, y: numbers(plain)(x, y)[1]))(XS, YS)


def test_in_32_bits():
    with enable_x64(False):
        x, y = jnp.asarray(X, jnp.float32), jnp.asarray(Y, jnp.float32)
        found = jax.jit(jax.vmap(operated, in_axes=(0, None, None)))(jnp.stack([x] * 5), y, jnp.asarray(4, jnp.int32))
        assert found["grown"].dtype == jnp.float32
        np.testing.assert_allclose(found["grown"][4], plain(x, y, 4)["grown"], rtol=1e-6)


def test_within_a_users_program_it_is_part_of_that():
    def total(x):
        return jnp.sum(jax.vmap(operated, in_axes=(0, None, None))(x, Y, COUNT)["sum"])

    wanted = jax.grad(lambda x: jnp.sum(jax.vmap(plain, in_axes=(0, None, None))(x, Y, COUNT)["sum"]))(XS)
    np.testing.assert_allclose(jaxball.jit(jax.grad(total))(XS), wanted, rtol=1e-12)


@pytest.mark.parametrize("steered", [False, True])
def test_within_another_program_only_what_is_steered_is_an_operation(steered):
    """So that the steps of its derivatives are those of the same call elsewhere."""
    inner, seen = programs.jit(plain, steered=steered), []

    def around(x):
        seen.append(is_one_operation(inner, x, Y, COUNT))
        return inner(x, Y, COUNT)["sum"]

    wanted = jax.grad(lambda x: plain(x, Y, COUNT)["sum"])(X)
    np.testing.assert_allclose(programs.jit(jax.grad(around))(X), wanted, rtol=1e-12)
    assert set(seen) == {steered}


def in_new_process(code, *flags, **environment):
    return printed_by("-c", textwrap.dedent(code), *flags, env={**os.environ, **environment})


KEPT = """
import sys, jax, jax.numpy as jnp
jax.config.update("jax_enable_x64", True)
jax.config.update("jax_compilation_cache_dir", sys.argv[1])
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
from jaxball import programs
hits = []
jax.monitoring.register_event_listener(lambda name, **_: hits.append(name) if name.endswith("cache_hits") else None)
factor = float(sys.argv[2])
f = jax.jit(lambda x: programs.jit(lambda x: factor * jnp.sin(x))(x) + 1)
print(float(f(jnp.asarray(0.5))), len(hits))
"""


@pytest.mark.thorough
def test_what_jax_keeps_calls_the_same_program_in_another_process(tmp_path):
    """And never that of a function that has changed since."""
    first, second, changed = (in_new_process(KEPT, str(tmp_path), factor).split() for factor in ("2", "2", "3"))
    assert first[0] == second[0] == repr(1 + 2 * float(np.sin(0.5)))
    assert int(second[1]) > int(first[1])
    np.testing.assert_allclose(float(changed[0]), 1 + 3 * np.sin(0.5), rtol=1e-15)


SEVERAL = """
import jax, jax.numpy as jnp, numpy as np
jax.config.update("jax_enable_x64", True)
from jax.sharding import PartitionSpec as P
from jaxball import programs
assert jax.device_count() == 4
f = programs.jit(lambda x: jnp.sin(x) * 2)
x = jnp.arange(8.0)
mesh = jax.make_mesh((4,), ("rows",))
spread = jax.device_put(x, jax.sharding.NamedSharding(mesh, P("rows")))
wanted = 2 * np.cos(np.arange(8.0))
np.testing.assert_allclose(jax.jit(jax.vmap(jax.grad(f)))(spread), wanted, rtol=1e-14)
shard_map = getattr(jax, "shard_map", None)
if shard_map is None:
    from jax.experimental.shard_map import shard_map
of_each = shard_map(jax.vmap(jax.grad(f)), mesh=mesh, in_specs=P("rows"), out_specs=P("rows"))
np.testing.assert_allclose(jax.jit(of_each)(spread), wanted, rtol=1e-14)
print("done")
"""


@pytest.mark.thorough
def test_on_several_devices():
    assert in_new_process(SEVERAL, XLA_FLAGS="--xla_force_host_platform_device_count=4").endswith("done\n")


def test_threads_may_call_it_at_once():
    mapped = jax.jit(jax.vmap(operated, in_axes=(0, None, None)))
    wanted = [mapped(XS * k, Y, COUNT)["sum"] for k in range(16)]
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda k: np.asarray(mapped(XS * k, Y, COUNT)["sum"]), range(16)))
    np.testing.assert_array_equal(found, wanted)


def test_donated_arrays():
    doubled = jax.jit(programs.jit(lambda x: 2 * x + jnp.sum(x)), donate_argnums=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what cannot be donated
        np.testing.assert_allclose(doubled(jnp.arange(1000.0)), 2 * np.arange(1000.0) + 499500, rtol=1e-14)
