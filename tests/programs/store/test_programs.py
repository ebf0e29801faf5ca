"""A program from a store is the program that was compiled: the same bits; and what may differ is another program."""

import contextlib
import functools
import os
import signal
import threading

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import Disk, DiskState, Fixed, PointMass, contact_extremes, programs, simulate
from jaxball.numerics import vectors
from jaxball.programs import computation
from jaxball.programs.native import choice
from jaxball.programs.native.emit.lowering import RULES
from jaxball.programs.native.targets import machine
from jaxball.programs.store import current, folder_store as module
from tests.support.precision import enable_x64

TIMES = np.linspace(0.0, 2.0, 5)
A, B = np.array([1.0, 2.0, 3.0]), np.array([0.3, -0.1, 0.7])


class Memory:
    """A store; each is a process of its own, and shares the contents."""

    def __init__(self, contents, surroundings="here"):
        self.contents, self.surroundings, self.found, self.missed = contents, surroundings, [], []
        self.keeps_xla = True

    def identity(self):
        return self.surroundings

    def read(self, key):
        (self.found if key in self.contents else self.missed).append(key)
        return self.contents.get(key)

    def write(self, key, content):
        self.contents[key] = content

    def early(self, key):
        return None

    def alone(self, key):
        return contextlib.nullcontext()


@pytest.fixture(params=["native", "xla"])
def compiler(request, monkeypatch):
    """The compiler of the programs where none is asked for by its name."""
    monkeypatch.setattr(choice, "DEFAULT", request.param)
    return request.param


@pytest.fixture
def contents(compiler):
    return {}


@pytest.fixture
def in_process(contents):
    """Calls a function as in a process of its own, and returns its result and the store."""

    def call(function, *args, surroundings="here", **kwargs):
        store = Memory(contents, surroundings)
        with current.keep_within(store):
            return function(*args, **kwargs), store

    return call


def same_bits(a, b):
    assert jax.tree.structure(a) == jax.tree.structure(b)
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        assert type(x) is type(y)
        assert x.dtype == y.dtype
        assert np.asarray(x).tobytes() == np.asarray(y).tobytes()


cross = programs.jit(jnp.cross)


def test_programs_are_compiled_quickly_within_a_block_alone(in_process, contents, compiler):
    """By XLA; the others are the same."""
    name = "jax_disable_most_optimizations"
    before = jax.config.values[name]
    try:
        jax.config.update(name, False)
        in_process(cross, A, B)
        with programs.compile_quickly(False):
            assert not jax.config.values[name]
        with programs.compile_quickly():
            assert jax.config.values[name]
            in_process(cross, A, B)
            with programs.compile_quickly(False):
                assert jax.config.values[name]
        assert not jax.config.values[name]
        assert len(contents) == {"native": 1, "xla": 2}[compiler]
    finally:
        jax.config.update(name, before)


@pytest.mark.long
@pytest.mark.parametrize("compiler", ["native"], indirect=True)
def test_code_made_quickly_gives_the_same_bits_and_is_used_until_there_is_optimised_code(in_process, contents):
    disk = Disk(mass=1.0, inertia=0.5, masses=[PointMass(0.5, Fixed((0.5, 0.0, 0.0)))])

    def run():
        return in_process(simulate, disk, TIMES, DiskState(phidot=1.0))

    with programs.compile_quickly():
        quick, _ = run()
        again, store = run()
    assert (len(contents), len(store.found)) == (1, 1)
    same_bits(quick.state, again.state)
    optimised, store = run()
    assert (len(contents), store.found) == (2, [])
    same_bits(quick.state, optimised.state)
    with programs.compile_quickly():
        _, store = run()
    assert (len(contents), len(store.found), store.missed) == (2, 1, [])


def test_a_program_is_compiled_once_and_found_by_the_next_process(in_process, contents, monkeypatch):
    first, store = in_process(cross, A, B)
    assert (len(store.found), len(store.missed), len(contents)) == (0, 1, 1)
    monkeypatch.setattr(computation.Computation, "_of_arrays", None)  # nothing is traced any more
    second, store = in_process(cross, A, B)
    assert (len(store.found), len(store.missed)) == (1, 0)
    same_bits(first, second)
    np.testing.assert_allclose(second, np.cross(A, B), rtol=4e-16)  # products and sums may be rounded together
    # Within the process it is not looked for again.
    with current.keep_within(store):
        same_bits(cross(A, -B), -second)
    assert len(store.found) == 1


@pytest.mark.thorough
@pytest.mark.parametrize(
    "change",
    [
        lambda: cross(A.astype(np.float32), B.astype(np.float32)),
        lambda: cross(np.stack([A, A]), np.stack([B, B])),
        lambda: cross(jnp.asarray(A).astype(int), jnp.asarray(B).astype(int)),
        lambda: cross(a=A, b=B),
        lambda: programs.filter_jit(jnp.cross)(A, B),
        lambda: programs.jit(functools.partial(jnp.cross, A))(B),
        lambda: programs.jit(functools.partial(jnp.cross, 2 * A))(B),
    ],
    ids=["float32", "shape", "integers", "by name", "filtered", "fixed", "otherwise fixed"],
)
def test_other_arguments_are_of_another_program(in_process, contents, change):
    in_process(cross, A, B)
    in_process(lambda: programs.jit(functools.partial(jnp.cross, 3 * A))(B))
    result, store = in_process(change)
    assert (store.found, len(contents)) == ([], 3)
    same_bits(result, change())


def test_weak_types_and_strong_ones_are_tell_numbers_apart(in_process, contents):
    square = programs.jit(jnp.square)
    (weak, _), (strong, _) = in_process(square, 3.0), in_process(square, jnp.asarray(np.float64(3.0)))
    assert (weak.weak_type, strong.weak_type, len(contents)) == (True, False, 2)


def test_static_numbers_of_other_kinds_are_tell_numbers_apart(in_process, contents):
    full = programs.filter_jit(jnp.full)
    values = [1, 1.0, True, np.True_, 1 + 0j]
    with current.keep_within(Memory(contents)):
        results = [full((2,), value) for value in values]
    assert [result.dtype for result in results] == [jnp.full((2,), value).dtype for value in values]
    assert len(contents) == len(values)


def test_settings_are_tell_numbers_apart(in_process, contents):
    in_process(cross, A, B)
    with enable_x64(False):
        single, _ = in_process(cross, A, B)
    with jax.default_matmul_precision("float32"):
        in_process(cross, A, B)
    assert len(contents) == 3
    assert single.dtype == jnp.float32
    # Also within a process.
    with current.keep_within(Memory(contents)):
        assert cross(A, B).dtype == jnp.float64
        with enable_x64(False):
            assert cross(A, B).dtype == jnp.float32


def test_other_surroundings_have_programs_of_their_own(in_process, contents):
    in_process(cross, A, B)
    _, store = in_process(cross, A, B, surroundings="there")
    assert (store.found, len(contents)) == ([], 2)


def test_a_changed_file_of_jaxball_is_seen(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "OWN", tmp_path)
    seen = []
    for name, text in (("a.py", "x = 1\n"), ("a.py", "x = 2\n"), ("b.py", ""), ("b.py", "x = 2\n")):
        (tmp_path / name).write_text(text)
        seen.append(module.sources())
    (tmp_path / "a.py").rename(tmp_path / "c.py")
    seen.append(module.sources())
    assert len(set(seen)) == len(seen)
    assert len({module.identity(digest) for digest in seen}) == len(seen)


@pytest.mark.parametrize("variable", ["XLA_FLAGS", "EQX_ON_ERROR", "JAX_ENABLE_X64"])
def test_variables_are_seen(monkeypatch, variable):
    module.identity.cache_clear()
    before = module.identity("")
    monkeypatch.setenv(variable, "something else")
    module.identity.cache_clear()
    assert module.identity("") != before
    module.identity.cache_clear()


@pytest.mark.parametrize(
    "content", [b"", b"nonsense", b"\x80\x05N.", b"\x80\x05\x8c\x01ab."], ids=["empty", "text", "None", "cut"]
)
def test_what_cannot_be_loaded_is_compiled_again(in_process, contents, content):
    expected, store = in_process(cross, A, B)
    contents[store.missed[0]] = content
    result, _ = in_process(cross, A, B)
    same_bits(result, expected)
    assert len(contents[store.missed[0]]) > len(content)


def test_programs_that_call_python_are_not_kept(in_process, contents, compiler, monkeypatch):
    calls = []
    monkeypatch.setattr(vectors, "cross", lambda a, b: (jax.debug.callback(calls.append, a), a)[1])
    vectors.cross.__module__, vectors.cross.__qualname__ = "jaxball.numerics.vectors", "cross"
    called = programs.jit(vectors.cross)
    for _ in range(2):
        jax.block_until_ready(in_process(called, A, B)[0])
    jax.effects_barrier()
    assert len(calls) == 2
    *refusals, program = contents.values()
    assert program == b""
    assert len(refusals) == (compiler == "native")


@pytest.fixture
def traces(monkeypatch):
    """The names of the functions that are traced."""
    names, original = [], computation.Computation._of_arrays
    monkeypatch.setattr(
        computation.Computation, "_of_arrays", lambda *given: names.append(given[0]) or original(*given)
    )
    return names


@pytest.mark.parametrize("compiler", ["native"], indirect=True)
def test_what_is_not_compiled_natively_is_traced_once_and_then_never(in_process, contents, traces, monkeypatch):
    monkeypatch.delitem(RULES, "stablehlo.sine")
    transform = programs.jit(jnp.sin)
    first, _ = in_process(transform, A)
    assert len(traces) == 1
    assert [content.split(b"\n")[0] for content in contents.values()] == [b"refused", b"xla"]
    second, store = in_process(transform, A)
    assert len(traces) == 1
    assert (len(store.found), store.missed) == (2, [])
    same_bits(first, second)
    # XLA's program is that of those who ask for XLA.
    monkeypatch.setenv("JAXBALL_COMPILER", "xla")
    _, store = in_process(transform, A)
    assert (len(store.found), store.missed) == (1, [])
    # And who asks for the native compiler is told, also where the program was found.
    monkeypatch.setenv("JAXBALL_COMPILER", "native")
    for _ in range(2):
        with pytest.warns(match="stablehlo.sine is not compiled natively: XLA compiles the program `sin`"):
            in_process(transform, A)
        assert len(traces) == 2  # once more, because loops over large arrays would be compiled, too


@pytest.mark.parametrize("compiler", ["native"], indirect=True)
def test_programs_for_another_processor_are_not_used(in_process, contents, monkeypatch):
    in_process(cross, A, B)
    monkeypatch.setattr(machine, "_processor", lambda: ("x86-64", ""))
    result, store = in_process(cross, A, B)
    assert (store.found, len(contents)) == ([], 2)
    np.testing.assert_allclose(result, np.cross(A, B), rtol=1e-15)


@pytest.mark.parametrize("compiler", ["native"], indirect=True)
@pytest.mark.parametrize("lost", [1, 100, -1])
def test_what_is_damaged_is_compiled_again(in_process, contents, traces, lost):
    expected, store = in_process(cross, A, B)
    (key,) = store.missed
    whole = contents[key]
    contents[key] = whole[:lost] + whole[lost + 1 :] if lost > 0 else whole[:lost]
    result, _ = in_process(cross, A, B)
    same_bits(result, expected)
    assert len(traces) == 2
    assert len(contents[key]) == len(whole)


@pytest.mark.skipif(os.name == "nt", reason="on Windows os.kill ends the process")
@pytest.mark.parametrize("compiler", ["native"], indirect=True)
def test_ctrl_c_ends_a_run_of_a_program_that_was_kept(in_process, contents):
    turn = programs.jit(functools.partial(jax.lax.fori_loop, 0, body_fun=jax.lax.bitwise_xor, init_val=np.int64(1)))
    in_process(turn, upper=1)
    timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))

    def interrupted():
        assert turn(upper=3) == 1 ^ 0 ^ 1 ^ 2
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            turn(upper=10**12)

    _, store = in_process(interrupted)
    timer.join()
    assert (len(store.found), store.missed) == (1, [])


@pytest.mark.thorough
def test_programs_within_a_trace_are_kept_as_well(in_process, contents):
    def grow(a):
        return jnp.sum(cross(a, B) ** 2)

    def traced():
        jax.clear_caches()
        return jax.grad(grow)(A), jax.vmap(cross)(A[None], B[None]), jax.jit(cross)(A, B)

    expected = traced()
    result, _ = in_process(traced)
    same_bits(result, expected)
    assert contents
    again, store = in_process(traced)
    same_bits(again, expected)
    assert store.found
    assert store.missed == []


def test_the_one_device_may_be_named(in_process, contents):
    """As where batches go to the devices in turn."""
    in_process(cross, A, B)
    with jax.default_device(jax.devices()[0]):
        _, store = in_process(cross, A, B)
    assert (len(store.found), len(contents)) == (1, 1)


def test_where_jax_keeps_xlas_programs_itself_it_is_left_to_it(in_process, contents, compiler, tmp_path):
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    in_process(cross, A, B)
    assert len(contents) == (compiler == "native")
    jax.config.update("jax_compilation_cache_dir", None)
    in_process(cross, A, B)
    assert contents


def test_debugging_sees_its_own_programs(in_process, contents):
    with jax.debug_nans(True):
        in_process(cross, A, B)
    with jax.disable_jit():
        in_process(cross, A, B)
    assert contents == {}


@pytest.fixture(scope="module")
def disk():
    return Disk(mass=1.0, inertia=0.5, masses=[PointMass(0.5, Fixed((0.5, 0.0, 0.0)))])


@pytest.mark.long
def test_a_run_and_its_extremes_are_the_same_to_the_last_bit(in_process, contents, disk):
    """Trajectories hold modules of diffrax and of jaxball, functions and numbers that are no arrays."""

    def run():
        trajectory = simulate(disk, TIMES, dense=True)
        failed = simulate(disk, TIMES, dense=True, max_steps=4)
        impossible = simulate(disk, TIMES, DiskState(phi=jnp.nan), dense=True)
        return (
            trajectory,
            contact_extremes(trajectory),
            trajectory.observables,
            trajectory.at(1.3),
            [(one.status, one.message, one.state) for one in (failed, impossible)],
        )

    first, _ = in_process(run)
    assert contents
    second, store = in_process(run)
    assert len(store.found) == len(contents)
    same_bits(jax.tree.leaves(eqx.filter(first, eqx.is_array)), jax.tree.leaves(eqx.filter(second, eqx.is_array)))
    assert str(first) == str(second)


def test_results_with_systems_in_them_are_kept(in_process, contents, disk):
    """Whose classes refuse to be made without arguments, as what is loaded is at first."""
    turned = programs.jit(functools.partial(jax.tree.map, jax.lax.neg))
    first, _ = in_process(turned, disk)
    assert all(contents.values())
    second, store = in_process(turned, disk)
    assert (len(store.found), store.missed) == (1, [])
    same_bits(first, second)
