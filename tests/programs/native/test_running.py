"""How programs run: in threads, until Ctrl-C, and without leaving anything behind."""

import gc
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxball
from jaxball.programs.native.executable import Executable
from jaxball.programs.native.pipeline import compile_for_cpu

from .comparison import native


def count(n):
    return lax.fori_loop(0, n, lambda i, x: jnp.sin(x) + 1e-9 * i.astype(float), 1.0)


def test_arguments_may_be_read_only_empty_or_in_columns():
    f = jaxball.jit(lambda x, empty, numbers: x.sum() + empty.sum() + (numbers * jnp.arange(6.0).reshape(2, 3)).sum())
    x, numbers = np.arange(4.0), np.asfortranarray(np.arange(6.0).reshape(2, 3))
    x.setflags(write=False)
    assert f(x, np.zeros((0, 3)), numbers) == 6.0 + 55.0
    assert f(np.arange(8.0)[::2], np.zeros((0, 3)), numbers) == 12.0 + 55.0


def test_threads_share_a_program():
    """Each has memory of its own to work in."""

    def powers(x):
        return lax.fori_loop(0, 2000, lambda i, c: c.at[i % 4999 + 1].set(c[i % 4999] * 0.999 + x), jnp.zeros(5000))

    f = jaxball.jit(powers)
    expected = [np.asarray(f(float(x))) for x in range(8)]
    with ThreadPoolExecutor(4) as threads:
        for found, one in zip(threads.map(f, [float(x) for x in range(8)] * 5), expected * 5, strict=True):
            np.testing.assert_array_equal(found, one)


def test_the_lock_of_python_is_given_up():
    """Another thread goes on while a program runs."""
    f = jaxball.jit(count)
    f(1)
    turns, done = 0, threading.Event()

    def run():
        f(20_000_000)
        done.set()

    thread = threading.Thread(target=run)
    thread.start()
    while not done.is_set() and turns < 5:
        turns += 1
        time.sleep(0.001)
    assert turns == 5
    thread.join()


@pytest.mark.parametrize("where", ["loop", "function", "inner"])
def test_ctrl_c_ends_a_run(where):
    @jax.jit
    def long(x, n):
        for i in range(120):
            x = x * 0.99 + 0.01 * i
        return x + count(n)

    def f(n):
        if where == "loop":
            return count(n)
        if where == "function":
            return long(0.0, n) + long(1.0, n)
        return lax.fori_loop(
            0, n, lambda i, x: x + jnp.sum(lax.fori_loop(0, 3, lambda j, y: jnp.sin(y), jnp.ones(5000))), 0.0
        )

    jitted = jaxball.jit(f)
    jitted(1)
    for _ in range(3):
        timer = threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGINT))
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            jitted(10**12)
        timer.join()
    np.testing.assert_allclose(jitted(3), jax.jit(f)(3), rtol=1e-12)  # as if nothing had happened


def test_a_handler_of_signals_may_run_a_program():
    f = jaxball.jit(lambda n: lax.fori_loop(0, n, lambda i, x: x.at[i % 3000].add(1.0), jnp.zeros(3000)))
    inner = jaxball.jit(lambda: lax.fori_loop(0, 100, lambda i, x: x.at[i].set(-1.0), jnp.zeros(3000)))
    inner(), f(1)
    calls = []
    before = signal.signal(signal.SIGALRM, lambda *_: calls.append(inner()))
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.02)
        result = f(200_000_000)
    finally:
        signal.signal(signal.SIGALRM, before)
    assert calls
    assert np.sum(result) == 200_000_000


@pytest.mark.thorough
@pytest.mark.parametrize("programs", [300, pytest.param(10_000, marks=pytest.mark.slow)])
def test_memory_does_not_grow(programs):
    """Programs that are made and dropped leave nothing behind: one that was kept would take at least 4 kB.

    The first ones do, as LLVM takes memory to work in, and so do pages that are not full yet, now and then.
    """

    def made(k):
        gives = [((100,), np.dtype(float), False)]
        return Executable(compile_for_cpu(module, [np.dtype(float)], gives))([np.full(100, float(k))])

    module = jax.jit(lambda x: 2.0 * x + x[::-1]).lower(np.ones(100))
    module = module.compiler_ir("stablehlo")
    for k in range(250):
        made(k)
    growth = []
    for _ in range(3):
        gc.collect()
        before = resident()
        for k in range(programs // 3):
            made(k)
        gc.collect()
        growth.append(resident() - before)
    assert min(growth) < 1e3 * (programs // 3), growth


def resident():
    """The bytes of memory that this process has."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize()


def test_results_are_not_changed_by_later_calls():
    f = jaxball.jit(lambda x: (x + 1, jnp.sum(x)))
    first = f(jnp.zeros(3))
    f(jnp.ones(3))
    np.testing.assert_array_equal(first[0], np.ones(3))
    assert native(lambda x: x, jnp.arange(3.0)).tolist() == [0.0, 1.0, 2.0]


@pytest.mark.thorough
def test_llvmlite_is_imported_when_it_is_needed():
    text = "import sys, jaxball, jaxball.programs.native; sys.exit('llvmlite' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", text], check=False).returncode == 0
