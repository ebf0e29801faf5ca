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
    StepToKinks,
    SwitchingMassMatrixTerm,
    explain,
    stages,
)
from jaxball.simulation.solvers.multistep import controller_class

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
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(lambda t, x, args: jnp.stack(f(t, x, jnp))),
            solver,
            0.0,
            problem.end,
            None,
            jnp.asarray(problem.initial),
            stepsize_controller=controller_class(solver)(rtol=rtol, atol=rtol * problem.atol_over_rtol),
            max_steps=10_000,
            adjoint=diffrax.ForwardMode(),
        )
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


def turning(start, t1, tolerance):
    """(cos t, sin t) with |x| = 1 for the rate of the larger component."""

    def field(t, x, args, component):
        rates = jnp.stack([-x[1], x[0]])
        return jnp.where(jnp.arange(2) == component, jnp.sum(x * x) - 1.0, rates)

    term = SwitchingMassMatrixTerm(
        field,
        mass=lambda component: jnp.where(jnp.arange(2) == component, 0.0, 1.0),
        choose=lambda t, x, args: jnp.argmax(jnp.abs(x)),
    )
    return diffrax.diffeqsolve(
        term,
        NDF(),
        0.0,
        t1,
        None,
        start,
        stepsize_controller=NDFController(tolerance, tolerance),
        adjoint=diffrax.ForwardMode(),
        saveat=diffrax.SaveAt(t1=True, steps=True),
    )


class TestAlgebraicVariables:
    @pytest.mark.long
    def test_another_component_becomes_algebraic_without_a_restart(self):
        """Five times in a run, which takes no more steps than the equation without algebraic variables."""
        start, end, tolerance = jnp.array([1.0, 0.0]), 7.0, 1e-9
        solution = jax.jit(turning, static_argnums=(1, 2))(start, end, tolerance)
        ode = diffrax.diffeqsolve(
            diffrax.ODETerm(lambda t, x, args: jnp.stack([-x[1], x[0]])),
            NDF(),
            0.0,
            end,
            None,
            start,
            stepsize_controller=NDFController(tolerance, tolerance),
        )
        assert solution.stats["num_steps"] < 1.1 * ode.stats["num_steps"]
        taken = np.isfinite(solution.ts)
        t, x = np.asarray(solution.ts)[taken], np.asarray(solution.ys)[taken]
        np.testing.assert_allclose(x, np.stack([np.cos(t), np.sin(t)], axis=1), rtol=0, atol=500 * tolerance)
        np.testing.assert_allclose(np.linalg.norm(x, axis=1), 1, rtol=0, atol=tolerance)

    @pytest.mark.thorough
    def test_full_singular_matrix(self):
        """With u = x₁ + x₂ and v = x₁ − x₂: u̇ = −u and 0 = v − sin t, both in both equations."""

        def mixed(t, x, args):
            u, v = x[0] + x[1], x[0] - x[1]
            return jnp.stack([-u + 3.0 * (v - jnp.sin(t)), -u - 3.0 * (v - jnp.sin(t))])

        solution = diffrax.diffeqsolve(
            MassMatrixTerm(mixed, np.ones((2, 2))),
            NDF(),
            0.0,
            2.0,
            None,
            jnp.array([0.5, 0.5]),
            stepsize_controller=NDFController(1e-9, 1e-9),
        )
        # M ẋ = (u̇, u̇)
        u, v = np.exp(-2.0), np.sin(2.0)
        np.testing.assert_allclose(solution.ys[0], [(u + v) / 2, (u - v) / 2], rtol=0, atol=1e-7)

    @pytest.mark.thorough
    def test_algebraic_variable_that_jumps(self):
        """ẏ = −z with 0 = z − y before t = 1 and 0 = z − 2y after it, from where all starts at order 1."""

        def balance(t, x, args):
            return {"y": -x["z"], "z": x["z"] - jnp.where(t < 1.0, 1.0, 2.0) * x["y"]}

        times = np.array([0.3, 0.999, 1.001, 2.0])
        solution = diffrax.diffeqsolve(
            MassMatrixTerm(balance, {"y": 1.0, "z": 0.0}),
            NDF(),
            0.0,
            2.0,
            None,
            {"y": jnp.asarray(1.0), "z": jnp.asarray(1.0)},
            saveat=diffrax.SaveAt(ts=times),
            stepsize_controller=StepToKinks(NDFController(1e-9, 1e-9), [1.0]),
        )
        y = np.where(times < 1.0, np.exp(-times), np.exp(1.0 - 2.0 * times))
        np.testing.assert_allclose(solution.ys["y"], y, rtol=0, atol=1e-7)
        np.testing.assert_allclose(solution.ys["z"], np.where(times < 1.0, y, 2.0 * y), rtol=0, atol=2e-7)

    def test_slopes_that_a_matrix_gives(self):
        """Those with which a run starts: M v = g where it has a solution, without an algebraic part."""
        M = np.array([[2.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 0.0]])
        _, mass = MassMatrixTerm(lambda t, x, args: x, M).at_step(0.0, jnp.zeros(3), None)
        np.testing.assert_allclose(mass.rates(jnp.array([3.0, 0.0, 5.0])), [2.0, -1.0, 0.0], rtol=0, atol=1e-15)

    @pytest.mark.long
    def test_inconsistent_start_and_index_two(self):
        for field, x0, sentence in (
            (lambda t, x: [-x[0] + x[1], x[0] + x[1] - jnp.sin(t)], [0.0, 1.0], "initial values do not satisfy"),
            (lambda t, x: [x[1], x[0] - t], [0.0, 1.0], "equations do not determine the step"),
        ):
            solution = diffrax.diffeqsolve(
                MassMatrixTerm(lambda t, x, args, field=field: jnp.stack(field(t, x)), np.array([1.0, 0.0])),
                NDF(),
                0.0,
                1.0,
                None,
                jnp.asarray(x0),
                stepsize_controller=NDFController(1e-8, 1e-8),
                throw=False,
            )
            assert sentence in explain(solution.result)


@pytest.mark.thorough
def test_by_fixed_point_iteration():
    """Where the problem is not stiff, no Jacobian is needed."""
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(lambda t, y, args: jnp.stack([y[1], -jnp.sin(y[0])])),
        NDF(root_finder=FixedPoint()),
        0.0,
        5.0,
        None,
        jnp.array([1.0, 0.0]),
        stepsize_controller=NDFController(1e-8, 1e-8),
    )
    truth = solve_ivp(lambda t, y: [y[1], -np.sin(y[0])], (0.0, 5.0), [1.0, 0.0], rtol=1e-12, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(solution.ys[0], truth, rtol=0, atol=1e-6)


@pytest.mark.thorough
def test_float32_on_a_stiff_problem():
    with jax.enable_x64(False):
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(lambda t, x, args: -1e3 * (x - jnp.cos(t))),
            NDF(),
            0.0,
            2.0,
            None,
            jnp.zeros(1),
            stepsize_controller=NDFController(1e-4, 1e-4, optx.max_norm),
        )
    assert solution.ys.dtype == jnp.float32
    np.testing.assert_allclose(solution.ys[0, 0], np.cos(2.0) + 1e-3 * np.sin(2.0), rtol=0, atol=2e-4)
