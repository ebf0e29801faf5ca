"""The figures of optimal control, and the Axes that they refuse."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from jaxball import plot
from tests.support.sentences import refuses

TIMES = np.linspace(0.0, 1.0, 5)
WEIGHTS, ERRORS = np.array([1.0, 10.0, 100.0]), np.array([0.3, 0.1, 0.02])
DRAWN = {
    "branch": lambda ax: plot.branch(WEIGHTS, {"error": ERRORS}, ax=ax),
    "accelerations": lambda ax: plot.rail_accelerations(TIMES, np.stack([TIMES, TIMES**2], axis=1), ax),
    "place": lambda ax: plot.place_in_time({"found": (TIMES, TIMES**2)}, (TIMES, TIMES), ax),
}


def lines(name):
    return [line.get_xydata() for line in DRAWN[name](None).lines]


def test_the_numbers_are_those_that_were_given():
    np.testing.assert_array_equal(lines("branch"), [np.stack([WEIGHTS, ERRORS], axis=1)])
    np.testing.assert_array_equal(lines("accelerations")[1], np.stack([TIMES, TIMES**2], axis=1))
    np.testing.assert_array_equal(lines("place")[1], np.stack([TIMES, TIMES], axis=1))


@pytest.mark.parametrize("name", DRAWN)
def test_space_axes_are_refused(name):
    with refuses(ValueError, "ax"):
        DRAWN[name](Figure().add_subplot(projection="3d"))
