"""Programs of a GPU's threads, emulated on a CPU, give what ``jax.vmap`` gives on a CPU, to the last bit."""

import pytest

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
        assert differences(Grid(computation)(arrays, rows), results) == 0


def test_results_do_not_depend_on_the_number_of_threads():
    with recorded() as calls:
        PROGRAMS["a disk"]()
    computation, arrays, rows, results = calls[-1]
    grid = Grid(computation)
    for threads in (1, 7, 64):
        assert differences(grid(arrays, rows, threads), results) == 0
