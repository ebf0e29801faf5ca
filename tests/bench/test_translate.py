"""The equations in every language against the same equations in ``math``, at random points."""

import cmath
import math

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import translate
from comparison.problems import ALL

MATH = {"sin": math.sin, "cos": math.cos}
CASES = [
    pytest.param(problem, piece, id=f"{name}-{piece.start:g}")
    for name, problem in ALL.items()
    for piece in {piece.algebraic: piece for piece in reversed(problem.pieces)}.values()
]


@pytest.fixture
def random():
    return np.random.default_rng(7)


def compiled(text, name):
    space = dict(MATH)
    exec(text, space)
    return space[name]


def points(problem, piece, random):
    """Five random (t, x, p), and the right-hand side there in ``math``."""
    g = problem.right_hand_side(piece)
    for _ in range(5):
        t, x, p = (
            random.uniform(),
            random.uniform(0.1, 1.0, len(problem.initial)),
            random.normal(size=len(piece.parameters)),
        )
        yield t, x, p, np.array(g(t, list(x), list(p), math))


def assert_same(found, expected):
    """To a few roundings of the largest rate."""
    np.testing.assert_allclose(np.ravel(found), expected, rtol=0.0, atol=1e-14 * np.abs(expected).max())


@pytest.mark.parametrize(("problem", "piece"), CASES)
class TestSameEverywhere:
    @pytest.mark.thorough
    def test_jax(self, problem, piece, random):
        field = jax.jit(translate.jax_field(problem.right_hand_side(piece)))
        for t, x, p, expected in points(problem, piece, random):
            assert_same(field(jnp.asarray(t), jnp.asarray(x), jnp.asarray(p)), expected)

    def test_generated_python(self, problem, piece, random):
        text = translate.python_source(problem.right_hand_side(piece), len(problem.initial), len(piece.parameters))
        rates = compiled(text, "rates")
        for t, x, p, expected in points(problem, piece, random):
            found = np.full(len(x), np.nan)
            rates(t, x, p, found)
            assert_same(found, expected)

    @pytest.mark.thorough
    def test_generated_jacobian_is_that_of_a_complex_step(self, problem, piece, random):
        g, n = problem.right_hand_side(piece), len(problem.initial)
        jacobian = compiled(translate.jacobian_source(g, n, len(piece.parameters)), "jacobian")
        for t, x, p, _ in points(problem, piece, random):
            found = np.full((n, n), np.nan)
            jacobian(t, x, p, found)
            columns = [g(t, list(x + 1e-30j * e), list(p), cmath) for e in np.eye(n)]
            assert_same(found, np.imag(np.stack(columns, axis=1)).ravel() / 1e-30)

    def test_casadi(self, problem, piece, random):
        casadi = pytest.importorskip("casadi", reason="CasADi is not installed")
        dae, k = translate.casadi_dae(problem, piece), piece.algebraic
        names = [name for name in ("t", "x", "z", "p", "ode", "alg") if name in dae]
        inputs = [name for name in names if name in "txzp"]
        outputs = [name for name in names if name not in inputs]
        function = casadi.Function("dae", [dae[name] for name in inputs], [dae[name] for name in outputs])
        for t, x, p, expected in points(problem, piece, random):
            if k is None:
                assert_same(function(t, x, p).full(), expected)
            else:
                ode, alg = function(t, np.delete(x, k), x[k], p)
                assert_same(np.insert(ode.full().ravel(), k, float(alg)), expected)

    def test_heyoka(self, problem, piece, random):
        heyoka = pytest.importorskip("heyoka", reason="heyoka is not installed")
        n, k = len(problem.initial), len(piece.parameters)
        system = translate.heyoka_system(problem.right_hand_side(piece), n, k)
        function = heyoka.cfunc([rate for _, rate in system], [variable for variable, _ in system])
        for t, x, p, expected in points(problem, piece, random):
            given = {"time": t} if function.is_time_dependent else {}
            assert_same(function(x, **given, **({"pars": p} if k else {})), expected)


@pytest.mark.parametrize("name", ["ball", "hires"])
def test_numba(name, random):
    numba = pytest.importorskip("numba", reason="numba is not installed")
    problem = ALL[name]
    piece = problem.pieces[0]
    text = translate.python_source(problem.rates, len(problem.initial), len(piece.parameters))
    rates = numba.njit(compiled(text, "rates"))
    for t, x, p, expected in points(problem, piece, random):
        found = np.full(len(x), np.nan)
        rates(t, x, p, found)
        assert_same(found, expected)


class TestWholeInterval:
    @pytest.mark.parametrize("name", ["disk", "ball"])
    def test_parameters_follow_the_pieces(self, name):
        problem = ALL[name]
        parameters = translate.jax_parameters(problem)
        for piece in problem.pieces:
            for t in (piece.start, (piece.start + piece.end) / 2):
                np.testing.assert_array_equal(parameters(jnp.asarray(t)), piece.parameters)

    def test_a_problem_without_parameters_has_none(self):
        assert translate.jax_parameters(ALL["hires"])(jnp.asarray(3.0)).shape == (0,)

    @pytest.mark.long
    @pytest.mark.parametrize("name", ["disk", "ball"])
    def test_jaxballs_own_form_ends_in_the_reference(self, name):
        problem = ALL[name]
        form = problem.form()
        assert problem.error(form.final(np.asarray(solve(problem, form.field, form.initial)))) < 1e-11

    @pytest.mark.long
    def test_field_with_its_parameters_ends_in_the_reference(self):
        problem = ALL["disk"]
        field, parameters = translate.jax_field(problem.rates), translate.jax_parameters(problem)
        x = solve(problem, lambda t, x, args: field(t, x, parameters(t)), problem.initial)
        assert problem.error(np.asarray(x)) < 1e-11


def solve(problem, field, initial):
    """x at the end by diffrax's Dopri8, which steps to the kinks."""
    controller = diffrax.ClipStepSizeController(
        diffrax.PIDController(rtol=1e-13, atol=1e-13), jump_ts=jnp.asarray(problem.kinks)
    )
    return diffrax.diffeqsolve(
        diffrax.ODETerm(field),
        diffrax.Dopri8(),
        problem.start,
        problem.end,
        None,
        jnp.asarray(initial),
        stepsize_controller=controller,
    ).ys[-1]


class TestGeneratedPython:
    def test_what_occurs_twice_is_computed_once(self):
        def g(t, x, p, functions):
            return [functions.sin(x[0] * x[1]) + x[1] * x[0], functions.sin(x[1] * x[0]) / 3]

        text = translate.python_source(g, 2, 0)
        assert text.count("sin(") == 1
        assert text.count(" * ") == 1

    def test_what_no_result_needs_is_left_out(self):
        def g(t, x, p, functions):
            functions.cos(x[0])
            return [x[0] * 2]

        assert "cos" not in translate.python_source(g, 1, 0)

    @pytest.mark.parametrize(
        "expression",
        [
            lambda a, b: -a + (2 - b) - (a - 1.5),
            lambda a, b: (a / b) * (3 / a) + b / 4,
            lambda a, b: 0 * a + 1 * b + a * 1 - 0 + b / 1 - 0.0 * b,
            lambda a, b: (a - -2.5) * (-1.25) - b,
            lambda a, b: (a - b) - (b - a) / (a / b),
        ],
    )
    def test_arithmetic_and_its_derivative(self, expression):
        def g(t, x, p, functions):
            return [expression(*x)]

        value, slopes = np.empty(1), np.empty((1, 2))
        compiled(translate.python_source(g, 2, 0), "rates")(0.0, (1.7, 0.6), (), value)
        compiled(translate.jacobian_source(g, 2, 0), "jacobian")(0.0, (1.7, 0.6), (), slopes)
        a, b = jnp.asarray(1.7), jnp.asarray(0.6)
        expected = [expression(a, b), *jax.grad(expression, argnums=(0, 1))(a, b)]
        np.testing.assert_allclose([*value, *slopes[0]], expected, rtol=1e-14, atol=1e-15)

    def test_constant_result(self):
        def g(t, x, p, functions):
            return [1.5, x[0]]

        value, slopes = np.empty(2), np.empty((2, 1))
        compiled(translate.python_source(g, 1, 0), "rates")(0.0, (0.25,), (), value)
        compiled(translate.jacobian_source(g, 1, 0), "jacobian")(0.0, (0.25,), (), slopes)
        assert value.tolist() == [1.5, 0.25]
        assert slopes.tolist() == [[0.0], [1.0]]
