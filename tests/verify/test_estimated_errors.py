"""The row that compares the error of a run with its estimate: where it holds, where it fails, where it cannot tell."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.analysis.verify import check_laws, comparisons
from jaxball.interface.status import SolveError
from tests.verify.test_convergence import Lorenz


def test_the_estimate_agrees_with_the_error(case):
    row = comparisons.estimate(case)
    assert row.ok
    assert row.residual < 0.01 * np.max(case.errors)
    assert f"against the reference it is {np.max(case.errors):.1e}" in row.verdict


@pytest.mark.parametrize("factor", [0.0, -1.0, 3.0])
def test_an_estimate_that_is_wrong_fails(monkeypatch, case, factor):
    right = case.run.error_estimate()
    wrong = jax.tree.map(lambda error: factor * error, right)
    monkeypatch.setattr(comparisons, "estimate_error", lambda run: wrong)
    assert comparisons.estimate(case).verdict.startswith("FAILS")


def test_a_solve_that_fails_is_a_remark(monkeypatch, case):
    def fails(run):
        raise SolveError("The error of this run cannot be estimated.")

    monkeypatch.setattr(comparisons, "estimate_error", fails)
    assert comparisons.estimate(case).verdict == "FAILS: The error of this run cannot be estimated."


@pytest.mark.thorough
def test_an_error_as_large_as_the_motion_has_no_estimate():
    """Errors of 1e-8 have grown to the size of the motion by t = 20."""
    row = check_laws(Lorenz(), jnp.array([0.0, 30.0]), rtol=1e-8, atol=1e-8, laws=["estimate"])["estimate"]
    assert "does not apply: the error, " in row.verdict
