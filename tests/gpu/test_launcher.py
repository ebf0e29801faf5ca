"""The handler by which XLA starts a kernel, against stubs of XLA and of the driver."""

import numpy as np
import pytest

from jaxball.programs.native.calls import grid
from jaxball.programs.native.calls.handler import NEXT, PARTS, ROWS, Part, handler
from jaxball.programs.native.gpu import GridForm, connect
from jaxball.programs.native.limits import ROWS_OF_LAUNCH
from jaxball.programs.native.targets.machine import object_code

from . import stubs

TAKES, GIVES = [Part(1, 24, False), Part(0, 8, False)], [Part(0, 8, False)]
LARGE = 2**20  # bytes to work in


def start(driver, xla, rows, workspace=0, results=None):
    """Calls the launcher of a program with rows of its first argument; returns the error and the arrays."""
    launcher = object_code(handler(TAKES, GIVES, 1) + grid.launcher(workspace))
    code = connect(GridForm(b"kernel", launcher, (), 0), driver)
    arrays = [np.zeros((rows, 3)) if rows else np.zeros(3), np.zeros(())], [np.zeros((rows,) if rows else ())]
    error = xla.call(code.address("call"), *arrays)
    return error, [*arrays[0], *arrays[1]]


@pytest.mark.parametrize("rows", [1, 63, 64, 65, 1000])
def test_rows_are_started_in_groups_on_the_stream_of_xla(rows):
    driver, xla = stubs.Driver(parts=3), stubs.Xla()
    error, arrays = start(driver, xla, rows)
    (launch,) = driver.launches
    assert error is None
    assert (launch.kernel, launch.stream) == (stubs.KERNEL, stubs.STREAM)
    assert launch.threads * (launch.groups - 1) < rows <= launch.threads * launch.groups
    assert (launch.table[NEXT // 8], launch.table[ROWS // 8]) == (0, rows)
    places = launch.table[PARTS // 8 :]
    assert places[::2] == [array.ctypes.data for array in arrays]
    assert places[1::2] == [24, 0, 8]  # the second argument is the same for all rows


def test_a_single_run_is_one_thread():
    driver, xla = stubs.Driver(parts=3), stubs.Xla()
    start(driver, xla, None)
    (launch,) = driver.launches
    assert launch.groups == 1
    assert launch.table[ROWS // 8] == 1
    assert launch.table[PARTS // 8 + 1 :: 2] == [0, 0, 0]


def test_many_rows_are_started_in_slices():
    driver, xla = stubs.Driver(parts=3), stubs.Xla()
    rows = 2 * ROWS_OF_LAUNCH + 100
    assert start(driver, xla, rows)[0] is None
    spans = [(launch.table[NEXT // 8], launch.table[ROWS // 8]) for launch in driver.launches]
    assert spans == [
        (0, ROWS_OF_LAUNCH),
        (ROWS_OF_LAUNCH, 2 * ROWS_OF_LAUNCH),
        (2 * ROWS_OF_LAUNCH, rows),
    ]
    assert [launch.groups * launch.threads for launch in driver.launches] == [
        ROWS_OF_LAUNCH,
        ROWS_OF_LAUNCH,
        128,
    ]


@pytest.mark.parametrize(("rows", "threads"), [(10, 64), (10**6, stubs.RESIDENT)])
def test_large_memory_to_work_in_is_xlas_for_as_many_threads_as_run_at_once(rows, threads):
    driver, xla = stubs.Driver(parts=3), stubs.Xla()
    assert start(driver, xla, rows, LARGE)[0] is None
    assert xla.allocated == [threads * LARGE]
    assert xla.freed == [(threads * LARGE, 0xA0000)]
    assert {launch.table[grid.MEMORY // 8] for launch in driver.launches} == {0xA0000}
    # No thread works in memory that is not there.
    assert all(launch.groups * launch.threads <= threads for launch in driver.launches)


@pytest.mark.parametrize(("rows", "threads", "tries"), [(10**5, 2048, 2), (3_010, 1_536, 2)])
def test_fewer_threads_run_where_memory_is_short(rows, threads, tries):
    driver, xla = stubs.Driver(parts=3), stubs.Xla(most=3000 * LARGE)
    assert start(driver, xla, rows, LARGE)[0] is None
    assert xla.allocated == [threads * LARGE]
    assert xla.dropped == tries - 1
    assert driver.launches[0].groups * driver.launches[0].threads == threads


def test_too_little_memory_is_an_error_that_says_what_to_do():
    driver, xla = stubs.Driver(parts=3), stubs.Xla(most=10)
    assert start(driver, xla, 10**5, LARGE)[0] is not None
    assert not driver.launches
    ((code, message),) = xla.errors
    assert code == 8  # resource exhausted
    assert f"each needs {LARGE} bytes" in message
    assert "batch_size" in message


@pytest.mark.parametrize(("result", "code"), [(2, 8), (701, 8), (719, 13)])
def test_what_the_driver_says_is_an_error_of_xla(result, code):
    driver, xla = stubs.Driver(parts=3, results=[0, result]), stubs.Xla()
    assert start(driver, xla, 3 * ROWS_OF_LAUNCH)[0] is not None
    assert len(driver.launches) == 2  # nothing is started after what failed
    ((found, message),) = xla.errors
    assert found == code
    assert f"CUDA error {result}" in message
    assert "JAXBALL_COMPILER" in message
