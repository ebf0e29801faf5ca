"""What cannot be solved ends with a result that is not success and a sentence that names the cause."""

import functools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
import pytest

import jaxball
from jaxball import Status
from jaxball.simulation.solvers import (
    NDF,
    TRBDF2,
    Adams,
    EmbeddedError,
    FixedPoint,
    Gauss,
    MassMatrixTerm,
    RadauIIA,
    SimplifiedNewton,
    Trapezoidal,
    explain,
)
from tests.solvers.solving import solve
from tests.support.sentences import refuses, said

NOT_FINITE = "vector field is not a finite number"
TOO_MANY = "has taken all its steps"
NO_CONVERGENCE = "iteration for the stages does not converge"
UNDETERMINED = "equations do not determine the step"
INCONSISTENT = "initial values do not satisfy the equations without a derivative"

SOLVERS = {
    "radau 3": RadauIIA(3),
    "gauss 8": Gauss(8),
    "tr-bdf2": TRBDF2(),
    "adams": Adams(),
    "ndf": NDF(),
}

# Scalar fields, all in one program for each solver, and the greatest step number for all of them.
FIELDS = {
    "not a number": lambda t, x: jnp.nan * x,
    "breaks off": lambda t, x: jnp.where(t < 0.5, -x, jnp.nan),
    # x falls to zero at t = 2 − 2 log 2
    "leaves its domain": lambda t, x: -1.0 - jnp.sqrt(x),
    "fast oscillation": lambda t, x: 1e5 * jnp.cos(1e5 * t),
    "stiff": lambda t, x: -1e6 * (x - jnp.cos(t)),
}
MOST_STEPS = 600


def field(t, x, index):
    return jax.lax.switch(index, list(FIELDS.values()), t, x)


@functools.cache
def program(solver):
    @jax.jit
    def run(index):
        options = {"saveat": diffrax.SaveAt(steps=True), "max_steps": MOST_STEPS, "throw": False}
        solution = solve(field, SOLVERS[solver], 1.0, 1.0, 1e-8, args=index, **options)
        return solution.ts, solution.ys, solution.result

    return run


def failed(solver, name):
    """The last time for which there is a state, 0 at least, that state, and the sentence."""
    ts, ys, result = program(solver)(list(FIELDS).index(name))
    assert result != diffrax.RESULTS.successful
    good = np.isfinite(ts) & np.isfinite(ys)
    return np.append(0.0, ts[good])[-1], np.append(1.0, ys[good])[-1], explain(result)


@pytest.mark.parametrize("solver", SOLVERS)
class TestAdaptiveSteps:
    @pytest.mark.thorough
    def test_field_that_is_not_a_number(self, solver):
        reached, _, sentence = failed(solver, "not a number")
        assert NOT_FINITE in sentence
        assert reached < 1e-12

    @pytest.mark.thorough
    def test_field_that_breaks_off(self, solver):
        reached, x, sentence = failed(solver, "breaks off")
        assert NOT_FINITE in sentence
        np.testing.assert_allclose(reached, 0.5, atol=1e-6)
        np.testing.assert_allclose(x, np.exp(-0.5), atol=1e-5)

    @pytest.mark.thorough
    def test_solution_that_leaves_the_fields_domain(self, solver):
        reached, x, sentence = failed(solver, "leaves its domain")
        assert NOT_FINITE in sentence
        np.testing.assert_allclose(reached, 2.0 - 2.0 * np.log(2.0), atol=1e-4)
        assert abs(x) < 1e-4

    @pytest.mark.thorough
    def test_too_few_steps(self, solver):
        reached, _, sentence = failed(solver, "fast oscillation")
        assert TOO_MANY in sentence
        assert reached < 1.0


@pytest.mark.thorough
def test_fixed_point_iteration_on_a_stiff_problem():
    reached, _, sentence = failed("gauss 8", "stiff")
    assert TOO_MANY in sentence
    said(sentence)
    assert reached < 0.1


class TestConstantSteps:
    """A step that cannot be taken cannot be tried again shorter."""

    tolerances = {"rtol": 1e-10, "atol": 1e-10, "norm": optimistix.max_norm}  # noqa: RUF012

    @pytest.mark.thorough
    @pytest.mark.parametrize("make", [RadauIIA, Trapezoidal])
    def test_newtons_iteration(self, make):
        solver = make(root_finder=SimplifiedNewton(**self.tolerances))
        # The matrix of the iteration is γ − h λ with 1/γ an eigenvalue of Butcher's matrix; here h = 1.
        radau = RadauIIA().tableau.eigenvalues[0].real
        singular = {RadauIIA: radau, Trapezoidal: 2.0}[make]
        cases = {
            UNDETERMINED: (lambda t, x: singular * x, 1.0),
            NO_CONVERGENCE: (lambda t, x: -1e3 * x**3 + jnp.sin(50.0 * t), 1.0),
            NOT_FINITE: (lambda t, x: jnp.where(t < 2.0, -0.1 * x, jnp.nan), 3.0),
        }
        run = self.program(solver, [field for field, _ in cases.values()])
        for index, (sentence, (_, reached)) in enumerate(cases.items()):
            t, result = run(index)
            assert sentence in explain(result)
            assert t <= reached

    @pytest.mark.thorough
    @pytest.mark.parametrize("make", [Gauss, TRBDF2])
    def test_fixed_point_iteration(self, make):
        solver = make(root_finder=FixedPoint(**self.tolerances))
        t, result = self.program(solver, [lambda t, x: -50.0 * x])(0)
        assert NO_CONVERGENCE in explain(result)
        assert "use SimplifiedNewton" in explain(result)
        assert t <= 1.0

    def program(self, solver, fields):
        @jax.jit
        def run(index):
            field = lambda t, x, index: jax.lax.switch(index, fields, t, x)  # noqa: E731
            solution = solve(field, solver, 5.0, 5.0, step=1.0, args=index, throw=False)
            return solution.ts[-1], solution.result

        return run


class TestMassMatrices:
    """ẋ = z or the like, and an equation without a derivative."""

    cases = {  # noqa: RUF012
        "index two": (lambda t, x: [x[1], x[0] - t], (0.0, 1.0), UNDETERMINED),
        "inconsistent": (lambda t, x: [-x[0] + x[1], x[0] + x[1] - jnp.sin(t)], (0.0, 1.0), INCONSISTENT),
        "slightly inconsistent": (lambda t, x: [-x[0] + x[1], x[0] + x[1] - jnp.sin(t)], (0.0, 1e-6), INCONSISTENT),
        "not a number": (lambda t, x: [x[1], jnp.nan * x[1]], (0.0, 1.0), NOT_FINITE),
        "breaks off": (lambda t, x: [x[1], x[0] - jnp.where(t < 0.5, x[1], jnp.nan)], (1.0, 1.0), NOT_FINITE),
        # z = √(½ − t) has no value after t = ½.
        "fold": (lambda t, x: [jnp.ones_like(t), x[1] ** 2 - (0.5 - x[0])], (0.0, 0.5**0.5), NO_CONVERGENCE),
        "pole": (lambda t, x: [jnp.ones_like(t), (0.5 - x[0]) * x[1] - 1.0], (0.0, 2.0), NO_CONVERGENCE),
    }

    @functools.cache  # noqa: B019
    def program(self, solver):
        fields = [lambda t, x, g=g: jnp.stack(g(t, x)) for g, _, _ in self.cases.values()]
        term = MassMatrixTerm(lambda t, x, index: jax.lax.switch(index, fields, t, x), np.array([1.0, 0.0]))

        return jax.jit(lambda index, x0: solve(term, solver, x0, 1.0, 1e-8, args=index, throw=False).result)

    @pytest.mark.thorough
    @pytest.mark.parametrize(
        ("solver", "names"), [(RadauIIA(3), cases), (NDF(), ("index two", "inconsistent"))], ids=["radau 3", "ndf"]
    )
    def test_each_names_its_cause(self, solver, names):
        for name in names:
            _, x0, sentence = self.cases[name]
            result = self.program(solver)(list(self.cases).index(name), jnp.asarray(x0))
            assert result != diffrax.RESULTS.successful, name
            assert sentence in explain(result), name


def breaks_off(t, end):
    """A schedule that is not a number after ``end``."""
    return jnp.where(t < end, t, jnp.nan)


class TestSimulate:
    times = np.linspace(0.0, 2.0, 5)

    def ball(self):
        schedule = jaxball.FunctionSchedule(breaks_off, jnp.asarray(1.3))
        mass = jaxball.PointMass(0.5, jaxball.OnRail(jaxball.Circle(0.5), schedule))
        return jaxball.Ball(mass=1.0, inertia=(0.5, 0.6, 0.7), masses=[mass])

    @pytest.mark.slow
    @pytest.mark.parametrize("solver", [RadauIIA(3), TRBDF2()])
    def test_motion_that_is_not_a_number(self, solver):
        run = jaxball.simulate(self.ball(), self.times, solver=solver, rtol=1e-8, atol=1e-8)
        assert run.status == Status.NOT_FINITE
        assert "not finite" in run.message
        np.testing.assert_allclose(run.reached, 1.3, atol=1e-6)
        np.testing.assert_array_equal(np.isfinite(run.state.q[:, 0]), self.times < 1.3)

    @pytest.mark.thorough
    def test_too_few_steps(self):
        run = jaxball.simulate(self.ball(), self.times, solver=Gauss(8), max_steps=8)
        assert run.status == Status.MAX_STEPS
        said(run.message, "max_steps")
        np.testing.assert_array_equal(np.isfinite(run.state.q[:, 0]), self.times <= float(run.reached))

    @pytest.mark.slow
    def test_versor_that_is_one_to_eight_digits_only(self):
        """Enough for a ball, and not for |q|² = 1 at this tolerance: no silent drift."""
        ball = jaxball.Ball(mass=1.0, inertia=(0.5, 0.6, 0.7), offset=(0.1, 0.0, 0.0))
        state = jaxball.BallState(q=(1.0 + 1e-8, 0.0, 0.0, 0.0))
        run = jaxball.simulate(ball, [0.0, 1.0], state, solver=RadauIIA(3), dae=True)
        length = np.linalg.norm(run.state.q[-1])
        assert run.status == Status.SOLVER_FAILED or abs(length - 1.0) < 1e-9


@pytest.mark.usefixtures("no_type_checks")
class TestWrongArguments:
    @pytest.mark.parametrize(
        ("make", "named"),
        [
            (lambda: RadauIIA(4), "stages"),
            (lambda: Gauss(1), "stages"),
            (lambda: Gauss(21), "stages"),
            (lambda: Gauss(13, root_finder=SimplifiedNewton()), "stages"),
            (lambda: Gauss(8, error=EmbeddedError()), "stages"),
        ],
    )
    def test_stages(self, make, named):
        with refuses(ValueError, named):
            make()

    @pytest.mark.parametrize("solver", [RadauIIA(3), Gauss(8), Trapezoidal(), TRBDF2()])
    @pytest.mark.filterwarnings("ignore:Complex dtype support")
    def test_complex_state(self, solver):
        term = diffrax.ODETerm(lambda t, x, args: -x)
        with refuses(TypeError, "y0"):
            solve_once(term, solver, jnp.asarray([1.0 + 1.0j]))

    @pytest.mark.thorough
    @pytest.mark.parametrize(
        ("kind", "solver"),
        [
            *((kind, RadauIIA(3)) for kind in ("vector noise", "scalar noise", "drift and noise")),
            *(("drift and noise", solver) for solver in (Gauss(8), TRBDF2())),
        ],
    )
    @pytest.mark.filterwarnings("ignore:.*not marked as converging")
    def test_stochastic_terms(self, kind, solver):
        shape = (1,) if kind == "vector noise" else ()
        path = diffrax.VirtualBrownianTree(0.0, 1.0, tol=1e-2, shape=shape, key=jax.random.key(0))
        term = diffrax.ControlTerm(lambda t, x, args: x[:, None] if shape else x, path)
        if kind == "drift and noise":
            term = diffrax.MultiTerm(diffrax.ODETerm(lambda t, x, args: -x), term)
        with refuses(TypeError, "terms"):
            solve_once(term, solver, jnp.asarray([1.0]))


def solve_once(term, solver, x0):
    controller = diffrax.PIDController(rtol=1e-3, atol=1e-3)
    return solve(term, solver, x0, 1.0, step=0.1, stepsize_controller=controller)
