"""What diffrax and JAX do with a solver: batches, jit, events, saving, backward time, float32, states as PyTrees."""

import functools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
import pytest

import jaxball
from jaxball.simulation.solvers import (
    NDF,
    TRBDF2,
    Adams,
    FixedPoint,
    Gauss,
    MassMatrixTerm,
    RadauIIA,
    SimplifiedNewton,
    TailError,
    Trapezoidal,
    explain,
)
from tests.solvers.solving import TURN, solve

# With tolerances, and bounds on the errors of an oscillation: at the ends of steps, between them, of the slope between.
SOLVERS = {
    "radau 3": (RadauIIA(3), 1e-9, 1e-11, 2e-9, 1e-6),
    "radau 5": (RadauIIA(5), 1e-10, 1e-12, 1e-10, 2e-8),
    "radau 7, tail": (RadauIIA(7, error=TailError()), 1e-11, 2e-12, 2e-12, 1e-11),
    "gauss 8": (Gauss(8), 1e-11, 3e-14, 3e-14, 3e-13),
    "trapezoidal": (Trapezoidal(), 1e-7, 1e-4, 1e-4, 1e-4),
    "tr-bdf2": (TRBDF2(), 1e-7, 1e-4, 1e-4, 1e-4),
}
SLOW = pytest.mark.slow


class TestBatches:
    """Lanes of van der Pol's oscillation from mild to stiff, and one that fails."""

    mu = np.array([1.0, 30.0, np.nan, 1e3])

    def one(self, solver, mu):
        field = lambda t, x, mu: jnp.stack([x[1], mu * (1.0 - x[0] ** 2) * x[1] - x[0]])  # noqa: E731
        solution = solve(field, solver, jnp.asarray([2.0, 0.0]), 2.0, 1e-6, args=mu, throw=False)
        return solution.ys[0], solution.stats["num_accepted_steps"], solution.result == diffrax.RESULTS.successful

    @pytest.mark.long
    @pytest.mark.parametrize(
        "solver",
        [
            RadauIIA(3),
            NDF(),
            pytest.param(Adams(), marks=SLOW),
            pytest.param(Gauss(6), marks=SLOW),
            pytest.param(TRBDF2(), marks=SLOW),
            pytest.param(RadauIIA(7), marks=SLOW),
            pytest.param(Trapezoidal(), marks=SLOW),
        ],
    )
    def test_lanes_are_single_runs(self, solver):
        lanes = jax.jit(jax.vmap(functools.partial(self.one, solver)))(self.mu)
        single = jax.jit(functools.partial(self.one, solver))
        # Fixed-point iteration and Adams take too many steps for the stiffest.
        stiffest = len(self.mu) - 1
        np.testing.assert_array_equal(lanes[2][:stiffest], np.isfinite(self.mu[:stiffest]))
        for mu, x, steps, ok in zip(self.mu, *lanes, strict=True):
            alone = single(mu)
            assert ok == alone[2]
            if ok:
                assert steps == alone[1]
                np.testing.assert_allclose(x, alone[0], rtol=1e-11)

    @pytest.mark.slow
    def test_each_lane_has_its_own_algebraic_component(self):
        """(cos t, sin t) with |x| = 1 for the rate of the larger component, from different angles."""
        angles = np.array([0.1, 0.7, 2.0])
        run = jax.jit(jax.vmap(lambda x0: solve(TURN, RadauIIA(5), x0, 7.0, 1e-10).ys[0]))
        found = run(jnp.stack([np.cos(angles), np.sin(angles)], axis=1))
        expected = np.stack([np.cos(angles + 7.0), np.sin(angles + 7.0)], axis=1)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)


OSCILLATOR = diffrax.ODETerm(lambda t, x, args: {"place": x["rate"][0], "rate": (-x["place"],)})


def oscillation(t):
    """cos t and its rate, a state with a structure."""
    return {"place": jnp.cos(t)[None], "rate": (-jnp.sin(t)[None],)}


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n in ("radau 3", "gauss 8", "tr-bdf2") else SLOW) for n in SOLVERS]
)
class TestSaving:
    """Backward in time from 2 to −1, at given times, at each step and between."""

    times = np.array([2.0, 1.7, 0.4, -0.2, -1.0])

    @functools.cache  # noqa: B019
    def solution(self, name):
        solver, tolerance, *_ = SOLVERS[name]
        subs = [diffrax.SubSaveAt(ts=jnp.asarray(self.times)), diffrax.SubSaveAt(steps=True)]
        saveat = diffrax.SaveAt(subs=subs, dense=True)
        return solve(OSCILLATOR, solver, oscillation(jnp.asarray(2.0)), -1.0, tolerance, start=2.0, saveat=saveat)

    @pytest.mark.long
    def test_at_given_times(self, name):
        *_, bound, _ = SOLVERS[name]
        ts, ys = self.solution(name).ts[0], self.solution(name).ys[0]
        np.testing.assert_array_equal(ts, self.times)
        np.testing.assert_allclose(ys["place"][:, 0], np.cos(self.times), rtol=0, atol=bound)
        np.testing.assert_allclose(ys["rate"][0][:, 0], -np.sin(self.times), rtol=0, atol=bound)

    @pytest.mark.thorough
    def test_at_each_step(self, name):
        _, _, bound, *_ = SOLVERS[name]
        ts, ys = self.solution(name).ts[1], self.solution(name).ys[1]
        taken = np.isfinite(ts)
        t = np.asarray(ts)[taken]
        assert np.all(np.diff(t) < 0.0)
        assert t[-1] == -1.0
        np.testing.assert_allclose(ys["place"][taken, 0], np.cos(t), rtol=0, atol=bound)
        np.testing.assert_allclose(ys["rate"][0][taken, 0], -np.sin(t), rtol=0, atol=bound)

    @pytest.mark.thorough
    def test_between_the_steps(self, name):
        *_, bound, slope_bound = SOLVERS[name]
        t, solution = np.linspace(-1.0, 2.0, 301), self.solution(name)
        place = jax.vmap(solution.evaluate)(jnp.asarray(t))["place"][:, 0]
        slope = jax.vmap(solution.derivative)(jnp.asarray(t))["place"][:, 0]
        np.testing.assert_allclose(place, np.cos(t), rtol=0, atol=bound)
        np.testing.assert_allclose(slope, -np.sin(t), rtol=0, atol=slope_bound)


@pytest.mark.thorough
def test_event():
    """The oscillation passes zero at π/2, within a step."""
    solver, tolerance, _, bound, _ = SOLVERS["radau 5"]
    event = diffrax.Event(lambda t, y, args, **_: y["place"][0], root_finder=optimistix.Newton(1e-13, 1e-13))
    solution = solve(OSCILLATOR, solver, oscillation(jnp.asarray(0.0)), 5.0, tolerance, event=event)
    assert explain(solution.result) == "An event ended the solve."
    np.testing.assert_allclose(solution.ts[-1], np.pi / 2, rtol=0, atol=bound)
    np.testing.assert_allclose(solution.ys["place"][-1], 0.0, rtol=0, atol=1e-12)


@pytest.mark.thorough
def test_mass_matrix_backward_in_time():
    """ẋ = −z with 0 = z − x (2 + cos t) from t = 2 to 0: x = exp(−2t − sin t)."""
    term = MassMatrixTerm(
        lambda t, x, args: {"x": -x["z"], "z": x["z"] - x["x"] * (2.0 + jnp.cos(t))}, {"x": 1.0, "z": 0.0}
    )
    x, z = np.exp(-4.0 - np.sin(2.0)), (2.0 + np.cos(2.0)) * np.exp(-4.0 - np.sin(2.0))
    solution = solve(term, RadauIIA(5), {"x": x, "z": z}, 0.0, 1e-11, start=2.0)
    np.testing.assert_allclose([solution.ys["x"][0], solution.ys["z"][0]], [1.0, 3.0], rtol=1e-9)


@pytest.mark.thorough
def test_progress_meter(capfd):
    meter = diffrax.TextProgressMeter(minimum_increase=0.2)
    solve(OSCILLATOR, RadauIIA(3), oscillation(jnp.asarray(0.0)), 10.0, 1e-6, progress_meter=meter)
    jax.effects_barrier()
    shown = capfd.readouterr().out
    assert "0.00%" in shown
    assert "100.00%" in shown


def relaxation(t):
    """The solution of ẋ = −50 (x − cos t) from x(0) = 0."""
    return 50.0 * (50.0 * np.cos(t) + np.sin(t) - 50.0 * np.exp(-50.0 * t)) / 2501.0


def relaxed(solver, start, algebraic=False):
    """x(2) in the type of ``start``."""
    x0 = jnp.zeros((1,), start.dtype)
    term = diffrax.ODETerm(lambda t, x, args: -50.0 * (x - jnp.cos(t)))
    if algebraic:
        x0 = jnp.append(x0, jnp.ones_like(x0))
        field = lambda t, x, args: jnp.stack([-50.0 * (x[0] - x[1]), x[1] - jnp.cos(t)])  # noqa: E731
        term = MassMatrixTerm(field, np.array([1.0, 0.0]))
    solution = solve(term, solver, x0, start + 2, 1e-4, start=start, throw=False)
    assert not explain(solution.result)
    return solution.ys[0, 0]


class TestFloat32:
    @pytest.mark.long
    @pytest.mark.parametrize("solver", [Gauss(8), Trapezoidal()])
    def test_where_it_is_the_default(self, solver):
        with jax.enable_x64(False):
            x = relaxed(solver, jnp.asarray(0.0))
        assert x.dtype == jnp.float32
        np.testing.assert_allclose(x, relaxation(2.0), rtol=0, atol=1e-4)

    @pytest.mark.thorough
    def test_mass_matrix_where_it_is_the_default(self):
        with jax.enable_x64(False):
            x = relaxed(RadauIIA(5), jnp.asarray(0.0), algebraic=True)
        assert x.dtype == jnp.float32
        np.testing.assert_allclose(x, relaxation(2.0), rtol=0, atol=1e-4)

    @pytest.mark.long
    @pytest.mark.parametrize("solver", [RadauIIA(3), Gauss(8, root_finder=SimplifiedNewton()), TRBDF2()])
    def test_beside_float64(self, solver):
        x = relaxed(solver, jnp.asarray(0.0, jnp.float32))
        assert x.dtype == jnp.float32
        np.testing.assert_allclose(x, relaxation(2.0), rtol=0, atol=1e-4)


def test_a_solver_is_compiled_once():
    """Two solvers with the same numbers are the same argument to jit, whatever objects they are."""
    traced = []

    @functools.partial(jax.jit, static_argnums=0)
    def run(solver, x0):
        traced.append(solver)
        return solve(lambda t, x, args: -x, solver, x0, 1.0, 1e-6).ys[0]

    for x0 in (1.0, 2.0):
        solver = RadauIIA(3, root_finder=FixedPoint())
        np.testing.assert_allclose(run(solver, jnp.asarray(x0)), x0 * np.exp(-1.0), rtol=1e-6)
    assert len(traced) == 1


@pytest.mark.thorough
def test_a_norm_may_be_of_a_part_of_the_state():
    """The norm of a controller takes a state, and is asked for no more than that by the iterations of stages."""

    def first(state):
        return optimistix.rms_norm(state["x"])

    def oscillate(t, state, args):
        return {"x": state["v"], "v": -state["x"]}

    @jaxball.jit
    def run(x0):
        start = {"x": x0, "v": jnp.zeros_like(x0)}
        controller = diffrax.PIDController(rtol=1e-10, atol=1e-10, norm=first)
        return solve(oscillate, RadauIIA(stages=5), start, 2.0, stepsize_controller=controller).ys["x"][0]

    np.testing.assert_allclose(run(jnp.ones(1))[0], np.cos(2.0), rtol=1e-9)
