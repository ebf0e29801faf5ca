"""What JAX is given for a GPU, on a machine without one: XLA is told to call the kernel's launcher."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import programs
from jaxball.programs import native
from jaxball.programs.native import gpu
from jaxball.programs.native.targets.cuda import CudaError
from jaxball.programs.store import current
from tests.programs.store.test_programs import Memory

from . import stubs
from .programs import height, run


class Driver(stubs.Driver):
    """A driver that compiles nothing, for one kind of GPU, and counts what it is asked to compile."""

    version = 13000

    def __init__(self, kinds=((9, 0),)):
        super().__init__(parts=0)
        self.kinds, self.compiled = list(kinds), 0

    def capabilities(self):
        return self.kinds

    def compile(self, ptx):
        self.compiled += 1
        assert ".visible .entry kernel(" in ptx
        return ptx.encode()


@pytest.fixture
def driver(monkeypatch):
    stub = Driver()
    monkeypatch.setattr(gpu, "driver", lambda: stub)
    programs.forget()  # no program of a stub is found by another test, or the other way round, or by the next run
    with current.keep_within(None):
        yield stub
    programs.forget()


def lowered(function, *arguments):
    """The text that XLA would compile for a GPU."""
    return jax.jit(function).trace(*arguments).lower(lowering_platforms=("cuda",)).as_text()


RADII = jnp.linspace(0.5, 0.9, 8)


def test_a_run_is_a_call_of_its_kernel(driver):
    text = lowered(lambda r: run(r).state.z, jnp.asarray(0.7))
    assert text.count("jaxball_gpu_") == 1
    assert "stablehlo.while" not in text
    assert driver.compiled == 1


def test_rows_are_a_call_of_the_same_kernel(driver):
    single, many = lowered(height, RADII[0]), lowered(jax.vmap(height), RADII)
    name = single[single.index("jaxball_gpu_") :][:44]
    assert name in many


@pytest.mark.thorough
def test_gradients_are_kernels(driver):
    text = lowered(jax.vmap(jax.value_and_grad(height)), RADII)
    assert text.count("jaxball_gpu_") == 2  # the run, and back


def test_without_a_driver_xla_compiles_the_run(monkeypatch):
    def missing():
        raise CudaError("The driver of an NVIDIA GPU is not there.")

    monkeypatch.setattr(gpu, "driver", missing)
    text = lowered(lambda r: run(r).state.z, jnp.asarray(0.71))
    assert "jaxball_gpu_" not in text
    assert "stablehlo.while" in text


def test_xla_compiles_where_it_is_chosen(driver):
    with jaxball.compiler("xla"):
        assert "jaxball_gpu_" not in lowered(lambda r: run(r).state.z, jnp.asarray(0.7))


def test_a_users_function_as_a_whole_is_no_single_thread(driver):
    def sweep(radii):
        return jax.vmap(height)(radii)

    text = lowered(jaxball.jit(sweep), RADII)
    assert text.count("jaxball_gpu_") == 1  # the runs in it, each in a thread


def test_what_only_a_cpu_has_is_refused(driver):
    @jaxball.jit
    def solved(matrix):
        return jnp.linalg.eigh(matrix)[0]

    text = lowered(jax.vmap(solved), jnp.stack([jnp.eye(3)] * 4))
    assert "jaxball_gpu_" not in text


def test_kernels_are_kept_between_processes(driver):
    contents = {}
    texts = []
    for _ in range(2):
        programs.forget()
        with current.keep_within(Memory(contents)):
            texts.append(lowered(jax.vmap(lambda r: run(r, rtol=1e-6).state.z), RADII))
    assert driver.compiled == 1
    assert texts[0] == texts[1]


@pytest.mark.parametrize(("rows", "calls"), [(8, 1), (5000, 0)])
def test_a_single_thread_does_not_map_over_thousands_of_rows(driver, rows, calls):
    @programs.jit
    def energies(speeds):
        return jax.lax.map(lambda v: jnp.sum(jnp.sin(v * jnp.arange(9.0)) ** 2), speeds)

    assert lowered(energies, jnp.ones(rows)).count("jaxball_gpu_") == calls


def test_a_failure_of_the_driver_is_left_to_xla_and_not_kept(driver, monkeypatch):
    def fail(ptx):
        raise CudaError("cuLinkComplete of the GPU's driver: out of memory (2).")

    contents = {}
    with current.keep_within(Memory(contents)):
        monkeypatch.setattr(driver, "compile", fail)
        assert "jaxball_gpu_" not in lowered(lambda r: run(r, rtol=1e-5).state.z, RADII[0])
        assert not contents
        monkeypatch.undo()
        monkeypatch.setattr(gpu, "driver", lambda: driver)
        programs.forget()
        assert "jaxball_gpu_" in lowered(lambda r: run(r, rtol=1e-5).state.z, RADII[0])
    assert contents


def test_a_kernel_that_cannot_be_loaded_is_left_to_xla(driver, monkeypatch):
    def fail(code):
        raise CudaError("The driver of the GPU has no cuLibraryLoadData.")

    monkeypatch.setattr(driver, "load", fail)
    monkeypatch.setattr(gpu, "_targets", {})  # of which other tests have loaded the same kernel
    assert "jaxball_gpu_" not in lowered(lambda r: run(r, rtol=2e-5).state.z, RADII[0])


def test_gpus_of_several_kinds_get_ptx(driver):
    driver.kinds = [(9, 0), (8, 6)]
    assert gpu.compile_for_gpus(".version 7.0") == b".version 7.0\0"


def test_a_cpu_in_the_same_process_is_not_changed(driver):
    np.testing.assert_array_equal(jax.jit(jax.vmap(height))(RADII), jax.vmap(height)(RADII))
    assert native.is_allowed()
