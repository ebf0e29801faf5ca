"""The numerical differentiation formulas at each order: polynomials, geometric sequences, stability, convergence."""

import functools

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.simulation.solvers import MassMatrixTerm
from jaxball.simulation.solvers.differences import (
    HARMONIC_SUMS,
    HIGHEST_BDF,
    KAPPAS as VALUES,
    ndf_error_constants,
    resample,
)
from tests.solvers import rotating
from tests.solvers.fixed_steps import FRACTIONS, observed_order
from tests.solvers.linear_fields import rotation
from tests.solvers.ndf_steps import KAPPAS, ROWS, at_order, backward_differences, state_of, step

ORDERS = range(1, 6)
DISTANCE = 0.1
PAST = 2.0 - DISTANCE * np.arange(ROWS)


def polynomial(degree):
    return np.polynomial.Polynomial(np.random.default_rng(degree).normal(size=degree + 1), domain=[0, 3])


def padded(p):
    """The coefficients of a polynomial, the highest power first."""
    coefficients = np.zeros(ROWS)
    own = p.convert(domain=[-1, 1], window=[-1, 1]).coef[::-1]
    coefficients[ROWS - len(own) :] = own
    return coefficients


@functools.partial(jax.jit, static_argnums=0)
def polynomial_step(kappa, state, t0, t1, y0, coefficients):
    """A step where the slope is a polynomial, its estimated error, and its dense output at some fractions."""
    y1, error, between, _ = step(kappa, lambda t, y, c: jnp.polyval(c, t)[None], state, t0, t1, y0, coefficients)
    return y1[0], error, jax.vmap(between.evaluate)(t0 + FRACTIONS * (t1 - t0))[:, 0]


def stepped(kappa, order, solution, length):
    """:func:`polynomial_step` of a solution that is known at points of one distance, and how much it rounds."""
    state, slope = state_of(solution(PAST), DISTANCE, order), padded(solution.deriv())
    times = jnp.asarray(PAST[0]), jnp.asarray(PAST[0] + length)
    rounding = 1e-13 * (1 + np.polyval(np.abs(slope), times[1]))
    return polynomial_step(kappa, state, *times, jnp.asarray(solution(PAST[:1])), jnp.asarray(slope)), rounding


@pytest.mark.thorough
@pytest.mark.parametrize("kappa", KAPPAS)
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("length", [0.1, 0.17, 0.03])
def test_exact_where_the_solution_is_a_polynomial_of_the_order(kappa, order, length):
    """Between the ends as well, and where the distance of the points changes."""
    solution = polynomial(order)
    (y1, error, within), rounding = stepped(kappa, order, solution, length)
    np.testing.assert_allclose(y1, solution(PAST[0] + length), rtol=0, atol=rounding)
    np.testing.assert_allclose(within, solution(PAST[0] + FRACTIONS * length), rtol=0, atol=rounding)
    assert error < rounding


@pytest.mark.parametrize("kappa", KAPPAS)
@pytest.mark.parametrize("order", ORDERS)
def test_error_where_the_solution_is_a_polynomial_of_one_degree_more(kappa, order):
    """The formula misses C ∇ᵏ⁺¹x of the solution, and the state has (1 − κ) γ_k in it: C = κ γ_k + 1/(k + 1).

    The estimate is C times what the prediction lacks, which is ∇ᵏ⁺¹x and the error of the step.
    """
    solution = polynomial(order + 1)
    end = PAST[0] + DISTANCE
    (y1, error, _), rounding = stepped(kappa, order, solution, DISTANCE)
    last = backward_differences(solution(np.concatenate([[end], PAST])))[order + 1]
    share = VALUES[kappa][order] * HARMONIC_SUMS[order]
    miss = (share + 1 / (order + 1)) * last / (HARMONIC_SUMS[order] - share)
    np.testing.assert_allclose(y1 - solution(end), miss, rtol=1e-6, atol=rounding)
    size = abs((share + 1 / (order + 1)) * (last + miss)) / (1 + max(abs(solution(PAST[0])), abs(y1)))
    np.testing.assert_allclose(error, size, rtol=1e-6, atol=rounding)


def test_constants_of_the_error_are_those_that_are_published():
    """Shampine & Reichelt (1997), table 1, says by how much longer steps are: (C_BDF/C)^1/(k+1)."""
    ratio = (ndf_error_constants("bdf") / ndf_error_constants("ndf")) ** (1 / np.arange(1, 7))
    np.testing.assert_allclose(100 * (ratio[1:] - 1), [26, 26, 26, 12, 0], rtol=0, atol=0.5)


def test_differences_for_points_at_another_distance_and_elsewhere():
    """They are those of the values of the polynomial there."""
    p, ratio, shift = polynomial(5), 1.7, 0.2
    differences = jnp.asarray(backward_differences(p(PAST))[:6, None])
    moved = PAST[0] + DISTANCE * (shift - ratio * np.arange(6))
    np.testing.assert_allclose(
        resample(differences, jnp.asarray(ratio), shift)[:, 0], backward_differences(p(moved)), rtol=0, atol=1e-11
    )


def formula(kappa, order, r):
    """The z for which y_m = rᵐ solves the formula: ∇ʲy = (1 − 1/r)ʲ y."""
    w = 1 - 1 / r
    return sum(w**j / j for j in range(1, order + 1)) - VALUES[kappa][order] * HARMONIC_SUMS[order] * w ** (order + 1)


@functools.partial(jax.jit, static_argnums=0)
def rotated(kappa, state, y0, z):
    return step(kappa, rotation, state, jnp.asarray(0.0), jnp.asarray(1.0), y0, z)[0]


def parts(z):
    return np.stack([np.real(z), np.imag(z)], axis=-1)


@pytest.mark.thorough
@pytest.mark.parametrize("kappa", KAPPAS)
@pytest.mark.parametrize("order", ORDERS)
def test_geometric_sequences_solve_the_formula(kappa, order):
    """For every complex r, which is to say that the coefficients are those of the formula."""
    for r in (0.7, 1.3, -0.8, 0.9j, 1.1 + 0.4j, 0.6 - 0.7j):
        y1 = rotated(
            kappa, state_of(parts(r ** -np.arange(ROWS)), 1.0, order), np.eye(2)[0], parts(formula(kappa, order, r))
        )
        np.testing.assert_allclose(y1, parts(r), rtol=0, atol=1e-13)


@functools.partial(jax.jit, static_argnums=0)
def amplifications(kappa, order, zs):
    """The matrices by which a step takes the differences of y′ = zy, as complex numbers, to those at its end."""

    def image(row, z):
        differences = jnp.eye(HIGHEST_BDF + 1)[row][:, None] * jnp.asarray([[1.0, 0.0]])
        state = state_of(np.zeros((ROWS, 2)), 1.0, 1)._replace(differences=differences, order=order)
        _, _, _, after = step(kappa, rotation, state, jnp.asarray(0.0), jnp.asarray(1.0), differences[0], z)
        return after.differences

    images = jax.vmap(image, (0, None), 1)
    return jax.vmap(images, (None, 0))(jnp.arange(HIGHEST_BDF + 1), zs)


def growth(kappa, order, z):
    """The largest root of the formula at each of some z, by the method's own steps."""
    matrices = np.asarray(amplifications(kappa, jnp.asarray(order), parts(z)))
    matrices = (matrices[..., 0] + 1j * matrices[..., 1])[:, : order + 1, : order + 1]
    return np.max(np.abs(np.linalg.eigvals(matrices)), axis=1)


# In degrees: Hairer & Wanner II (1996), table V.2.1; Shampine & Reichelt (1997), table 1, in whole degrees.
ANGLES = {
    "bdf": ([90.0, 90.0, 86.03, 73.35, 51.84], 0.02),
    "ndf": ([90.0, 90.0, 80.0, 66.0, 51.0], 1.0),
}
RADII = np.geomspace(1e-2, 1e3, 700)


@pytest.mark.thorough
@pytest.mark.parametrize("kappa", KAPPAS)
@pytest.mark.parametrize("order", ORDERS)
def test_angle_of_stability_is_the_published_one(kappa, order):
    angles, accuracy = ANGLES[kappa]

    def largest(angle):
        return np.max(growth(kappa, order, -RADII * np.exp(-1j * np.deg2rad(angle))))

    angle = angles[order - 1]
    if angle == 90:
        assert largest(90.0) < 1 + 1e-12
        assert largest(60.0) < 1
    else:
        assert largest(angle - accuracy) < 1
        assert largest(angle + accuracy) > 1


@pytest.mark.thorough
@pytest.mark.parametrize("kappa", KAPPAS)
@pytest.mark.parametrize("order", ORDERS)
def test_stiffest_components_are_damped_at_once(kappa, order):
    """Every root tends to zero, where k + 1 of them meet, so that they do so as 1/z to the power 1/(k + 1)."""
    assert np.all(growth(kappa, order, np.full(len(RADII), -1e12)) < 2e-2)


def behind(exact, order, args, length, term=None):
    """The state of a run at 0 after steps of some length."""
    return state_of([exact(t, args) for t in -length * np.arange(ROWS)], length, order, term)


ODE = diffrax.ODETerm(rotating.field)
DAE = MassMatrixTerm(rotating.field_with_algebraic, np.array([0.0, 1.0, 1.0]))


@eqx.filter_jit
def march(kappa, term, state, order, ends, count, y, args):
    """The state at the last of so many steps to some ``ends``, which are times, and within it."""

    def one(i, carry):
        y, state, _ = carry
        t0, t1 = ends[i], ends[i + 1]
        y, _, between, state = step(kappa, term, at_order(state, order), t0, t1, y, args)
        return y, state, jax.vmap(between.evaluate)(t0 + FRACTIONS * (t1 - t0))

    y, _, within = jax.lax.fori_loop(0, count, one, (y, state, jnp.zeros((len(FRACTIONS), *y.shape))))
    return y, within


OMEGA = 3.0
# Of runs of length ½, before errors are those of rounding.
COUNTS = {1: (150, 200, 300), 2: (60, 90, 120), 3: (40, 60, 80), 4: (40, 60, 80), 5: (40, 60, 80)}
MOST = 300


@eqx.filter_jit
def truth_within(exact, t0, t1, args):
    return jax.vmap(lambda t: exact(t, args))(t0 + FRACTIONS * (t1 - t0)), exact(t1, args)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("kappa", "term", "exact"),
    [*((kappa, ODE, rotating.exact) for kappa in KAPPAS), ("ndf", DAE, rotating.exact_with_algebraic)],
)
@pytest.mark.parametrize("order", ORDERS)
def test_runs_at_each_order(kappa, order, term, exact):
    """All variables have it, the algebraic one too, at the end and within the steps, whose lengths change once."""
    args, ends, within = jnp.array([OMEGA, 0.3]), [], []
    for count in COUNTS[order]:
        lengths = np.resize([1.0], count)
        lengths[count // 2 :] = 1.25
        times = np.zeros(MOST + 1)
        times[1 : count + 1] = np.cumsum(0.5 * lengths / lengths.sum())
        state, start = behind(exact, order, args, times[1], term), exact(jnp.asarray(0.0), args)
        numbers = map(jnp.asarray, (order, times, count))
        y, between = march(kappa, term, state, *numbers, start, args)
        truth, end = truth_within(exact, *map(jnp.asarray, times[count - 1 : count + 1]), args)
        ends.append(np.abs(y - end))
        within.append(np.max(np.abs(between - truth), axis=0))
    for errors in (ends, within):
        sizes = np.linalg.norm(errors, axis=1)
        assert observed_order(1 / np.array(COUNTS[order]), sizes) == pytest.approx(order, abs=0.35)
