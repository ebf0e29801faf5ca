"""Runs of the numerical differentiation formulas: their work beside that of other codes, and algebraic variables."""

import functools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from comparison.problems import ALL
from scipy.integrate import solve_ivp

from jaxball.simulation.solvers import (
    NDF,
    FixedPoint,
    MassMatrixTerm,
    NDFController,
    RadauIIA,
    stages,
)
from jaxball.simulation.solvers.multistep import controller_class
from tests.solvers.solving import TURN, solve

STIFF = ("robertson", "van-der-pol", "hires", "orego")
TOLERANCES = (1e-4, 1e-5, 1e-6)


def rates(name):
    problem = ALL[name]
    g = problem.right_hand_side(problem.pieces[0])
    return lambda t, x, functions: g(t, list(x), (), functions)


@functools.cache
def program(name, make):
    problem, solver, f = ALL[name], make(), rates(name)

    @jax.jit
    def run(rtol):
        field = lambda t, x, args: jnp.stack(f(t, x, jnp))  # noqa: E731
        controller = controller_class(solver)(rtol=rtol, atol=rtol * problem.atol_over_rtol)
        x0 = jnp.asarray(problem.initial)
        solution = solve(field, solver, x0, problem.end, stepsize_controller=controller, max_steps=10_000)
        return solution.ys[0], solution.stats["num_accepted_steps"]

    return run


@pytest.fixture
def factorisations(monkeypatch):
    """An entry for each time that matrices were factorised."""
    count = []

    def counted(inverses, *matrices):
        jax.debug.callback(lambda: count.append(1))
        return inverses(*matrices)

    for name in ("inverses", "complex_inverses"):
        monkeypatch.setattr(stages, name, functools.partial(counted, getattr(stages, name)))
    return count


@pytest.mark.long
@pytest.mark.parametrize("name", STIFF)
def test_fewer_factorisations_than_radau(name, factorisations):
    """Calls are compared, one of Radau IIA being of a real and a complex matrix."""
    calls = {}
    for make in (NDF, RadauIIA):
        run = program.__wrapped__(name, make)
        for rtol in TOLERANCES:
            factorisations.clear()
            jax.block_until_ready(run(rtol))
            jax.effects_barrier()
            calls[make, rtol] = len(factorisations)
    for rtol in TOLERANCES:
        assert 0 < calls[NDF, rtol] < 0.9 * calls[RadauIIA, rtol]


@pytest.mark.long
@pytest.mark.parametrize("name", STIFF)
@pytest.mark.parametrize("rtol", TOLERANCES)
def test_as_many_steps_and_as_accurate_as_the_bdf_of_scipy(name, rtol):
    """And as near to LSODA, which has an accuracy of its own."""
    problem = ALL[name]
    x, steps = program(name, NDF)(rtol)
    error, f = problem.error(np.asarray(x)), rates(name)

    def scipys(method):
        solution = solve_ivp(
            lambda t, x: np.array(f(t, x, np)),
            (0.0, problem.end),
            problem.initial,
            method=method,
            rtol=rtol,
            atol=rtol * problem.atol_over_rtol,
        )
        return problem.error(solution.y[:, -1]), solution.t.size - 1

    error_of_bdf, steps_of_bdf = scipys("BDF")
    assert steps < 1.3 * steps_of_bdf
    assert error < 8 * max(error_of_bdf, scipys("LSODA")[0])


class TestAlgebraicVariables:
    @pytest.mark.long
    def test_another_component_becomes_algebraic_without_a_restart(self):
        """Five times in a run, which takes no more steps than the equation without algebraic variables."""
        start, end, tolerance = jnp.array([1.0, 0.0]), 7.0, 1e-9
        saveat = diffrax.SaveAt(t1=True, steps=True)
        solution = jax.jit(lambda x0: solve(TURN, NDF(), x0, end, tolerance, saveat=saveat))(start)
        ode = solve(lambda t, x, args: jnp.stack([-x[1], x[0]]), NDF(), start, end, tolerance)
        assert solution.stats["num_steps"] < 1.1 * ode.stats["num_steps"]
        taken = np.isfinite(solution.ts)
        t, x = np.asarray(solution.ts)[taken], np.asarray(solution.ys)[taken]
        np.testing.assert_allclose(x, np.stack([np.cos(t), np.sin(t)], axis=1), rtol=0, atol=500 * tolerance)
        np.testing.assert_allclose(np.linalg.norm(x, axis=1), 1, rtol=0, atol=tolerance)

    def test_slopes_that_a_matrix_gives(self):
        """Those with which a run starts: M v = g where it has a solution, without an algebraic part."""
        M = np.array([[2.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 0.0]])
        _, mass = MassMatrixTerm(lambda t, x, args: x, M).at_step(0.0, jnp.zeros(3), None)
        np.testing.assert_allclose(mass.rates(jnp.array([3.0, 0.0, 5.0])), [2.0, -1.0, 0.0], rtol=0, atol=1e-15)


@pytest.mark.thorough
def test_by_fixed_point_iteration():
    """Where the problem is not stiff, no Jacobian is needed."""
    field = lambda t, y, args: jnp.stack([y[1], -jnp.sin(y[0])])  # noqa: E731
    solution = solve(field, NDF(root_finder=FixedPoint()), jnp.array([1.0, 0.0]), 5.0, 1e-8)
    truth = solve_ivp(lambda t, y: [y[1], -np.sin(y[0])], (0.0, 5.0), [1.0, 0.0], rtol=1e-12, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(solution.ys[0], truth, rtol=0, atol=1e-6)


@pytest.mark.thorough
def test_float32_on_a_stiff_problem():
    with jax.enable_x64(False):
        field, controller = lambda t, x, args: -1e3 * (x - jnp.cos(t)), NDFController(1e-4, 1e-4, optx.max_norm)
        solution = solve(field, NDF(), jnp.zeros(1), 2.0, stepsize_controller=controller)
    assert solution.ys.dtype == jnp.float32
    np.testing.assert_allclose(solution.ys[0, 0], np.cos(2.0) + 1e-3 * np.sin(2.0), rtol=0, atol=2e-4)
