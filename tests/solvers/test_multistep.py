"""Runs of the methods of variable order: starts and jumps, derivatives, pairing, what diffrax does with a solver."""

import functools
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

from jaxball.simulation.solvers import (
    NDF,
    Adams,
    AdamsController,
    NDFController,
    RadauIIA,
    SimplifiedNewton,
    StepToKinks,
    explain,
)
from tests.solvers.linear_fields import oscillator
from tests.support.sentences import refuses

TURNS = np.array([[0.0, 1.0], [-1.0, 0.0]])


class Method(NamedTuple):
    """A solver, its controller and the other's, how its errors at 1e-10 compare with those of Adams, and its orders."""

    solver: Any
    controller: type
    other: type
    errors: float
    highest: int


METHODS = {
    "adams": Method(Adams, AdamsController, NDFController, 1.0, 12),
    "ndf": Method(NDF, NDFController, AdamsController, 50.0, 5),
}


@pytest.fixture(params=METHODS)
def method(request):
    return METHODS[request.param]


START = {"y": jnp.array([1.0, 0.0]), "v": jnp.array([0.0, 1.0])}


def tight(method):
    return method.controller(rtol=1e-10, atol=1e-10)


def solve(method, field, t1, y0, controller=None, solver=None, t0=0.0, **options):
    solver = method.solver() if solver is None else solver
    controller = tight(method) if controller is None else controller
    options = {"max_steps": 10_000} | options
    return diffrax.diffeqsolve(
        diffrax.ODETerm(field), solver, t0, t1, options.pop("dt0", None), y0, stepsize_controller=controller, **options
    )


@functools.cache
def one_run(method):
    return eqx.filter_jit(
        lambda: solve(method, oscillator, 20.0, START, saveat=diffrax.SaveAt(steps=True, dense=True))
    )()


class TestOneRun:
    @pytest.mark.long
    def test_a_state_may_have_parts(self, method):
        solution = one_run(method)
        t = solution.ts[np.isfinite(solution.ts)]
        y = solution.ys["y"][: t.size]
        np.testing.assert_allclose(y, np.stack([np.cos(t), np.sin(t)], axis=1), rtol=0, atol=1e-8 * method.errors)

    @pytest.mark.thorough
    def test_dense_output_is_as_accurate_as_the_steps_and_meets_their_ends(self, method):
        solution = one_run(method)
        t = np.linspace(0.0, 20.0, 4001)
        y = jax.vmap(solution.evaluate)(jnp.asarray(t))["y"]
        np.testing.assert_allclose(y, np.stack([np.cos(t), np.sin(t)], axis=1), rtol=0, atol=1e-8 * method.errors)
        ends = np.asarray(solution.ts[np.isfinite(solution.ts)])[:-1]
        before = jax.vmap(lambda t: solution.evaluate(t, left=True))(jnp.asarray(ends))["y"]
        after = jax.vmap(lambda t: solution.evaluate(t, left=False))(jnp.asarray(ends))["y"]
        np.testing.assert_allclose(before, solution.ys["y"][: ends.size], rtol=0, atol=2e-15)
        np.testing.assert_array_equal(after, solution.ys["y"][: ends.size])

    @pytest.mark.thorough
    def test_backwards_in_time(self, method):
        y = solve(method, oscillator, -3.0, START).ys["y"][0]
        np.testing.assert_allclose(y, [np.cos(3.0), -np.sin(3.0)], rtol=0, atol=1e-9 * method.errors)

    @pytest.mark.long
    def test_goes_on_where_another_run_ended(self, method):
        """With the states of solver and controller the second run does not start anew."""
        kept = {"solver_state": True, "controller_state": True}
        first = solve(method, oscillator, 4.0, START, saveat=diffrax.SaveAt(t1=True, **kept))
        end = jax.tree.map(lambda leaf: leaf[0], first.ys)
        state = {"solver_state": first.solver_state, "controller_state": first.controller_state}
        second = solve(method, oscillator, 8.0, end, t0=4.0, dt0=first.controller_state[0], **state)
        anew = solve(method, oscillator, 8.0, end, t0=4.0)
        truth = [np.cos(8.0), np.sin(8.0)]
        np.testing.assert_allclose(second.ys["y"][0], truth, rtol=0, atol=3e-9 * method.errors)
        assert second.stats["num_steps"] < anew.stats["num_steps"] - 10

    @pytest.mark.long
    def test_fewer_steps_the_higher_the_order(self, method):
        solvers = (method.solver(method.highest // 2 + 1), method.solver())
        steps = [int(solve(method, oscillator, 20.0, START, solver=s).stats["num_steps"]) for s in solvers]
        assert steps[0] > 1.3 * steps[1]


class TestJumps:
    @staticmethod
    def jumping(t, y, kink):
        return jnp.where(t < kink, 1.0, -2.0) * y

    KINK, END = np.pi / 3, 5.0
    TRUTH = np.exp(KINK - 2 * (END - KINK))

    @pytest.mark.thorough
    def test_restarts_after_a_kink(self, method):
        """With a step that is found at once: no more than ten are rejected in its place."""
        kinks = StepToKinks(tight(method), jnp.array([self.KINK]))
        solution = solve(method, self.jumping, self.END, jnp.array(1.0), kinks, args=self.KINK)
        np.testing.assert_allclose(solution.ys[0], self.TRUTH, rtol=0, atol=1e-9 * method.errors)
        assert solution.stats["num_rejected_steps"] <= 10

    @pytest.mark.thorough
    def test_survives_a_jump_that_it_is_not_told_of(self, method):
        solution = solve(method, self.jumping, self.END, jnp.array(1.0), args=self.KINK)
        np.testing.assert_allclose(solution.ys[0], self.TRUTH, rtol=0, atol=1e-8 * method.errors)
        told = solve(
            method, self.jumping, self.END, jnp.array(1.0), StepToKinks(tight(method), [self.KINK]), args=self.KINK
        )
        assert solution.stats["num_steps"] < 2.5 * told.stats["num_steps"]

    @pytest.mark.long
    @pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-9, 1e-12])
    def test_steps_that_are_cut_off_very_short_do_no_harm(self, method, gap):
        """As points, they would have differences of rounding errors: at 1e-12, hundreds of steps were rejected."""
        stops = np.linspace(1.0, 19.0, 10)
        steps = {}
        for times in (stops, np.concatenate([stops, stops + gap])):
            controller = diffrax.ClipStepSizeController(tight(method), step_ts=times)
            solution = solve(method, oscillator, 20.0, START, controller)
            truth = [np.cos(20.0), np.sin(20.0)]
            np.testing.assert_allclose(solution.ys["y"][0], truth, rtol=0, atol=5e-9 * method.errors)
            steps[times.size] = int(solution.stats["num_steps"])
        assert solution.stats["num_rejected_steps"] <= 0.05 * steps[20]
        assert steps[20] < 1.2 * steps[10] + 10


class TestDerivatives:
    """The slope is linear in y, and so are steps whose lengths and orders are held: then ∂end/∂y y is the end."""

    @staticmethod
    def end(method, y0, t1=3.0, adjoint=None):
        adjoint = diffrax.RecursiveCheckpointAdjoint() if adjoint is None else adjoint
        kinks = StepToKinks(tight(method), jnp.array([1.1]))
        return solve(method, lambda t, y, args: TURNS @ y, t1, y0, kinks, adjoint=adjoint).ys[0]

    Y0 = jnp.array([1.3, -0.4])
    # An implicit step is differentiated as if its iteration had ended at its limit.
    LEFT = {Adams: 3e-15, NDF: 1e-10}  # noqa: RUF012

    @pytest.mark.thorough
    def test_forward_mode_is_exact_for_the_steps_taken(self, method):
        end = functools.partial(self.end, method, adjoint=diffrax.ForwardMode())
        value, along = jax.jit(lambda y: jax.jvp(end, (y,), (y,)))(self.Y0)
        np.testing.assert_allclose(along, value, rtol=0, atol=self.LEFT[method.solver])

    @pytest.mark.slow
    def test_reverse_mode_is_exact_for_the_steps_taken(self, method):
        end = functools.partial(self.end, method)
        value, along = jax.jit(lambda y: (end(y), jax.jacrev(end)(y) @ y))(self.Y0)
        np.testing.assert_allclose(along, value, rtol=0, atol=self.LEFT[method.solver])

    @pytest.mark.slow
    def test_derivative_with_respect_to_the_end_is_the_slope(self, method):
        slope = jax.jacrev(functools.partial(self.end, method), argnums=1)(self.Y0, jnp.asarray(3.0))
        end = self.end(method, self.Y0)
        np.testing.assert_allclose(slope, TURNS @ end, rtol=0, atol=1e-8 * method.errors)

    @pytest.mark.long
    def test_where_all_errors_are_zero_derivatives_are_finite(self, method):
        """Norms have none there. They are not accurate, because nothing but errors chooses the steps."""
        assert np.all(np.isfinite(jax.grad(lambda y: jnp.sum(self.end(method, y)))(jnp.zeros(2))))


class TestPairing:
    FIELD = staticmethod(lambda t, y, args: -y)

    @pytest.mark.parametrize("wrap", [lambda c: c, lambda c: StepToKinks(c, [0.3])], ids=["bare", "to kinks"])
    def test_another_controller_is_refused(self, method, wrap):
        for other in (diffrax.PIDController, method.other):
            with refuses(TypeError, "stepsize_controller", method.controller.__name__):
                solve(method, self.FIELD, 1.0, jnp.array(1.0), wrap(other(1e-6, 1e-6)))

    def test_steps_of_constant_length_are_refused(self, method):
        with refuses(ValueError, "fixed step size controller"):
            solve(method, self.FIELD, 1.0, jnp.array(1.0), diffrax.ConstantStepSize(), dt0=0.1)

    def test_another_solver_is_refused(self, method):
        for other in (diffrax.Dopri8(), RadauIIA(3)):
            with refuses(TypeError, "solver", method.solver.__name__):
                solve(method, self.FIELD, 1.0, jnp.array(1.0), solver=other)

    @pytest.mark.parametrize("order", [0, 13, 2.5, True])
    def test_other_orders_are_refused(self, method, order, no_type_checks):
        with refuses(ValueError, "max_order"):
            method.solver(order)

    def test_other_coefficients_are_refused(self, no_type_checks):
        with refuses(ValueError, "kappa"):
            NDF(kappa="tr")

    def test_tolerances_beside_those_of_the_controller_are_refused(self):
        with refuses(ValueError, "root_finder"):
            NDF(root_finder=SimplifiedNewton(rtol=1e-10, atol=1e-10))


class TestInDiffrax:
    @pytest.mark.long
    def test_vmap_takes_the_steps_of_each_run(self, method):
        """Until the last ends; which is later for faster turns."""

        def run(rate):
            solution = solve(method, lambda t, y, args: args * (TURNS @ y), 3.0, jnp.array([1.0, 0.0]), args=rate)
            return solution.ys[0], solution.stats["num_accepted_steps"]

        rates = jnp.array([0.3, 1.0, 5.0])
        ends, steps = jax.jit(jax.vmap(run))(rates)
        for i, rate in enumerate(rates):
            end, alone = jax.jit(run)(rate)
            np.testing.assert_allclose(ends[i], end, rtol=0, atol=1e-11 * method.errors)
            assert abs(int(steps[i]) - int(alone)) <= 2

    @pytest.mark.long
    def test_derivatives_of_rows_that_end_before_others(self, method):
        """d/da e^(-a) of each row, though the quickest takes many more steps than the others."""
        if method.solver is NDF:  # XLA loses the interface of a call of LAPACK in it
            pytest.skip("XLA finds no implementation for `lapack_dgetrf_ffi` in this program")
        rates = jnp.array([0.1, 1.0, 30.0])
        end = lambda a: solve(method, lambda t, y, a: -a * y, 1.0, jnp.ones(1), args=a).ys[0, 0]  # noqa: E731
        derivatives = jax.jit(jax.vmap(jax.grad(end)))(rates)
        # The tolerance bounds the errors of the state's steps, and to within the tenfold those of its derivative.
        np.testing.assert_allclose(derivatives, -np.exp(-rates), rtol=0, atol=1e-8 * method.errors)

    @pytest.mark.long
    def test_float32(self, method):
        y0 = jnp.array([1.0, 0.0], jnp.float32)
        times = jnp.asarray(0.0, jnp.float32), jnp.asarray(5.0, jnp.float32)
        controller = method.controller(rtol=1e-5, atol=1e-5)
        field = lambda t, y, args: jnp.asarray(TURNS, y.dtype) @ y  # noqa: E731
        end = solve(method, field, times[1], y0, controller, t0=times[0]).ys[0]
        assert end.dtype == jnp.float32
        np.testing.assert_allclose(end, [np.cos(5.0), -np.sin(5.0)], rtol=0, atol=1e-3)

    @pytest.mark.long
    def test_event(self, method):
        event = diffrax.Event(lambda t, y, args, **_: y["y"][0], optx.Newton(1e-12, 1e-12))
        solution = solve(method, oscillator, 3.0, START, event=event)
        np.testing.assert_allclose(solution.ts[0], np.pi / 2, rtol=0, atol=1e-9 * method.errors)

    @pytest.mark.thorough
    def test_progress_meter(self, method, capfd):
        solve(method, oscillator, 3.0, START, progress_meter=diffrax.TextProgressMeter())
        jax.effects_barrier()
        assert "100.00%" in capfd.readouterr().out

    @pytest.mark.long
    def test_longest_step(self, method):
        controller = method.controller(1e-3, 1e-3, dtmax=0.01)
        solution = solve(method, oscillator, 1.0, START, controller, saveat=diffrax.SaveAt(steps=True))
        assert np.max(np.diff(solution.ts[np.isfinite(solution.ts)])) < 0.010001

    @pytest.mark.long
    def test_shortest_step(self, method):
        controller = method.controller(1e-10, 1e-10, dtmin=1e-2)
        solution = solve(method, lambda t, y, args: -1e3 * y, 1.0, jnp.array(1.0), controller, throw=False)
        assert "steps became shorter than the step-size controller allows" in explain(solution.result)
