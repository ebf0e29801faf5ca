"""Branches known in closed form: a circle, cubics with folds, an eigenvalue problem's bifurcation branch."""

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.sparse

from jaxball.studies.design import DesignError, follow
from jaxball.studies.design.continuation import AbstractEquations
from tests.support.sentences import refuses


@pytest.fixture(scope="module")
def circle():
    """y² + λ² = 1."""
    return lambda y, parameter: y**2 + parameter**2 - 1


@pytest.fixture(scope="module")
def fold():
    """λ = y³ − 3y, with turning points at y = −1, λ = 2, and at y = 1, λ = −2."""
    return lambda y, parameter: y**3 - 3 * y - parameter


def test_all_the_way_round_a_circle(circle):
    branch = follow(circle, np.ones(1), 0.0, length=2 * np.pi, longest=0.1)
    np.testing.assert_allclose(branch.y[:, 0] ** 2 + branch.parameter**2, 1.0, atol=1e-12)
    assert branch.ended == "length"
    assert [round(one.parameter) for one in branch.folds] == [1, -1]
    for one, parameter in zip(branch.folds, (1.0, -1.0), strict=True):
        assert abs(one.parameter - parameter) < 1e-12
        assert abs(one.y[0]) < 1e-8
    # Each step is a tangent's length, arctan of it along the circle.
    steps = np.diff(np.unwrap(np.arctan2(branch.parameter, branch.y[:, 0])))
    np.testing.assert_allclose(np.sin(steps), np.diff(branch.length), atol=1e-10)


def test_past_both_folds_of_a_cubic(fold):
    branch = follow(fold, np.array([-2.0]), -2.0, 5.0)
    assert branch.ended == "end"
    assert branch.parameter[-1] == 5.0
    np.testing.assert_allclose(branch.y[:, 0] ** 3 - 3 * branch.y[:, 0], branch.parameter, atol=1e-10)
    assert np.all(np.diff(branch.y[:, 0]) > 0)
    np.testing.assert_allclose([one.parameter for one in branch.folds], [2.0, -2.0], atol=1e-12)
    np.testing.assert_allclose([one.y[0] for one in branch.folds], [-1.0, 1.0], atol=1e-7)
    for one in branch.folds:
        assert branch.y[one.after, 0] <= one.y[0] <= branch.y[one.after + 1, 0]


class Bratu(AbstractEquations):
    """y″ + λ eʸ = 0, y(0) = y(1) = 0, by differences: sparse."""

    def __init__(self, points):
        self.h = 1 / (points + 1)
        ones = np.ones(points)
        self.second = scipy.sparse.diags_array([ones[1:], -2 * ones, ones[1:]], offsets=[-1, 0, 1]) / self.h**2

    def residual(self, y, parameter):
        return self.second @ y + parameter * np.exp(y)

    def jacobian(self, y, parameter):
        return self.second + scipy.sparse.diags_array(parameter * np.exp(y)), np.exp(y)


def test_the_fold_of_the_bratu_problem():
    """λ = 3.513830719 (the maximum of 8 (θ / cosh θ)²), by sparse equations of second order in h."""
    folds = []
    for points in (49, 99):
        branch = follow(Bratu(points), np.zeros(points), 0.0, length=12.0, longest=0.5)
        assert branch.ended == "length"
        (one,) = branch.folds
        folds.append(one.parameter)
    theta = 1.1996786402577338  # θ tanh θ = 1
    exact = 8 * (theta / np.cosh(theta)) ** 2
    assert abs((4 * folds[1] - folds[0]) / 3 - exact) < 1e-6


def test_a_branch_that_ends_is_kept():
    """y = √λ, followed down to λ = 0, where it ends."""
    branch = follow(lambda y, parameter: y - jnp.sqrt(parameter)[None], np.ones(1), 1.0, -1.0)
    assert branch.ended == "lost"
    assert 0 <= branch.parameter[-1] < 0.01
    np.testing.assert_allclose(branch.y[:, 0] ** 2, branch.parameter, atol=1e-9)


def test_a_start_that_is_no_solution_is_refused(circle):
    with refuses(DesignError, "y"):
        follow(circle, np.ones(1), 2.0)
