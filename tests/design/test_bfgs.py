"""Minima known in closed form, smooth and not, and constrained problems with published solutions."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.studies.design import Settings
from jaxball.studies.design.problem.problem import ConstraintLayout, Evaluation
from jaxball.studies.design.problem.space import Bounds
from jaxball.studies.design.search.optimise import Merit, Optimiser, bfgs, newton
from jaxball.studies.design.search.program import (
    METHODS,
    AbstractProgram,
    AbstractTerms,
    Multipliers,
    augmented_lagrangian,
    by_gauss_newton,
)


def rosenbrock(z):
    x, y = z[:, 0], z[:, 1]
    value = (1 - x) ** 2 + 100 * (y - x**2) ** 2
    return value, np.stack([-2 * (1 - x) - 400 * x * (y - x**2), 200 * (y - x**2)], axis=1)


def ridge(z):
    """|x| + y² has its minimum on its own kink."""
    x, y = z[:, 0], z[:, 1]
    return np.abs(x) + y**2, np.stack([np.sign(x), 2 * y], axis=1)


def walled(z):
    """Not finite beyond x = 1, with the minimum at 0.9."""
    x = z[:, 0]
    value = np.where(x < 1, (x - 0.9) ** 2 + z[:, 1] ** 2, np.nan)
    return value, np.stack([2 * (x - 0.9), 2 * z[:, 1]], axis=1)


STARTS = np.array([[-1.2, 1.0], [0.0, 0.0], [0.7, -2.0]])


def curved(z):
    """Rosenbrock's function with its Hessian."""
    x, y = z[:, 0], z[:, 1]
    mixed = -400 * x
    rows = [np.stack([2 - 400 * (y - 3 * x**2), mixed], axis=1), np.stack([mixed, np.full_like(x, 200)], axis=1)]
    return *rosenbrock(z), np.stack(rows, axis=1)


def saddle(z):
    """x⁴ − x² + y², which has a saddle at 0 and minima at x = ±√½; not finite beyond x = 2."""
    x, y = z[:, 0], z[:, 1]
    zero = np.zeros_like(x)
    rows = [np.stack([12 * x**2 - 2, zero], axis=1), np.stack([zero, zero + 2], axis=1)]
    value = np.where(x < 2, x**4 - x**2 + y**2, np.nan)
    return value, np.stack([4 * x**3 - 2 * x, 2 * y], axis=1), np.stack(rows, axis=1)


@pytest.mark.parametrize(
    ("function", "minimum"), [(curved, (1.0, 1.0)), (saddle, (np.sqrt(0.5), 0.0))], ids=["rosenbrock", "saddle"]
)
def test_minimum_by_newtons_method(function, minimum):
    starts = np.array([[0.01, 1.0], [1.9, 0.0], [0.7, -2.0]])
    found = newton(function, starts, 60, 1e-10)
    np.testing.assert_allclose(found.y, np.broadcast_to(minimum, starts.shape), atol=1e-9)


@pytest.mark.parametrize(
    ("function", "minimum", "bound"),
    [(rosenbrock, (1.0, 1.0), 1e-6), (ridge, (0.0, 0.0), 1e-6), (walled, (0.9, 0.0), 1e-7)],
    ids=["rosenbrock", "kink", "wall"],
)
def test_minimum_from_every_start(function, minimum, bound):
    found = bfgs(function, STARTS, 300, 1e-9)
    np.testing.assert_allclose(found.y, np.broadcast_to(minimum, STARTS.shape), atol=bound)


def test_starts_do_not_know_of_each_other():
    alone = [bfgs(rosenbrock, start[None], 40, 1e-9).y[0] for start in STARTS]
    np.testing.assert_array_equal(bfgs(rosenbrock, STARTS, 40, 1e-9).y, alone)


def test_quadratic_in_few_evaluations():
    A = np.diag([1.0, 10.0, 100.0, 1000.0])
    count = []

    def function(z):
        count.append(1)
        return 0.5 * np.einsum("si,ij,sj->s", z, A, z), z @ A

    found = bfgs(function, np.ones((1, 4)), 200, 1e-8)
    assert np.max(np.abs(found.y)) < 1e-7
    assert len(count) < 60


class HockSchittkowski71(AbstractTerms, AbstractProgram):
    """min x1 x4 (x1 + x2 + x3) + x3 with x1 x2 x3 x4 ≥ 25, Σ x² = 40, 1 ≤ x ≤ 5; its minimum is 17.0140173."""

    bounds = Bounds(np.full(4, 1.0), np.full(4, 5.0), np.full(4, 2.0))
    weights = np.ones(1)  # pyright: ignore[reportAssignmentType]
    layout = ConstraintLayout({"product": 1, "sphere": 1})
    equal = np.array([False, True])
    names = ("x1", "x2", "x3", "x4")

    def starts(self, settings):
        others = np.random.default_rng(settings.seed).uniform(1.0, 5.0, (settings.starts - 1, 4))
        return np.stack([self.bounds.variables(x) for x in np.array([[1.0, 5.0, 5.0, 1.0], *others])])

    def numbers(self, y):
        return self.bounds.numbers(y)

    def simulate(self, numbers, adjoint=None):
        return numbers

    def assess(self, runs):
        x = runs
        objective = x[0] * x[3] * (x[0] + x[1] + x[2]) + x[2]
        return Evaluation(objective[None], jnp.stack([25 - jnp.prod(x), jnp.sum(x**2) - 40]), jnp.asarray(0))


@functools.cache
def hock_schittkowski_71():
    return HockSchittkowski71()


@pytest.mark.thorough
@pytest.mark.parametrize("method", METHODS)
def test_constrained_problem_71_of_hock_and_schittkowski(method):
    settings = Settings(
        starts=5, steps=20, polished=2, rounds=30, evaluations=200, tolerance=1e-6, stationary=1e-7, method=method
    )
    program = hock_schittkowski_71()
    optimiser = Optimiser(program, settings)
    found = optimiser.run(optimiser.begin(), lambda progress: None)
    assert found.y.shape == (2, 4)
    assert found.merit.violation < 1e-6
    assert abs(found.merit.objective - 17.0140173) < 1e-4
    x = program.numbers(jnp.asarray(found.best))
    np.testing.assert_allclose(x, [1.0, 4.742999, 3.821151, 1.379408], atol=1e-4)


class Parabola(AbstractTerms, AbstractProgram):
    """min (x − 3)² with x ≤ 1, from x = 0."""

    weights = np.ones(1)  # pyright: ignore[reportAssignmentType]
    layout = ConstraintLayout({"wall": 1})
    equal = np.array([False])
    names = ("x",)

    def starts(self, settings):
        return np.zeros((settings.starts, 1))

    def numbers(self, y):
        return y

    def simulate(self, numbers, adjoint=None):
        return numbers

    def assess(self, runs):
        return Evaluation((runs - 3) ** 2, runs - 1, jnp.asarray(0))


@pytest.mark.parametrize(("rate", "chosen"), [(2.0, 2.0), (10.0, 0.0)], ids=["where it came to", "where it was"])
def test_a_start_that_goes_far_is_polished_from_where_the_augmented_lagrangian_is_less(rate, chosen):
    """The first step of Adam is as long as its rate. (x − 3)² + ρ/2 max(0, x − 1)² is 9 at 0, 6 at 2, and 454 at 10."""
    optimiser = Optimiser(Parabola(), Settings(starts=1, steps=1, learning_rate=rate, penalty=10.0))
    progress = optimiser.advance(optimiser.begin())
    assert progress.phase == "polish"
    np.testing.assert_allclose(progress.y, [[chosen]], atol=1e-6)


@pytest.mark.long
def test_the_gauss_newton_hessian_is_exact_where_the_run_is_linear():
    """Beside that of JAX, of what is not taken apart: bounds, products, and places that are pushed or not."""
    program, y = hock_schittkowski_71(), jnp.asarray([0.3, 1.0, -0.4, 0.8])
    multipliers = Multipliers(jnp.asarray([2.0, -0.7]), jnp.asarray(3.0), jnp.asarray([0.1, 0.0]))
    both = jax.tree.map(lambda x: jnp.stack([x, x]), (y, multipliers))  # as many as the search has
    found = by_gauss_newton(program)(*both)

    def lagrangian(y):
        return augmented_lagrangian(program, program.evaluate(y), multipliers)

    np.testing.assert_allclose(found.gradient[0], jax.grad(lagrangian)(y), rtol=1e-12)
    np.testing.assert_allclose(found.hessian[0], jax.hessian(lagrangian)(y), rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize(
    ("one", "other", "better"),
    [
        (Merit(1.0, 0.0, 0.0), Merit(2.0, 0.0, 0.0), True),
        (Merit(1.0, 0.5, 0.0), Merit(2.0, 0.0, 0.0), False),
        (Merit(9.0, 1e-5, 0.0), Merit(2.0, 0.3, 0.0), True),
        (Merit(float("nan"), 0.0, 0.0), Merit(2.0, 0.3, 0.0), False),
        (Merit(0.0, float("nan"), 0.0), Merit(2.0, 0.3, 0.0), False),
    ],
)
def test_which_design_is_better(one, other, better):
    assert one.better_than(other, 1e-4) is better
