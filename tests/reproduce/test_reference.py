"""The packaged reference solutions against numbers that are known without them."""

import decimal

import numpy as np
import pytest

from jaxball.paper import reference
from tests.support.sentences import refuses

BOTH = pytest.mark.parametrize("load", [reference.ball, reference.disk])


@BOTH
def test_times_are_the_whole_seconds(load):
    np.testing.assert_array_equal(load().times, np.arange(21.0))


@BOTH
def test_values_are_the_nearest_doubles_of_the_decimals(load):
    solution = load()
    assert solution.values.shape == (21, len(solution.names))
    for decimals, values in zip(solution.decimals, solution.values, strict=True):
        assert [float(text) for text in decimals] == values.tolist()


@BOTH
def test_the_arrays_cannot_be_changed(load):
    with refuses(ValueError, "assignment destination"):
        load().values[0, 0] = 1.0


def test_versors_have_length_one_to_thirty_digits():
    solution = reference.ball()
    places = [solution.names.index(f"q[{k}]") for k in range(4)]
    with decimal.localcontext(prec=40):
        for row in solution.decimals:
            square = sum(decimal.Decimal(row[place]) ** 2 for place in places)
            assert abs(square - 1) < decimal.Decimal("1e-30")


def test_coasting_angles_follow_the_pulse_integrated_by_hand():
    """u = 1 up to .1, then 2 - 10 t up to .2: the rate ends at .15, the angle at 11/600 + .15 (t - .2)."""
    for solution, signs in ((reference.ball(), (1, 1, 1)), (reference.disk(), (-1, 1, -1, 1))):
        t = solution.times[1:, None]
        theta = solution.columns("theta")
        turned = np.asarray(signs) * (11 / 600 + 0.15 * (t - 0.2))
        np.testing.assert_allclose(theta[1:] - theta[0], turned, rtol=0, atol=4e-15)
        np.testing.assert_allclose(solution.columns("thetadot")[1:], 0.15 * np.asarray(signs) + 0 * t, atol=1e-15)


def test_columns_are_found_by_symbol():
    ball, disk = reference.ball(), reference.disk()
    assert [ball.columns(symbol).shape[1] for symbol in ("theta", "q", "Omega", "z")] == [3, 4, 3, 2]
    np.testing.assert_array_equal(disk.columns("phi")[:, 0], disk.column("phi"))
    with refuses(KeyError, "name"):
        ball.column("q[4]")
    with refuses(KeyError, "symbol"):
        disk.columns("q")
