"""Runs of the Adams method: its work and accuracy on DETEST, and how it starts."""

import functools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from scipy.integrate import solve_ivp

from jaxball.paper.reproduce.experiments import Counter, CountingSolver
from jaxball.simulation.solvers import Adams, AdamsController, MassMatrixTerm
from tests.solvers import detest
from tests.solvers.linear_fields import oscillator
from tests.support.sentences import refuses

TIGHT = AdamsController(rtol=1e-10, atol=1e-10)
FIELD = jax.jit(detest.field)

START = {"y": jnp.array([1.0, 0.0]), "v": jnp.array([0.0, 1.0])}


def solve(field, t1, y0, controller=TIGHT, solver=None, t0=0.0, **options):
    solver, options = Adams() if solver is None else solver, {"max_steps": 10_000} | options
    return diffrax.diffeqsolve(
        diffrax.ODETerm(field), solver, t0, t1, options.pop("dt0", None), y0, stepsize_controller=controller, **options
    )


class TestDetest:
    """Its norm is the largest component, which zeros in addition do not change."""

    @staticmethod
    @functools.cache
    def program():
        @jax.jit
        def run(index, y0, tolerance):
            controller = AdamsController(tolerance, tolerance, optx.max_norm)
            options = {"max_steps": 4000, "adjoint": diffrax.ForwardMode(), "args": index}
            solution = solve(detest.field, detest.END, y0, controller, **options)
            return solution.ys[0], solution.stats["num_accepted_steps"], solution.stats["num_rejected_steps"]

        return run

    def run(self, name, tolerance):
        y, accepted, rejected = self.program()(detest.NAMES.index(name), detest.start(name), tolerance)
        return np.asarray(y), 2 * int(accepted) + 2 * int(rejected) + 2

    @pytest.mark.thorough
    @pytest.mark.parametrize("name", detest.NAMES)
    def test_evaluations_are_about_those_of_the_published_code(self, name):
        """Two are of the choice of the first step, and two of each attempt, of which the code does one if it fails."""
        for tolerance, published in detest.EVALUATIONS.items():
            _, evaluations = self.run(name, tolerance)
            assert 0.8 < evaluations / published[detest.NAMES.index(name)] < 1.3

    def test_evaluations_of_all_together(self):
        for tolerance, published in detest.EVALUATIONS.items():
            evaluations = sum(self.run(name, tolerance)[1] for name in detest.NAMES)
            assert 0.9 < evaluations / sum(published) < 1.15

    @pytest.mark.thorough
    def test_fewer_evaluations_than_dopri8(self):
        counter = Counter()
        solver = CountingSolver(diffrax.Dopri8(), counter)
        controller = diffrax.PIDController(1e-10, 1e-10, optx.max_norm)
        for name in ("B5", "C1", "D1", "D3", "E2"):
            y0, index, before = jnp.asarray(detest.start(name)), jnp.asarray(detest.NAMES.index(name)), counter.read()
            solution = solve(detest.field, detest.END, y0, controller, solver, args=index)
            jax.block_until_ready(solution.ys)
            assert self.run(name, 1e-10)[1] < 0.8 * (counter.read() - before), name

    @pytest.mark.thorough
    @pytest.mark.parametrize("name", detest.NAMES)
    def test_agrees_with_lsoda(self, name):
        """Orbits that come near to their centre multiply errors by some thousands."""

        index = detest.NAMES.index(name)
        rates = lambda t, y: np.asarray(FIELD(t, y, index))  # noqa: E731
        truth = solve_ivp(rates, (0.0, detest.END), detest.start(name), method="LSODA", rtol=1e-12, atol=1e-12)
        for tolerance in detest.EVALUATIONS:
            y, _ = self.run(name, tolerance)
            assert np.max(np.abs(y - truth.y[:, -1])) < 5e3 * tolerance


class TestOneRun:
    @pytest.mark.thorough
    def test_starts_with_short_steps_that_double(self):
        solution = solve(oscillator, 20.0, START, saveat=diffrax.SaveAt(steps=True))
        lengths = np.diff(solution.ts[:8], prepend=0.0)
        assert lengths[0] < 1e-4
        np.testing.assert_allclose(lengths[1:] / lengths[:-1], 2, rtol=1e-6)

    @pytest.mark.thorough
    def test_a_step_is_two_evaluations(self):
        count = []

        def field(t, y, args):
            jax.debug.callback(lambda: count.append(1))
            return oscillator(t, y, args)

        solution = solve(field, 5.0, START, dt0=1e-5)
        jax.effects_barrier()
        assert len(count) == 2 * solution.stats["num_steps"]

    @pytest.mark.thorough
    def test_with_one_point(self):
        """It is the method of Heun then."""
        loose = AdamsController(rtol=1e-6, atol=1e-6)
        y = solve(oscillator, 3.0, START, loose, Adams(max_order=1)).ys["y"][0]
        error = np.max(np.abs(y - np.array([np.cos(3.0), np.sin(3.0)])))
        assert 1e-8 < error < 1e-4


def test_a_mass_matrix_is_refused():
    term = MassMatrixTerm(lambda t, y, args: y, np.array([1.0, 0.0]))
    with refuses(TypeError, "solver"):
        diffrax.diffeqsolve(term, Adams(), 0.0, 1.0, None, jnp.ones(2), stepsize_controller=TIGHT)
