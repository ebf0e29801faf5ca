"""M ẋ = g(t, x): problems with closed solutions, consistent initial values, and which solvers refuse.

The paper's own differential-algebraic equation is in ``test_dae_of_the_ball``.
"""

import functools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

from jaxball.simulation.solvers import (
    NDF,
    TRBDF2,
    FixedPoint,
    Gauss,
    MassMatrixTerm,
    RadauIIA,
    SimplifiedNewton,
    StepToKinks,
    Trapezoidal,
    consistent_initial_values,
    explain,
)
from jaxball.simulation.solvers.multistep import controller_class
from tests.solvers import solving
from tests.solvers.solving import BALANCE, MIXED, TURN, mixed
from tests.support.sentences import refuses, said


def solve(term, x0, end, *, solver=None, tolerance=1e-11, kinks=None, **options):
    solver = RadauIIA(5) if solver is None else solver
    controller = controller_class(solver)(rtol=tolerance, atol=tolerance)
    controller = controller if kinks is None else StepToKinks(controller, kinks)
    return solving.solve(term, solver, x0, end, stepsize_controller=controller, throw=False, **options)


def at_end(solution):
    assert not explain(solution.result)
    return jax.tree.map(lambda leaf: np.asarray(leaf[-1]), solution.ys)


TIMES = (0.3, 0.999, 1.001, 1.4, 2.0)


@functools.partial(jax.jit, static_argnums=(1, 2))
def balanced(kinks, solver=None, tolerance=1e-11):
    saveat = diffrax.SaveAt(ts=jnp.asarray(TIMES))
    return solve(BALANCE, {"y": 1.0, "z": 1.0}, 2.0, solver=solver, tolerance=tolerance, kinks=kinks, saveat=saveat)


ORDER_TWO = (Trapezoidal(), TRBDF2())
# Each with its tolerance and a bound on its errors.
METHODS = {
    "radau 5": (RadauIIA(5), 1e-11, 1e-11),
    "trapezoidal": (Trapezoidal(), 1e-8, 2e-6),
    "tr-bdf2": (TRBDF2(), 1e-8, 2e-6),
    "ndf": (NDF(), 1e-9, 1e-7),
}


@pytest.mark.thorough
@pytest.mark.parametrize(("solver", "tolerance", "bound"), METHODS.values(), ids=METHODS.keys())
class TestEveryMethod:
    def test_singular_matrix_that_is_not_diagonal(self, solver, tolerance, bound):
        """Within steps as well: of algebraic variables the equations contain no derivative."""
        t = np.linspace(0.05, 2.0, 40)
        saveat = diffrax.SaveAt(ts=jnp.asarray(t))
        solution = solve(MIXED, np.array([0.5, 0.5]), 2.0, solver=solver, tolerance=tolerance, saveat=saveat)
        assert not explain(solution.result)
        difference, total = solution.ys[:, 0] - solution.ys[:, 1], solution.ys[:, 0] + solution.ys[:, 1]
        np.testing.assert_allclose(difference, np.sin(t), rtol=0, atol=bound)
        np.testing.assert_allclose(total, np.exp(-t), rtol=0, atol=bound)
        np.testing.assert_allclose(difference[-1], np.sin(2.0), rtol=0, atol=1e-9)

    def test_algebraic_variable_that_jumps(self, solver, tolerance, bound):
        """Both are e^−t at first; then y = e^−1 e^−2(t − 1) and z = 2y."""
        t = np.asarray(TIMES)
        y = np.where(t < 1.0, np.exp(-t), np.exp(1.0 - 2.0 * t))
        solution = balanced(jnp.asarray([1.0]), solver, tolerance)
        assert not explain(solution.result)
        np.testing.assert_allclose(solution.ys["y"], y, rtol=0, atol=bound)
        np.testing.assert_allclose(solution.ys["z"], np.where(t < 1.0, y, 2.0 * y), rtol=0, atol=2 * bound)
        np.testing.assert_allclose(solution.ys["z"][-1], 2.0 * solution.ys["y"][-1], rtol=0, atol=1e-9)


class TestClosedSolutions:
    @pytest.mark.thorough
    def test_steps_to_the_jump_spare_the_search_for_it(self):
        stepped, searched = balanced(jnp.asarray([1.0])), balanced(jnp.asarray([-1.0]))
        np.testing.assert_allclose(at_end(searched)["y"], np.exp(-3.0), rtol=0, atol=1e-9)
        assert searched.stats["num_steps"] > 2 * stepped.stats["num_steps"]

    @pytest.mark.thorough
    def test_regular_matrix(self):
        """M ẋ = A x is ẋ = M⁻¹A x, whose solution is exp(M⁻¹A t) x₀."""
        random = np.random.default_rng(44)
        A, M = random.normal(size=(2, 4, 4))
        M = M + 4.0 * np.eye(4)
        x0 = random.normal(size=4)
        expected = scipy.linalg.expm(3.0 * np.linalg.solve(M, A)) @ x0

        def field(t, x, args):
            return jnp.sum(A * x[None], axis=1)

        x = at_end(solve(MassMatrixTerm(field, M), x0, 3.0))
        np.testing.assert_allclose(x, expected, rtol=0, atol=1e-10)

    @pytest.mark.thorough
    def test_diagonal_of_any_structure(self):
        """Masses 2 and 4 with forces −6p and −4q decay at the rates 3 and 1; leaves broadcast.

        What s is the sum of are three numbers, each of them with an error.
        """

        def field(t, x, args):
            p, q = x["a"]
            return {"a": (-6.0 * p, -4.0 * q), "s": x["s"] - jnp.sum(p) - q}

        start = {"a": (jnp.asarray([1.0, 2.0]), jnp.asarray(5.0)), "s": jnp.asarray(8.0)}
        term = MassMatrixTerm(field, {"a": (2.0, 4.0), "s": 0.0})
        x = at_end(solve(term, start, 1.0))
        p, q = np.array([1.0, 2.0]) * np.exp(-3.0), 5.0 * np.exp(-1.0)
        np.testing.assert_allclose(x["a"][0], p, rtol=0, atol=1e-11)
        np.testing.assert_allclose(x["a"][1], q, rtol=0, atol=1e-11)
        np.testing.assert_allclose(x["s"], p.sum() + q, rtol=0, atol=3e-11)


@pytest.mark.parametrize("solver", ORDER_TWO, ids=lambda solver: type(solver).__name__)
class TestMethodsOfOrderTwo:
    """With first stages that are explicit, which the equations without a derivative do not have."""

    @pytest.mark.thorough
    def test_the_equation_that_is_without_a_derivative_changes(self, solver):
        """A point turns on a circle: x² + y² = 1 determines the larger component, the other has a derivative."""
        x = at_end(solve(TURN, np.array([1.0, 0.0]), 10.0, solver=solver, tolerance=1e-8))
        np.testing.assert_allclose(x, [np.cos(10.0), np.sin(10.0)], rtol=0, atol=5e-5)

    @pytest.mark.thorough
    def test_derivative_by_the_initial_state(self, solver):
        """ẏ = −z and 0 = z − y² have y = 1/(1/y₀ + t), and so ∂y/∂y₀ = 1/(1 + y₀ t)²."""
        term = MassMatrixTerm(lambda t, x, args: jnp.stack([-x[1], x[1] - x[0] ** 2]), np.array([1.0, 0.0]))

        def end(y0):
            return solve(term, jnp.stack([y0, y0**2]), 1.0, solver=solver, tolerance=1e-8).ys[-1]

        (y, z), (dy, dz) = jax.jvp(end, (jnp.asarray(2.0),), (jnp.asarray(1.0),))
        np.testing.assert_allclose([y, z], [2 / 3, 4 / 9], rtol=0, atol=1e-5)
        np.testing.assert_allclose([dy, dz], [1 / 9, 4 / 27], rtol=0, atol=1e-5)


class TestConsistentInitialValues:
    def test_found_and_the_others_kept(self):
        found = consistent_initial_values(BALANCE, 1.5, {"y": 0.7, "z": -3.0})
        assert found.ok
        assert found.message == ""
        assert found.y["y"] == 0.7
        np.testing.assert_allclose(found.y["z"], 1.4, rtol=1e-15)

    def test_nonlinear_equation(self):
        term = MassMatrixTerm(lambda t, x, args: jnp.stack([x[1], jnp.exp(x[1]) - args * x[0]]), np.array([1.0, 0.0]))
        found = consistent_initial_values(term, 0.0, jnp.asarray([0.5, 3.0]), args=jnp.asarray(4.0))
        np.testing.assert_allclose(found.y, [0.5, np.log(2.0)], rtol=1e-15)

    def test_matrix_that_is_not_diagonal_keeps_its_product(self):
        """M x is the sum u of both, and the equation without a derivative is v = sin t."""
        found = consistent_initial_values(MIXED, 0.3, jnp.asarray([0.2, 1.0]))
        assert found.ok
        np.testing.assert_allclose(found.y, [(1.2 + np.sin(0.3)) / 2, (1.2 - np.sin(0.3)) / 2], rtol=1e-15)

    def test_index_two_is_refused(self):
        term = MassMatrixTerm(lambda t, x, args: jnp.stack([x[1], x[0] - t]), np.array([1.0, 0.0]))
        found = consistent_initial_values(term, 0.0, jnp.asarray([0.0, 0.3]))
        assert not found.ok
        said(found.message)
        np.testing.assert_array_equal(found.y, [0.0, 0.3])
        with refuses(ValueError):
            consistent_initial_values(term, 0.0, jnp.asarray([0.0, 0.3]), throw=True)

    def test_no_solution_is_no_success(self):
        term = MassMatrixTerm(lambda t, x, args: jnp.stack([x[1], x[1] ** 2 + 1.0]), np.array([1.0, 0.0]))
        found = consistent_initial_values(term, 0.0, jnp.asarray([0.0, 0.7]))
        assert not found.ok
        said(found.message)

    def test_under_vmap(self):
        @jax.vmap
        def z(y):
            found = consistent_initial_values(BALANCE, 0.0, {"y": y, "z": jnp.zeros_like(y)})
            return jnp.where(found.ok, found.y["z"], jnp.nan)

        y = jnp.asarray([0.5, 1.0, 2.0])
        np.testing.assert_allclose(z(y), y, rtol=1e-15)


class TestRefusals:
    @pytest.mark.parametrize(
        ("solver", "named"),
        [
            (diffrax.Dopri5(), "solver"),
            (diffrax.Kvaerno5(), "solver"),
            (Gauss(8), "solver"),
            (Gauss(3, root_finder=SimplifiedNewton()), "solver"),
            (Trapezoidal(root_finder=FixedPoint()), "root_finder"),
            (RadauIIA(3, root_finder=FixedPoint()), "root_finder"),
        ],
        ids=["Dopri5", "Kvaerno5", "Gauss", "Gauss with Newton", "Trapezoidal", "FixedPoint"],
    )
    def test_solvers_that_know_no_mass_matrix(self, solver, named):
        with refuses(TypeError, named):
            solve(BALANCE, {"y": 1.0, "z": 1.0}, 1.0, solver=solver)

    def test_matrix_of_another_size(self):
        with refuses(ValueError, "mass"):
            solve(MassMatrixTerm(mixed, np.eye(3)), [0.5, 0.5], 1.0)

    def test_matrix_that_is_traced(self):
        with refuses(ValueError, "mass"):
            jax.jit(lambda M: MassMatrixTerm(mixed, M))(jnp.eye(2))
