"""The row that compares the derivative of a run's end with differences of runs: where it holds, and where it fails."""

import numpy as np
import pytest

from jaxball import BallState, Contact, Disk, DiskState, Scenario
from jaxball.analysis.verify import check_laws, comparisons
from jaxball.programs.derivatives import steering
from jaxball.programs.store import current
from jaxball.simulation.global_error import slope_of_end
from tests.derivatives.test_sensitivity_control import END, MARBLE, OMEGA


@pytest.fixture(scope="module")
def at_rest():
    return comparisons.Case(Scenario("", MARBLE, BallState(), np.array([0.0, END]), rtol=1e-6, atol=1e-6))


def test_the_derivative_agrees_with_differences(case):
    row = comparisons.derivative(case)
    assert row.ok
    assert row.residual is not None
    assert row.residual < 1e-3
    assert row.verdict.startswith("holds: along a direction that grows ")


def test_a_derivative_that_is_wrong_fails(monkeypatch, case):
    def wrong(*arguments):
        slope = slope_of_end(*arguments)
        return slope._replace(derivative=1.01 * slope.derivative)

    monkeypatch.setattr(comparisons, "slope_of_end", wrong)
    assert comparisons.derivative(case).verdict.startswith("FAILS")


def test_differences_at_rest_are_the_closed_form(at_rest):
    """The place of the marble, which is the last part of its state, moves as cos ωT."""
    direction = np.zeros(at_rest.weights.size)
    direction[-2] = 1.0
    slope = slope_of_end(at_rest.run, direction, comparisons.WIDTH, (1e-6, 1e-6))
    assert abs(slope.differences[-2] - np.cos(OMEGA * END)) < 1e-8  # of roundings, 1e-13 / WIDTH
    assert abs(slope.derivative[-2] - np.cos(OMEGA * END)) < 1e-3
    assert comparisons.derivative(at_rest).ok


def test_steps_for_the_state_alone_fail_at_rest(monkeypatch, at_rest):
    monkeypatch.setattr(steering, "SHARE", 0.0)
    with current.keep_within(None):  # the store has programs with another share
        assert comparisons.derivative(at_rest).verdict.startswith("FAILS")


def test_a_body_that_could_slip_has_none():
    law, start = Contact(friction=0.5), DiskState(phidot=-1.0)
    row = check_laws(Disk(mass=1.0, inertia=0.5), [0.0, 1.0], start, contact=law, laws=["derivative"])["derivative"]
    assert row.reason == "it has modes, and nearby runs may be in others"
