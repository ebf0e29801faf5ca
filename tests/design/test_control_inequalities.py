"""Optimal controls with inequalities, known in closed form."""

import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from jaxball.studies.design import DesignError, optimal_control
from jaxball.studies.design.optimal_control import refinement as module
from jaxball.studies.design.optimal_control.collocation import multiplier, slack
from jaxball.studies.design.optimal_control.solution import solve_near
from tests.support.differences import slope

from .double_integrator import Double, still


class Limited(Double):
    """The double integrator over a time of one, with a limit of something."""

    limit: Float[Array, ""]


class LimitedSpeed(Limited):
    """ẋ ≤ V: u falls from 2 V / τ to 0 within τ = 3 (V − 1) / (2 V), and the speed stays at V."""

    def inequalities(self, t, x, u):
        return self.limit - x[1:]

    @property
    def touched(self):
        return 1.5 * (self.limit - 1) / self.limit

    @property
    def least(self):
        return 8 * self.limit**2 / (3 * self.touched)

    def control(self, t):
        V, tau = float(self.limit), float(self.touched)
        return 2 * V / tau * (np.maximum(1 - t / tau, 0) - np.maximum(1 - (1 - t) / tau, 0))


class LimitedForce(Limited):
    """|u| ≤ U: u is linear between two stretches at U, with the distance U (1/4 − σ²/3) for a slope U / σ."""

    def inequalities(self, t, x, u):
        return (self.limit**2 - u**2) / (2 * self.limit)

    @property
    def sigma(self):
        return jnp.sqrt(3 * (1 / 4 - 1 / self.limit))

    @property
    def least(self):
        return self.limit**2 * (1 - 4 * self.sigma / 3)

    def control(self, t):
        U, sigma = float(self.limit), float(self.sigma)
        return U * np.clip((0.5 - t) / sigma, -1, 1)


class BrysonDenham(Limited):
    """From 0 with the speed 1 back to 0 with −1, x ≤ l ≤ 1/6: ∫ u² = 8 / (9 l) (Bryson & Ho, section 3.11).

    u = −2 / (3 l) (1 − t / (3 l)) until x = l at 3 l, where x stays until 3 l before the end.
    """

    @property
    def initial(self):
        return jnp.array([0.0, 1.0])

    def conditions(self, x):
        return x - jnp.array([0.0, -1.0])

    def inequalities(self, t, x, u):
        return self.limit - x[:1]

    @property
    def least(self):
        return 8 / (9 * self.limit)

    def control(self, t):
        l = float(self.limit)
        return -2 / (3 * l) * (np.maximum(1 - t / (3 * l), 0) + np.maximum(1 - (1 - t) / (3 * l), 0))


def posed(kind, limit, intervals=10):
    problem = kind(*map(jnp.asarray, (0.0, 1.0, 1.0, limit)))
    return optimal_control.Collocation(problem, np.linspace(0.0, 1.0, intervals + 1))


PROBLEMS = {"speed": (LimitedSpeed, 1.23), "force": (LimitedForce, 4.5), "Bryson-Denham": (BrysonDenham, 0.09)}


@pytest.fixture(scope="module", params=PROBLEMS)
def begun(request):
    """A solution with a large barrier, and the same with a small one."""
    collocation = posed(*PROBLEMS[request.param])
    first = solve_near(collocation, still(collocation))
    return first, first.sharpen()


@pytest.mark.thorough
def test_the_optimum_on_its_boundary(begun):
    """The guess at rest keeps no end condition, and that of Bryson and Denham violates the inequality."""
    found = begun[1]
    problem, t = found.problem, np.linspace(0.0, 1.0, 1001)
    least = float(problem.least)
    assert abs(found.collocation.cost(found.y, 0.0) / least - 1) < 1e-5
    u = problem.control(t)
    assert np.sqrt(np.mean((found.path.inputs(t)[:, 0] - u) ** 2)) < 1e-2 * np.max(np.abs(u))
    assert np.max(found.violations()) <= 1e-4
    assert np.max(found.errors) <= 1e-6


@pytest.mark.thorough
def test_the_barrier_costs_at_most_what_it_is(begun):
    """In a convex problem with one inequality, the cost is above the least by at most µ: the gap of duality."""
    first = begun[0]
    above = first.collocation.cost(first.y, 0.0) - float(first.problem.least)
    assert 0.1 * first.collocation.barrier < above < 1.01 * first.collocation.barrier
    assert np.max(first.violations()) == 0


@pytest.mark.thorough
def test_the_curvature_along_the_boundary(begun):
    """It is that of u², whatever the inequality."""
    assert abs(begun[1].least_curvature() - 2) < 1e-3


class Away(Limited):
    """The largest mean of u² for |u| ≤ 1: u = 1 is as good as it gets, and u = 0 the worst."""

    def cost(self, t, x, u):
        return -(u[0] ** 2)

    def conditions(self, x):
        return jnp.zeros((0,))

    def inequalities(self, t, x, u):
        return (1 - u**2) / 2


@pytest.mark.thorough
@pytest.mark.parametrize(("u", "minimum"), [(1.5, True), (0.0, False)])
def test_a_boundary_makes_a_minimum(u, minimum):
    """With L = −u² − σ g the curvature is σ − 2, and the barrier's σ² / µ is added where g = 0, σ = 2."""
    collocation = posed(Away, 1.0, intervals=2)
    path = still(collocation)
    found = solve_near(collocation, path._replace(controls=path.controls + u)).sharpen()
    np.testing.assert_allclose(found.path.controls, 1.0 if minimum else 0.0, atol=1e-7)
    curvature = found.least_curvature()
    np.testing.assert_allclose(curvature, 4 / found.collocation.barrier if minimum else -2.0, rtol=1e-6)


def test_what_has_no_inequalities_is_sharp_already():
    collocation = posed(Limited, 0.0, intervals=2)
    found = solve_near(collocation, still(collocation))
    assert found.sharpen() is found
    assert np.max(found.violations()) == 0


@pytest.mark.parametrize("barrier", [1e-8, 1.0])
def test_slack_and_multiplier(barrier):
    s = jnp.linspace(-10.0, 10.0, 201)
    found = [np.asarray(one(s, jnp.asarray(barrier))) for one in (slack, multiplier)]
    np.testing.assert_allclose(found[0] - found[1], s, atol=1e-14)
    # The smaller one is as exact as the larger one.
    np.testing.assert_allclose(found[0] * found[1], barrier, atol=1e-13)
    assert min(np.min(part) for part in found) > 0


def test_derivatives_against_differences():
    collocation = posed(LimitedForce, 4.5, intervals=2)
    random = np.random.default_rng(0)
    y, along = random.normal(size=(2, collocation.size))
    expected = slope(lambda s: collocation.residual(y + s * along, 0.0), 0.0, 1e-5, points=2)
    np.testing.assert_allclose(collocation.jacobian(y, 0.0)[0] @ along, expected, atol=1e-8)


def test_a_smaller_barrier_where_newton_does_not_come_to_a_larger_one(monkeypatch):
    def fails_above(collocation, y, parameter):
        if collocation.barrier > 2e-5:
            raise DesignError("too large")
        return newton(collocation, y, parameter)

    newton = module.newton
    monkeypatch.setattr(module, "newton", fails_above)
    collocation = posed(LimitedForce, 4.5)
    found = solve_near(collocation, still(collocation))
    np.testing.assert_allclose(found.collocation.barrier, 1e-5)
    assert np.max(np.abs(found.collocation.residual(found.y, 0.0))) < 1e-9
    # Nothing is to be found without inequalities, because there is no barrier to make smaller.
    free = posed(Limited, 0.0)
    monkeypatch.setattr(module, "newton", lambda *arguments: fails_above(collocation, *arguments[1:]))
    with pytest.raises(DesignError, match="too large"):
        solve_near(free, still(free))
