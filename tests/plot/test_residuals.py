"""The residuals of laws over time."""

import numpy as np

from jaxball import plot


def test_each_law_is_a_curve_below_the_line_at_one():
    times, energy = np.array([1.0, 2.0, 4.0]), np.array([0.0, 1e-3, 2.0])
    ax = plot.law_residuals(times, {"energy": energy, "axial_momentum": 0.1 * energy})
    first, second, bound = ax.lines
    np.testing.assert_array_equal(first.get_xydata(), np.stack([times, [1e-8, 1e-3, 2.0]], axis=1))
    assert [line.get_label() for line in (first, second)] == ["energy", "axial momentum"]
    assert (first.get_color(), first.get_linestyle()) != (second.get_color(), second.get_linestyle())
    assert set(bound.get_ydata()) == {1.0}
    assert ax.get_yscale() == "log"
