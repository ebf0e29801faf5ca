"""Runs of the Adams method: its work and accuracy, starts and jumps, and what diffrax does with a solver."""

import functools

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from scipy.integrate import solve_ivp

from jaxball.paper.reproduce.evaluations import Counter, CountingSolver
from jaxball.solvers import Adams, AdamsController, MassMatrixTerm, StepToKinks, explain
from tests.solvers import detest

TURNS = np.array([[0.0, 1.0], [-1.0, 0.0]])
TIGHT = AdamsController(rtol=1e-10, atol=1e-10)


def oscillator(t, y, args):
    """ÿ = −y for a state in two parts."""
    return {"y": y["v"], "v": -y["y"]}


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

    @pytest.mark.parametrize("name", ["B5", "C1", "D1", "D3", "E2"])
    def test_fewer_evaluations_than_dopri8(self, name):
        y0, counter = jnp.asarray(detest.start(name)), Counter()
        solver = CountingSolver(diffrax.Dopri8(), counter)
        controller = diffrax.PIDController(1e-10, 1e-10, optx.max_norm)
        solve(detest.field, detest.END, y0, controller, solver, args=detest.NAMES.index(name))
        assert self.run(name, 1e-10)[1] < 0.8 * counter.read()

    @pytest.mark.parametrize("name", detest.NAMES)
    def test_agrees_with_lsoda(self, name):
        """Orbits that come near to their centre multiply errors by some thousands."""

        def rates(t, y):
            with jax.ensure_compile_time_eval():
                return np.asarray(field(t, y))

        index = detest.NAMES.index(name)
        field = jax.jit(lambda t, y: detest.field(t, y, index))
        truth = solve_ivp(rates, (0.0, detest.END), detest.start(name), method="LSODA", rtol=1e-12, atol=1e-12)
        for tolerance in detest.EVALUATIONS:
            y, _ = self.run(name, tolerance)
            assert np.max(np.abs(y - truth.y[:, -1])) < 5e3 * tolerance


class TestOneRun:
    @staticmethod
    @functools.cache
    def solution():
        return eqx.filter_jit(lambda: solve(oscillator, 20.0, START, saveat=diffrax.SaveAt(steps=True, dense=True)))()

    def test_a_state_may_have_parts(self):
        solution = self.solution()
        t = solution.ts[np.isfinite(solution.ts)]
        y = solution.ys["y"][: t.size]
        np.testing.assert_allclose(y, np.stack([np.cos(t), np.sin(t)], axis=1), rtol=0, atol=1e-8)

    def test_dense_output_is_as_accurate_as_the_steps_and_meets_their_ends(self):
        solution = self.solution()
        t = np.linspace(0.0, 20.0, 4001)
        y = jax.vmap(solution.evaluate)(jnp.asarray(t))["y"]
        np.testing.assert_allclose(y, np.stack([np.cos(t), np.sin(t)], axis=1), rtol=0, atol=1e-8)
        ends = np.asarray(solution.ts[np.isfinite(solution.ts)])[:-1]
        before = jax.vmap(lambda t: solution.evaluate(t, left=True))(jnp.asarray(ends))["y"]
        after = jax.vmap(lambda t: solution.evaluate(t, left=False))(jnp.asarray(ends))["y"]
        np.testing.assert_allclose(before, solution.ys["y"][: ends.size], rtol=0, atol=2e-15)
        np.testing.assert_array_equal(after, solution.ys["y"][: ends.size])

    def test_starts_with_short_steps_that_double(self):
        lengths = np.diff(self.solution().ts[:8], prepend=0.0)
        assert lengths[0] < 1e-4
        np.testing.assert_allclose(lengths[1:] / lengths[:-1], 2, rtol=1e-6)

    def test_a_step_is_two_evaluations(self):
        count = []

        def field(t, y, args):
            jax.debug.callback(lambda: count.append(1))
            return oscillator(t, y, args)

        solution = solve(field, 5.0, START, dt0=1e-5)
        jax.effects_barrier()
        assert len(count) == 2 * solution.stats["num_steps"]

    def test_backwards_in_time(self):
        y = solve(oscillator, -3.0, START).ys["y"][0]
        np.testing.assert_allclose(y, [np.cos(3.0), -np.sin(3.0)], rtol=0, atol=1e-9)

    def test_goes_on_where_another_run_ended(self):
        """With the states of solver and controller the second run does not start anew."""
        kept = {"solver_state": True, "controller_state": True}
        first = solve(oscillator, 4.0, START, saveat=diffrax.SaveAt(t1=True, **kept))
        end = jax.tree.map(lambda leaf: leaf[0], first.ys)
        state = {"solver_state": first.solver_state, "controller_state": first.controller_state}
        second = solve(oscillator, 8.0, end, t0=4.0, dt0=0.05, **state)
        anew = solve(oscillator, 8.0, end, t0=4.0)
        np.testing.assert_allclose(second.ys["y"][0], [np.cos(8.0), np.sin(8.0)], rtol=0, atol=3e-9)
        assert second.stats["num_steps"] < anew.stats["num_steps"] - 10

    def test_with_one_point(self):
        """It is the method of Heun then."""
        loose = AdamsController(rtol=1e-6, atol=1e-6)
        y = solve(oscillator, 3.0, START, loose, Adams(max_order=1)).ys["y"][0]
        error = np.max(np.abs(y - np.array([np.cos(3.0), np.sin(3.0)])))
        assert 1e-8 < error < 1e-4

    def test_fewer_steps_the_higher_the_order(self):
        steps = [int(solve(oscillator, 20.0, START, solver=Adams(k)).stats["num_steps"]) for k in (4, 12)]
        assert steps[0] > 2 * steps[1]


class TestJumps:
    @staticmethod
    def jumping(t, y, kink):
        return jnp.where(t < kink, 1.0, -2.0) * y

    KINK, END = np.pi / 3, 5.0
    TRUTH = np.exp(KINK - 2 * (END - KINK))

    def test_restarts_after_a_kink(self):
        """With a step that is found at once: no more than three are rejected in its place."""
        kinks = jnp.array([self.KINK])
        solution = solve(self.jumping, self.END, jnp.array(1.0), StepToKinks(TIGHT, kinks), args=self.KINK)
        np.testing.assert_allclose(solution.ys[0], self.TRUTH, rtol=0, atol=1e-9)
        assert solution.stats["num_rejected_steps"] <= 3

    def test_survives_a_jump_that_it_is_not_told_of(self):
        solution = solve(self.jumping, self.END, jnp.array(1.0), args=self.KINK)
        np.testing.assert_allclose(solution.ys[0], self.TRUTH, rtol=0, atol=1e-8)
        assert solution.stats["num_steps"] < 300

    @pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-9, 1e-12])
    def test_steps_that_are_cut_off_very_short_do_no_harm(self, gap):
        """As points, they would have differences of rounding errors: at 1e-12, hundreds of steps were rejected."""
        stops = np.linspace(1.0, 19.0, 10)
        controller = diffrax.ClipStepSizeController(TIGHT, step_ts=np.concatenate([stops, stops + gap]))
        solution = solve(oscillator, 20.0, START, controller)
        np.testing.assert_allclose(solution.ys["y"][0], [np.cos(20.0), np.sin(20.0)], rtol=0, atol=5e-9)
        assert solution.stats["num_rejected_steps"] <= 3
        assert solution.stats["num_steps"] < 260


class TestDerivatives:
    """The slope is linear in y, and so are steps whose lengths and orders are held: then ∂end/∂y y is the end."""

    @staticmethod
    def end(y0, t1=3.0, adjoint=None):
        adjoint = diffrax.RecursiveCheckpointAdjoint() if adjoint is None else adjoint
        kinks = StepToKinks(TIGHT, jnp.array([1.1]))
        return solve(lambda t, y, args: TURNS @ y, t1, y0, kinks, adjoint=adjoint).ys[0]

    Y0 = jnp.array([1.3, -0.4])

    def test_forward_mode_is_exact_for_the_steps_taken(self):
        end, along = jax.jit(lambda y: jax.jvp(lambda y: self.end(y, adjoint=diffrax.ForwardMode()), (y,), (y,)))(
            self.Y0
        )
        np.testing.assert_allclose(along, end, rtol=0, atol=3e-15)

    def test_reverse_mode_is_exact_for_the_steps_taken(self):
        end, along = jax.jit(lambda y: (self.end(y), jax.jacrev(self.end)(y) @ y))(self.Y0)
        np.testing.assert_allclose(along, end, rtol=0, atol=3e-15)

    def test_derivative_with_respect_to_the_end_is_the_slope(self):
        slope = jax.jacrev(self.end, argnums=1)(self.Y0, jnp.asarray(3.0))
        np.testing.assert_allclose(slope, TURNS @ self.end(self.Y0), rtol=0, atol=1e-8)

    def test_where_all_errors_are_zero_derivatives_are_finite(self):
        """Norms have none there. They are not accurate, because nothing but errors chooses the steps."""
        assert np.all(np.isfinite(jax.grad(lambda y: jnp.sum(self.end(y)))(jnp.zeros(2))))


class TestPairing:
    FIELD = staticmethod(lambda t, y, args: -y)

    @pytest.mark.parametrize("wrap", [lambda c: c, lambda c: StepToKinks(c, [0.3])], ids=["bare", "to kinks"])
    def test_another_controller_is_refused(self, wrap):
        with pytest.raises(TypeError, match=r"`stepsize_controller` must be a jaxball\.solvers\.AdamsController"):
            solve(self.FIELD, 1.0, jnp.array(1.0), wrap(diffrax.PIDController(1e-6, 1e-6)))

    def test_steps_of_constant_length_are_refused(self):
        with pytest.raises(ValueError, match="fixed step size controller"):
            solve(self.FIELD, 1.0, jnp.array(1.0), diffrax.ConstantStepSize(), dt0=0.1)

    def test_another_solver_is_refused(self):
        with pytest.raises(TypeError, match=r"`solver` must be a jaxball\.solvers\.Adams"):
            solve(self.FIELD, 1.0, jnp.array(1.0), solver=diffrax.Dopri8())

    def test_a_mass_matrix_is_refused(self):
        term = MassMatrixTerm(lambda t, y, args: y, np.array([1.0, 0.0]))
        with pytest.raises(TypeError, match=r"must be a RadauIIA .* but it is a Adams"):
            diffrax.diffeqsolve(term, Adams(), 0.0, 1.0, None, jnp.ones(2), stepsize_controller=TIGHT)

    @pytest.mark.parametrize("order", [0, 13, 2.5, True])
    def test_other_orders_are_refused(self, order, no_type_checks):
        with pytest.raises(ValueError, match="`max_order` must be a whole number from 1 to 12"):
            Adams(order)


class TestInDiffrax:
    def test_vmap_takes_the_steps_of_each_run(self):
        """Until the last ends; which is later for faster turns."""

        def run(rate):
            solution = solve(lambda t, y, args: args * (TURNS @ y), 3.0, jnp.array([1.0, 0.0]), args=rate)
            return solution.ys[0], solution.stats["num_accepted_steps"]

        rates = jnp.array([0.3, 1.0, 5.0])
        ends, steps = jax.jit(jax.vmap(run))(rates)
        for i, rate in enumerate(rates):
            end, alone = jax.jit(run)(rate)
            np.testing.assert_allclose(ends[i], end, rtol=0, atol=1e-11)
            assert abs(int(steps[i]) - int(alone)) <= 2

    def test_float32(self):
        y0 = jnp.array([1.0, 0.0], jnp.float32)
        times = jnp.asarray(0.0, jnp.float32), jnp.asarray(5.0, jnp.float32)
        controller = AdamsController(rtol=1e-5, atol=1e-5)
        end = solve(lambda t, y, args: jnp.asarray(TURNS, y.dtype) @ y, times[1], y0, controller, t0=times[0]).ys[0]
        assert end.dtype == jnp.float32
        np.testing.assert_allclose(end, [np.cos(5.0), -np.sin(5.0)], rtol=0, atol=3e-4)

    def test_event(self):
        event = diffrax.Event(lambda t, y, args, **_: y["y"][0], optx.Newton(1e-12, 1e-12))
        solution = solve(oscillator, 3.0, START, event=event)
        np.testing.assert_allclose(solution.ts[0], np.pi / 2, rtol=0, atol=1e-9)

    def test_progress_meter(self, capfd):
        solve(oscillator, 3.0, START, progress_meter=diffrax.TextProgressMeter())
        jax.effects_barrier()
        assert "100.00%" in capfd.readouterr().out

    def test_longest_step(self):
        controller = AdamsController(1e-3, 1e-3, dtmax=0.01)
        solution = solve(oscillator, 1.0, START, controller, saveat=diffrax.SaveAt(steps=True))
        assert np.max(np.diff(solution.ts[np.isfinite(solution.ts)])) < 0.010001

    def test_shortest_step(self):
        controller = AdamsController(1e-10, 1e-10, dtmin=1e-2)
        solution = solve(lambda t, y, args: -1e3 * y, 1.0, jnp.array(1.0), controller, throw=False)
        assert "steps became shorter than the step-size controller allows" in explain(solution.result)
