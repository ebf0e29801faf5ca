"""Minima known in closed form, smooth and not, and constrained problems with published solutions."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.design import Bounds, DesignSpace, Evaluation, Optimiser, Problem, Settings, Variable, Worth, bfgs


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


@pytest.mark.parametrize(
    ("function", "minimum", "bound"),
    [(rosenbrock, (1.0, 1.0), 1e-6), (ridge, (0.0, 0.0), 1e-6), (walled, (0.9, 0.0), 1e-7)],
    ids=["rosenbrock", "kink", "wall"],
)
def test_minimum_from_every_start(function, minimum, bound):
    found = bfgs.minimise(function, STARTS, 300, 1e-9)
    np.testing.assert_allclose(found.z, np.broadcast_to(minimum, STARTS.shape), atol=bound)


def test_starts_do_not_know_of_each_other():
    alone = [bfgs.minimise(rosenbrock, start[None], 40, 1e-9).z[0] for start in STARTS]
    np.testing.assert_array_equal(bfgs.minimise(rosenbrock, STARTS, 40, 1e-9).z, alone)


def test_quadratic_in_few_evaluations():
    A = np.diag([1.0, 10.0, 100.0, 1000.0])
    count = []

    def function(z):
        count.append(1)
        return 0.5 * np.einsum("si,ij,sj->s", z, A, z), z @ A

    found = bfgs.minimise(function, np.ones((1, 4)), 200, 1e-8)
    assert np.max(np.abs(found.z)) < 1e-7
    assert len(count) < 60


class Box(DesignSpace):
    """1 ≤ x ≤ 5."""

    def __init__(self):
        self.variables = (Variable(("x",)),) * 4
        self.bounds = Bounds(np.full(4, 1.0), np.full(4, 5.0), np.full(4, 2.0))
        self.start = self.bounds.variables(np.array([1.0, 5.0, 5.0, 1.0]))


class HockSchittkowski71(Problem):
    """min x1 x4 (x1 + x2 + x3) + x3 with x1 x2 x3 x4 ≥ 25, Σ x² = 40, 1 ≤ x ≤ 5; its minimum is 17.0140173."""

    weights = np.ones(1)  # pyright: ignore[reportAssignmentType]
    shares = np.ones(3)  # pyright: ignore[reportAssignmentType]

    def __init__(self):
        super().__init__(Box(), {}, {})

    def evaluate(self, z, adjoint=None):
        x = self.space.numbers(z)
        objective = x[0] * x[3] * (x[0] + x[1] + x[2]) + x[2]
        square = jnp.sum(x**2) - 40
        return Evaluation(objective[None], jnp.stack([25 - jnp.prod(x), square, -square]), jnp.asarray(0))


def test_constrained_problem_71_of_hock_and_schittkowski():
    settings = Settings(starts=5, steps=20, polished=2, rounds=30, evaluations=200, tolerance=1e-6, stationary=1e-7)
    optimiser = Optimiser(HockSchittkowski71(), settings)
    found = optimiser.run(optimiser.begin(), lambda progress: None)
    assert found.z.shape == (2, 4)
    assert found.worth.violation < 1e-6
    assert abs(found.worth.objective - 17.0140173) < 1e-4
    x = optimiser.problem.space.numbers(jnp.asarray(found.best))
    np.testing.assert_allclose(x, [1.0, 4.742999, 3.821151, 1.379408], atol=1e-4)


@pytest.mark.parametrize(
    ("one", "other", "better"),
    [
        (Worth(1.0, 0.0, 0.0), Worth(2.0, 0.0, 0.0), True),
        (Worth(1.0, 0.5, 0.0), Worth(2.0, 0.0, 0.0), False),
        (Worth(9.0, 1e-5, 0.0), Worth(2.0, 0.3, 0.0), True),
        (Worth(float("nan"), 0.0, 0.0), Worth(2.0, 0.3, 0.0), False),
        (Worth(0.0, float("nan"), 0.0), Worth(2.0, 0.3, 0.0), False),
    ],
)
def test_which_design_is_better(one, other, better):
    assert one.better_than(other, 1e-4) is better
