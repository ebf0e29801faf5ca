"""The formulas of the Adams method at each order: polynomials, coefficients, stability, orders of convergence.

The coefficients of the Adams formulas for equal steps come from integrals of Lagrange's polynomials in fractions.
"""

from fractions import Fraction

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.simulation.solvers.differences import Points, adams_error_constants, fold, unfold
from tests.solvers import rotating
from tests.solvers.adams_steps import ROWS, state_of, step
from tests.solvers.fixed_steps import FRACTIONS, observed_order
from tests.solvers.linear_fields import rotation

ORDERS = range(1, 13)
# Of no special lengths: one step is fifteen times as long as another.
LENGTHS = np.array([0.1, 0.12, 0.06, 0.13, 0.3, 0.1, 0.02, 0.09, 0.11, 0.2, 0.1, 0.15])
UNEVEN = 2.0 - np.concatenate([[0.0], np.cumsum(LENGTHS)])
EVEN = -np.arange(ROWS, dtype=float)


def integrals_of_lagrange(points):
    """∫₀¹ of each of Lagrange's polynomials through some whole numbers."""
    integrals = []
    for i, at in enumerate(points):
        coefficients = [Fraction(1)]
        for other in points[:i] + points[i + 1 :]:
            shifted = [Fraction(0), *coefficients]
            padded = [*(Fraction(-other) * c for c in coefficients), Fraction(0)]
            coefficients = [(a + b) / Fraction(at - other) for a, b in zip(shifted, padded, strict=True)]
        integrals.append(sum(c / (power + 1) for power, c in enumerate(coefficients)))
    return integrals


def bashforth(k):
    """The coefficients of f_n, f_{n−1}, … in the explicit formula with k points."""
    return integrals_of_lagrange([-i for i in range(k)])


def moulton(k):
    """The coefficients of f_{n+1}, f_n, … in the implicit formula with k points before the end."""
    return integrals_of_lagrange([1 - i for i in range(k + 1)])


@eqx.filter_jit
def polynomial_step(state, t0, t1, y0, coefficients):
    """A step of the integral of a polynomial, and its dense output at some fractions."""
    y1, error, between, _ = step(lambda t, y, args: jnp.polyval(args, t)[None], state, t0, t1, y0, coefficients)
    return y1, error, jax.vmap(between.evaluate)(t0 + FRACTIONS * (t1 - t0))


@pytest.mark.thorough
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize(("times", "length"), [(UNEVEN, 0.17), (UNEVEN, 0.017), (2.0 + 0.1 * EVEN, 0.1)])
def test_exact_where_the_slope_is_a_polynomial_of_the_order(order, times, length):
    """Local extrapolation makes the result exact for slopes of degree k, the prediction is so for those of k − 1."""
    slope = np.polynomial.Polynomial(np.random.default_rng(order).normal(size=order + 1), domain=[0, 3])
    solution, t0, t1 = slope.integ(), times[0], times[0] + length
    padded = np.zeros(ROWS)
    padded[ROWS - order - 1 :] = slope.convert(domain=[-1, 1], window=[-1, 1]).coef[::-1]
    state = state_of(times, slope(times), order)
    y1, _, within = polynomial_step(state, *map(jnp.asarray, (t0, t1)), solution(t0)[None], jnp.asarray(padded))
    # Values of the polynomial in powers of t round by some thousand times as much as itself.
    rounding = 1e-15 * np.polyval(np.abs(padded), t1)
    np.testing.assert_allclose(y1[0], solution(t1), rtol=0, atol=rounding)
    np.testing.assert_allclose(within[:, 0], solution(t0 + FRACTIONS * length), rtol=0, atol=rounding)


def test_error_is_that_of_the_prediction_corrected_without_extrapolation():
    """For a slope of degree k, it is what the formula with k points and the end's slope, of order k, lacks."""
    t0, t1, y0 = UNEVEN[0], UNEVEN[0] + 0.17, np.ones(1)
    for order in range(2, 9):
        slope = np.polynomial.Polynomial([0.0] * order + [1.0]).convert(domain=[1, 2], window=[-1, 1])
        nodes = np.concatenate([[t1], UNEVEN[: order - 1]])
        through = np.polynomial.Polynomial.fit(nodes, slope(nodes), order - 1).integ()
        truth = (slope.integ()(t1) - slope.integ()(t0)) - (through(t1) - through(t0))
        coefficients = np.zeros(ROWS)
        coefficients[ROWS - order - 1 :] = slope.convert(domain=[-1, 1]).coef[::-1]
        state = state_of(UNEVEN, slope(UNEVEN), order)
        y1, error, _ = polynomial_step(state, *map(jnp.asarray, (t0, t1, y0, coefficients)))
        size = abs(truth) / (1 + max(1.0, abs(float(y1[0]))))
        np.testing.assert_allclose(error, size, rtol=1e-7)


@pytest.mark.thorough
@pytest.mark.parametrize("order", ORDERS)
def test_integrals_for_equal_steps_give_the_coefficients_of_bashforth_and_moulton(order):
    """They are weights of backward differences, and those are ∇ʲf = Σ (−1)ⁱ (j over i) f_{n−i}."""
    g = np.asarray(Points(jnp.asarray(-EVEN), jnp.asarray(1.0)).integrals())
    binomial = np.array([[(-1) ** i * _binomial(j, i) for i in range(ROWS)] for j in range(ROWS)])
    np.testing.assert_allclose(g[:order] @ binomial[:order, :order], np.array(bashforth(order), float), rtol=1e-12)
    constants = np.array([1.0, *(-adams_error_constants(ROWS)[1:])])
    np.testing.assert_allclose(
        constants[: order + 1] @ binomial[: order + 1, : order + 1], np.array(moulton(order), float), rtol=1e-12
    )


def _binomial(n, k):
    return 0 if k > n else int(np.prod([Fraction(n - i, i + 1) for i in range(k)])) if k else 1


@jax.jit
def map_of_step(order, z):
    """The complex matrix by which a step takes the state and its differences to those at its end."""

    def image(row):
        basis = jnp.eye(ROWS + 1)[row]
        parts = jnp.stack([basis, jnp.zeros_like(basis)], axis=1)
        state = state_of(EVEN, np.zeros((ROWS, 2)), order)._replace(differences=fold(parts[1:]))
        y1, _, _, after = step(rotation, state, jnp.asarray(0.0), jnp.asarray(1.0), parts[0], z)
        return jnp.concatenate([y1[None], unfold(after.differences, 2)])

    return jax.vmap(image)(jnp.arange(ROWS + 1))


# In the complex plane, inside of the regions of stability and outside.
Z = [-0.3, -1.1, -1.9, 0.2, 0.4j, -0.2 + 0.9j, -0.7 - 0.3j, 1e-3j]


@pytest.mark.parametrize("order", ORDERS)
def test_stability_polynomial_is_that_of_predictor_and_corrector_in_mode_pece(order):
    """With ŷ = y_n + z Σ b*_i y_{n−i}, y_{n+1} = y_n + z β ŷ + z Σ b_i y_{n−i}: Lambert (1973), section 3.11."""
    explicit, (end, *implicit) = np.array(bashforth(order), float), np.array(moulton(order), float)
    for z in Z:
        columns = np.asarray(map_of_step(jnp.asarray(order), jnp.array([np.real(z), np.imag(z)])))
        matrix = (columns[..., 0] + 1j * columns[..., 1])[: order + 1, : order + 1].T
        coefficients = -(z * np.array(implicit) + z**2 * end * explicit).astype(complex)
        coefficients[0] -= 1 + z * end
        polynomial = np.concatenate([[1.0], coefficients])
        for r in 1.2 * np.exp(2j * np.pi * np.arange(5) / 5):
            # The slope at the start is a variable of its own, and adds a root at zero.
            truth = r * np.polyval(polynomial, r)
            size = r * np.polyval(np.abs(polynomial), abs(r))
            assert abs(np.linalg.det(r * np.eye(order + 1) - matrix) - truth) < 1e-11 * abs(size) * 2**order


def test_order_one_is_as_stable_as_the_method_of_heun():
    """|1 + z + z²/2| ≤ 1, a region that ends at −2 on the real axis."""
    for z in (-1.99, -2.01, 1.7j, -1 + 1.7j):
        columns = np.asarray(map_of_step(jnp.asarray(1), jnp.array([np.real(z), np.imag(z)])))
        matrix = (columns[..., 0] + 1j * columns[..., 1])[:2, :2].T
        roots = np.linalg.eigvals(matrix)
        np.testing.assert_allclose(np.max(np.abs(roots)), abs(1 + z + z**2 / 2), rtol=1e-13)


# With three of these lengths after each other, steps are never equal.
PATTERNS = {"equal": np.ones(3), "uneven": np.array([1.0, 0.8, 1.15])}
OMEGA, SHARE = 10.0, 0.3
MOST = 252


def behind(order, args, pattern, length):
    """The state of a run at 0 after steps of a pattern, the longest of some length."""
    lengths = np.resize(PATTERNS[pattern][::-1], ROWS - 1)
    past = -np.cumsum(np.concatenate([[0.0], lengths])) * length / lengths.max()
    slopes = [rotating.field(t, rotating.exact(t, args), args) for t in past]
    return state_of(past, slopes, order)


@jax.jit
def march(state, order, ends, count, y, args):
    """The state at the last of so many steps to some ``ends``, which are times, and its estimated error."""

    def one(i, carry):
        y, state, _ = carry
        y, error, _, state = step(rotating.field, state._replace(order=order), ends[i], ends[i + 1], y, args)
        return y, state, error

    y, _, error = jax.lax.fori_loop(0, count, one, (y, state, jnp.zeros(())))
    return y, error


def errors_of(order, args, pattern, ends):
    """The error at the last of ``ends``, and the one that the last step estimates."""
    args = jnp.array(args)
    state = behind(order, args, pattern, np.max(np.diff(ends)))
    padded, count = np.zeros(MOST + 1), len(ends) - 1
    padded[: count + 1] = ends
    y, estimate = march(state, *map(jnp.asarray, (order, padded, count)), rotating.exact(0.0, args), args)
    return np.linalg.norm(y - rotating.exact(ends[-1], args)), estimate


@pytest.mark.thorough
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("pattern", PATTERNS)
def test_one_step_at_each_order(order, pattern):
    """Its error is of order k + 2; the one that it estimates, of the formula that it extrapolates, of order k + 1."""
    lengths = np.array([0.3, 0.2, 0.15]) / OMEGA
    rows = [errors_of(order, (OMEGA, SHARE), pattern, np.array([0.0, h])) for h in lengths]
    errors, estimates = np.array(rows).T
    assert observed_order(lengths, errors) == pytest.approx(order + 2, abs=0.6)
    assert observed_order(lengths, estimates) == pytest.approx(order + 1, abs=1.0)


# Of runs of length 1 at one order. At orders 11 and 12, those with errors above rounding are not stable.
RUNS = {order: (10.0, (150, 201, 252)) if order < 9 else (3.0, (30, 42, 54)) for order in range(1, 11)}


@pytest.mark.thorough
@pytest.mark.parametrize("order", RUNS)
@pytest.mark.parametrize("pattern", PATTERNS)
def test_runs_at_each_order(order, pattern):
    omega, counts = RUNS[order]
    errors = []
    for count in counts:
        lengths = np.resize(PATTERNS[pattern], count)
        ends = np.concatenate([[0.0], np.cumsum(lengths / lengths.sum())])
        errors.append(errors_of(order, (omega, SHARE), pattern, ends)[0])
    assert observed_order(1 / np.array(counts), errors) == pytest.approx(order + 1, abs=0.35)


@pytest.mark.thorough
@pytest.mark.parametrize("order", [3, 9])
def test_a_step_over_a_jump_of_the_field_has_an_error_that_says_so(order):
    """ẏ = −sgn y from h/2 on: y is 0 at the end, and the correction goes there and back.

    The step is short beside those before, so that the formulas of two orders agree about it.
    """
    h, state = 1e-3, state_of(0.1 * EVEN, -np.ones(ROWS), order)
    y1, error, _, _ = step(
        lambda t, y, args: -jnp.sign(y), state, jnp.asarray(0.0), jnp.asarray(h), jnp.array([0.5 * h])
    )
    wrong = abs(float(y1[0]))
    assert wrong > 0.05 * h
    assert wrong < 30 * float(error)
