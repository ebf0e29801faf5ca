"""The benchmark's problems against published end states, collocation in many digits, and the paper's equations."""

import math
import re

import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from comparison import translate
from comparison.problems import ALL
from scipy.integrate import solve_ivp

import jaxball
from jaxball import paper
from jaxball.physics.system import vector_field
from tests.support import collocation, direct_sum
from tests.support.paper import BALL_DIRECTIONS, BALL_RADII, reference
from tests.support.sentences import refuses

# Mazzia & Magherini, Test Set for IVP Solvers, release 2.4 (2008), subroutine solut of each problem, and how far
# they are from the solution of the equations with constants in float64.
PUBLISHED = {
    "robertson": ((0.2083340149701255e-7, 0.8333360770334713e-13, 0.9999999791665050), 2e-14),
    "robertson-dae": ((0.2083340149701255e-7, 0.8333360770334713e-13, 0.9999999791665050), 2e-14),
    "van-der-pol": ((0.1706167732170469e1, -0.8928097010248125e-3), 5e-15),
    "van-der-pol-scaled": ((0.1706167732170483e1, -0.8928097010247975e0), 3e-14),
    "hires": (
        (
            0.7371312573325668e-3,
            0.1442485726316185e-3,
            0.5888729740967575e-4,
            0.1175651343283149e-2,
            0.2386356198831331e-2,
            0.6238968252742796e-2,
            0.2849998395185769e-2,
            0.2850001604814231e-2,
        ),
        2e-13,
    ),
    "orego": ((0.1000814870318523e1, 0.1228178521549917e4, 0.1320554942846706e3), 2e-13),
}
# In many digits, which takes long for all but one.
COLLOCATED = [
    "robertson",
    *(pytest.param(name, marks=pytest.mark.slow) for name in ("van-der-pol-scaled", "hires", "van-der-pol", "orego")),
]
PAPER = ("disk", "ball")
DAES = [name for name, problem in ALL.items() if problem.constraint is not None]
BALL_DAES = [name for name in DAES if name.startswith("ball")]


def jacobian_of(problem):
    """∂f/∂x of an autonomous problem, from the generated code."""
    n = len(problem.initial)
    space = {}
    exec(translate.jacobian_source(problem.rates, n, 0), space)

    def jacobian(x):
        J = np.empty((n, n))
        space["jacobian"](0.0, x, (), J)
        return J

    return jacobian


def integrate(problem, tolerance=1e-13):
    """x(t) on each piece, by SciPy's DOP853, with the rates in ``math``; for a DAE, of the ODE that it comes from."""
    x, solutions = np.array(problem.initial), []
    for piece in problem.pieces:
        solution = solve_ivp(
            lambda t, x, p: problem.rates(t, list(x), p, math),
            (piece.start, piece.end),
            x,
            method="DOP853",
            args=(piece.parameters,),
            rtol=tolerance,
            atol=tolerance,
            dense_output=True,
        )
        x = solution.y[:, -1]
        solutions.append(solution)
    return solutions


class TestEndStates:
    @pytest.mark.parametrize("name", PUBLISHED)
    def test_published(self, name):
        published, agreement = PUBLISHED[name]
        assert ALL[name].error(published) < agreement

    @pytest.mark.long
    @pytest.mark.parametrize("name", COLLOCATED)
    def test_collocation_in_32_digits(self, name):
        problem = ALL[name]
        x = collocation.solve(
            lambda x: problem.rates(0.0, x, (), mp),
            jacobian_of(problem),
            problem.initial,
            problem.start,
            problem.end,
            tolerance=1e-9,
        )
        assert problem.error([float(v) for v in x]) < 2e-15

    @pytest.mark.slow
    def test_hires_with_decimal_constants_is_the_published_one_to_the_last_digit(self):
        problem, space = ALL["hires"], {"mp": mp}
        source = translate.python_source(problem.rates, 8, 0)
        number = r"(?<![\w\[])(\d+\.\d*(?:e-?\d+)?)"
        exec(re.sub(number, r"mp.mpf('\1')", source), space)

        def rates(x):
            result = [None] * 8
            space["rates"](0, x, (), result)
            return result

        decimals = [repr(v) for v in problem.initial]
        x = collocation.solve(rates, jacobian_of(problem), decimals, 0, "321.8122", tolerance=1e-11)
        np.testing.assert_allclose(np.array(x, dtype=float), PUBLISHED["hires"][0], rtol=4e-16)

    @pytest.mark.parametrize("name", PAPER)
    def test_reference_of_the_papers_runs(self, name):
        problem = ALL[name]
        np.testing.assert_array_equal(problem.exact, reference(f"paper_{name}")[0][-1])
        assert problem.error(integrate(problem)[-1].y[:, -1]) < 5e-11

    def test_the_two_forms_of_van_der_pol_are_one_motion(self):
        own, scaled = ALL["van-der-pol"], ALL["van-der-pol-scaled"]
        np.testing.assert_allclose(np.array(own.exact) * [1.0, 1e3], scaled.exact, rtol=4e-16)
        f = own.rates(0.0, [1.3, -0.4e-3], (), math)
        np.testing.assert_allclose(np.array(f) * [1e3, 1e6], scaled.rates(0.0, [1.3, -0.4], (), math), rtol=1e-15)

    def test_orego_and_robertson_rest_where_their_equations_say(self):
        # Oregonator: y1 = y3 and y2 = y1 / (1 + y1); Robertson keeps the mass of its three substances.
        q = 8.375e-6
        y1 = (-q + math.sqrt(q * q + 8 * q)) / (2 * q)  # of q y² + q y − 2 = 0
        np.testing.assert_allclose(ALL["orego"].rates(0.0, [y1, y1 / (1 + y1), y1], (), math), 0.0, atol=1e-10)
        assert sum(ALL["robertson"].rates(0.0, [0.3, 1e-5, 0.7], (), math)) == pytest.approx(0.0, abs=1e-15)


class TestPaper:
    @pytest.mark.thorough
    @pytest.mark.parametrize("t", [0.04, 0.15, 7.0])
    def test_disk_is_jaxballs_moment_form(self, t, random):
        system, problem = paper.disk(), ALL["disk"]
        angles = [mass.motion.schedule.derivatives(jnp.asarray(t)) for mass in system.point_masses]
        phi, phidot = random.normal(size=2)
        x = [*(float(a[0]) for a in angles), *(float(a[1]) for a in angles), phi, phidot]
        rates = problem.rates(t, x, piece_at(problem, t).parameters, math)
        mine = vector_field(system, jnp.asarray(t), jaxball.DiskState(phi, phidot))
        np.testing.assert_allclose(rates[4:8], [float(a[2]) for a in angles], atol=1e-13)
        np.testing.assert_allclose(rates[8:], [phidot, mine.phidot], rtol=1e-12, atol=1e-13)

    @pytest.mark.thorough
    @pytest.mark.parametrize("t", [0.04, 0.15, 7.0])
    def test_ball_is_jaxballs_moment_form(self, t, random):
        system, problem = paper.ball(), ALL["ball"]
        angles = [mass.motion.schedule.derivatives(jnp.asarray(t)) for mass in system.point_masses]
        q, Omega, z = versor(random), random.normal(size=3), random.normal(size=2)
        x = [*(float(a[0]) for a in angles), *(float(a[1]) for a in angles), *q, *Omega, *z]
        rates = problem.rates(t, x, piece_at(problem, t).parameters, math)
        mine = vector_field(system, jnp.asarray(t), jaxball.BallState(q, Omega, z))
        np.testing.assert_allclose(rates[3:6], [float(a[2]) for a in angles], atol=1e-13)
        np.testing.assert_allclose(rates[6:], np.concatenate([mine.q, mine.Omega, mine.z]), rtol=1e-12, atol=1e-13)

    def test_ball_is_the_papers_sum_in_numpy(self, random):
        frames = np.stack([direct_sum.frisvad_frame(*direction) for direction in BALL_DIRECTIONS])
        axes = np.stack([BALL_RADII, BALL_RADII], axis=1)
        parameters = np.ones(4), np.array([0.9, 1.0, 1.1]), 1.0, 1.0, np.array([0.0, 0.0, -0.05]), axes, frames
        for _ in range(10):
            x = np.concatenate([random.normal(size=6), versor(random), random.normal(size=5)])
            u = random.normal()
            expected = direct_sum.driven_ball_field(x, parameters, np.full(3, u))
            found = ALL["ball"].rates(0.0, list(x), (u, 0.0), math)
            np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13)

    @pytest.mark.parametrize("name", PAPER)
    def test_pieces_are_the_papers_push(self, name):
        problem = ALL[name]
        assert (problem.start, problem.kinks, problem.end) == (0.0, (0.1, 0.2), 20.0)
        for t, u in ((0.05, 1.0), (0.15, 0.5), (3.0, 0.0)):
            rates = problem.rates(t, list(problem.initial), piece_at(problem, t).parameters, math)
            n = (len(rates) - {"disk": 2, "ball": 9}[name]) // 2
            np.testing.assert_allclose(np.abs(rates[n : 2 * n]), u, rtol=1e-15)


class TestDaes:
    @pytest.mark.parametrize("name", DAES)
    def test_ends_are_consistent(self, name):
        problem = ALL[name]
        assert problem.constraint(problem.initial) == 0.0
        assert abs(problem.constraint(problem.exact)) < 1e-15

    @pytest.mark.parametrize("name", DAES)
    def test_constraint_stands_where_the_mass_is_zero(self, name, random):
        problem = ALL[name]
        x = list(random.uniform(0.1, 1.0, len(problem.initial)))
        for piece in problem.pieces:
            rates = problem.rates(0.0, x, piece.parameters, math)
            g = problem.right_hand_side(piece)(0.0, x, piece.parameters, math)
            mass = problem.mass(piece)
            assert sum(mass) == len(x) - 1
            assert g == [rate if m else problem.constraint(x) for m, rate in zip(mass, rates, strict=True)]

    @pytest.mark.parametrize("name", DAES)
    def test_constraint_is_kept_by_the_ode(self, name, random):
        # d/dt h(x) = ∇h · f(x) vanishes where h = 0: by differences, exact for a polynomial of degree two.
        problem = ALL[name]
        x = random.uniform(0.1, 1.0, len(problem.initial))
        if name in BALL_DAES:
            x[6:10] = versor(random)
        f = np.array(problem.rates(0.0, list(x), problem.pieces[0].parameters, math))
        step = 1e-3 / np.max(np.abs(f))
        change = problem.constraint(list(x + step * f)) - problem.constraint(list(x - step * f))
        assert abs(change) < 1e-15

    def test_algebraic_component_of_the_ball_stays_away_from_zero(self):
        problem = ALL["ball-dae"]
        for piece, solution in zip(problem.pieces, integrate(problem, 1e-9), strict=True):
            q = solution.sol(np.linspace(piece.start, piece.end, 2001))[piece.algebraic]
            assert np.abs(q).min() > 0.48

    def test_the_papers_own_choice_passes_zero(self):
        problem = ALL["ball-dae-paper"]
        assert {piece.algebraic for piece in problem.pieces} == {6}
        q0 = integrate(problem, 1e-9)[-1].sol(np.array([9.2066, 9.2068]))[6]
        assert q0[0] > 0.0 > q0[1]

    def test_robertsons_dae_has_index_one(self, random):
        constraint = ALL["robertson-dae"].constraint
        x = random.uniform(size=3)
        assert constraint(list(x + np.eye(3)[2])) - constraint(list(x)) == pytest.approx(1.0)


class TestError:
    def test_absolute_and_of_the_measured_components_only(self):
        problem = ALL["ball"]
        x = np.array(problem.exact)
        x[0] += 1.0
        x[7] -= 0.25
        assert problem.error(x) == pytest.approx(0.25, rel=1e-12)

    def test_relative(self):
        problem = ALL["robertson"]
        assert problem.error(np.array(problem.exact) * [1.0, 1.5, 1.25]) == pytest.approx(0.5)

    def test_not_finite_is_infinite(self):
        problem = ALL["hires"]
        assert problem.error([math.nan, *problem.exact[1:]]) == math.inf

    def test_wrong_length_is_refused(self):
        with refuses(ValueError, "x"):
            ALL["orego"].error(np.zeros(4))


@pytest.mark.parametrize("name", ALL)
def test_pieces_join_and_names_are_keys(name):
    problem = ALL[name]
    assert problem.name == name
    assert all(a.end == b.start for a, b in zip(problem.pieces, problem.pieces[1:], strict=False))
    assert len(problem.initial) == len(problem.exact)


@pytest.fixture
def random():
    return np.random.default_rng(2018)


def piece_at(problem, t):
    return next(piece for piece in problem.pieces if piece.start <= t < piece.end)


def versor(random):
    q = random.normal(size=4)
    return q / np.linalg.norm(q)
