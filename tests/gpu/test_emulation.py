"""Programs of a GPU's threads, emulated on a CPU, give what ``jax.vmap`` gives on a CPU, to the last bit."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.programs.native.targets.machine import HOST
from jaxball.programs.program import jit

from .emulation import Grid, differences, recorded
from .programs import PROGRAMS

QUICK = ("Dopri8", "a disk")


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.long) for name in PROGRAMS]
)
def test_threads_give_the_bits_of_the_cpu(name):
    with recorded() as calls:
        PROGRAMS[name]()
    assert calls
    for computation, arrays, rows, results in calls:
        if not computation.in_lanes:
            check_one_by_one(computation, arrays, rows, results)
            continue
        assert differences(Grid(computation)(arrays, rows), results) == 0


def check_one_by_one(computation, arrays, rows, results):
    """Rows whose stages fill vectors: sums may take up other products there, and round otherwise.

    As the CPU's own single program the grid gives the same bits; as that of a thread, which has no vectors, as many
    steps, and numbers that differ by rounding.
    """
    assert differences(Grid(computation, HOST._replace(has_signals=False))(arrays, rows), results) == 0
    for own, other in zip(Grid(computation)(arrays, rows), results, strict=True):
        if own.dtype.kind == "f":
            np.testing.assert_allclose(own, other, rtol=1e-10, atol=1e-11)
        else:
            np.testing.assert_array_equal(own, other)


def test_sums_of_products_in_memory_have_the_bits_of_the_cpu():
    """More products than are in registers: the first of a sum is rounded, and the second is not, in lanes as well."""
    weights, rows = np.random.default_rng(0).normal(size=(8, 14)), np.random.default_rng(1).normal(size=(19, 14, 6))

    def interpolated(values):
        for _ in range(16):  # which pays for lanes
            values = jnp.sin(values)
        return jnp.asarray(weights) @ values

    with recorded() as calls:
        jax.vmap(jit(interpolated))(jnp.asarray(rows))
    ((computation, arrays, in_rows, results),) = calls
    assert differences(Grid(computation)(arrays, in_rows), results) == 0


def test_results_do_not_depend_on_the_number_of_threads():
    with recorded() as calls:
        PROGRAMS["a disk"]()
    computation, arrays, rows, results = calls[-1]
    grid = Grid(computation)
    for threads in (1, 7, 64):
        assert differences(grid(arrays, rows, threads), results) == 0
