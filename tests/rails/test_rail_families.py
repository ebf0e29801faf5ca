"""Every rail family against symbolic derivatives of its formula, and properties that all of them share."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import sympy
from hypothesis import given, strategies as st
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import jaxball
from tests.support.precision import differences_need_float64, scaled
from tests.support.sentences import refuses
from tests.support.systems import rails

pytestmark = pytest.mark.any_precision

THETA = sympy.Symbol("theta")
ANGLES = np.linspace(-7.0, 7.0, 29)
CENTRE = (0.1, -0.2, 0.05)
TURN = Rotation.from_rotvec([0.3, -0.8, 0.5])
FRAME = jaxball.physics.VersorFrame(np.roll(TURN.as_quat(), 1))
COSINES = np.array([[0.3, 0.1, -0.2], [0.05, -0.1, 0.02]])
SINES = np.array([[-0.1, 0.4, 0.3], [0.1, 0.05, -0.07]])

derivatives = jax.jit(jax.vmap(lambda rail, theta: rail.derivatives(theta), in_axes=(None, 0)))


def in_plane(x, y):
    """The planar curve (x, y) in the first and third axes of ``FRAME``, by SciPy's rotation."""
    B = sympy.Matrix(TURN.as_matrix())
    return sympy.Matrix(CENTRE) + B * sympy.Matrix([x, 0, y])


def lemniscate(a):
    """From the implicit equation in polar form: ρ² = a² cos 2α, along tan α = sin θ."""
    alpha = sympy.atan(sympy.sin(THETA))
    rho = a * sympy.cos(THETA) / sympy.sqrt(1 + sympy.sin(THETA) ** 2)
    return rho * sympy.cos(alpha), rho * sympy.sin(alpha)


def helix(theta, pitch):
    """A rail that is not closed."""
    return jnp.stack([jnp.cos(theta), jnp.sin(theta), pitch * theta])


c, s = sympy.cos, sympy.sin
DIRECTION = np.array([1.0, -2.0, 2.0])
FAMILIES = {
    "circle": (jaxball.Circle(0.7, CENTRE, FRAME), in_plane(0.7 * c(THETA), 0.7 * s(THETA))),
    "ellipse": (jaxball.Ellipse([0.7, 0.4], CENTRE, FRAME), in_plane(0.7 * c(THETA), 0.4 * s(THETA))),
    "gerono": (jaxball.physics.GeronoEight([0.7, 0.4], CENTRE, FRAME), in_plane(0.7 * c(THETA), 0.4 * s(2 * THETA))),
    "bernoulli": (jaxball.physics.BernoulliEight(0.7, CENTRE, FRAME), in_plane(*lemniscate(0.7))),
    "tube": (jaxball.Tube(DIRECTION, CENTRE), sympy.Matrix(CENTRE) + THETA * sympy.Matrix(DIRECTION / 3)),
    "fourier": (
        jaxball.FourierRail(COSINES, SINES, CENTRE),
        sympy.Matrix(CENTRE)
        + sum(
            (sympy.Matrix(COSINES[k - 1]) * c(k * THETA) + sympy.Matrix(SINES[k - 1]) * s(k * THETA) for k in (1, 2)),
            sympy.zeros(3, 1),
        ),
    ),
    "function": (
        jaxball.FunctionRail(helix, jnp.asarray(0.3)),
        sympy.Matrix([c(THETA), s(THETA), sympy.Float(0.3) * THETA]),
    ),
}


def symbolic(formula):
    """ζ, ζ′ and ζ″ at ``ANGLES`` from a column of symbolic expressions."""
    found = []
    for order in range(3):
        column = formula.diff(THETA, order) if order else formula
        evaluate = sympy.lambdify(THETA, list(column), "numpy")
        found.append(np.array([np.broadcast_to(part, ANGLES.shape) for part in evaluate(ANGLES)], float).T)
    return found


@pytest.mark.thorough
@pytest.mark.parametrize("family", sorted(FAMILIES))
def test_a_rail_and_its_derivatives_are_those_of_its_formula(family):
    """Rounding of sines and of sums of a few terms: 1e-13."""
    rail, formula = FAMILIES[family]
    for found, expected in zip(derivatives(rail, jnp.asarray(ANGLES)), symbolic(formula), strict=True):
        np.testing.assert_allclose(found, expected, atol=scaled(1e-13))


@pytest.mark.parametrize("family", sorted(FAMILIES))
def test_a_prepared_rail_is_the_same_rail(family):
    rail, _ = FAMILIES[family]
    for found, expected in zip(
        derivatives(rail.prepare(), jnp.asarray(ANGLES)), derivatives(rail, jnp.asarray(ANGLES)), strict=True
    ):
        np.testing.assert_allclose(found, expected, atol=scaled(1e-14))


def test_the_lemniscate_has_the_foci_of_bernoulli():
    """The product of the distances to (±a/√2, 0) is a²/2."""
    a = 0.8
    points = np.asarray(jaxball.physics.BernoulliEight(a).points(jnp.asarray(ANGLES)))
    foci = np.array([[a / np.sqrt(2), 0, 0], [-a / np.sqrt(2), 0, 0]])
    distances = [np.linalg.norm(points - focus, axis=1) for focus in foci]
    np.testing.assert_allclose(distances[0] * distances[1], a**2 / 2, atol=scaled(1e-14))


@pytest.mark.thorough
def test_the_spline_is_scipys_periodic_cubic():
    points = np.random.default_rng(71).uniform(-0.6, 0.6, (7, 3))
    rail = jaxball.SplineRail(points)
    knots = np.linspace(0, 2 * np.pi, 8)
    spline = CubicSpline(knots, np.concatenate([points, points[:1]]), bc_type="periodic")
    inside = np.setdiff1d(np.linspace(-7, 7, 57), knots)
    for order, found in enumerate(derivatives(rail.prepare(), jnp.asarray(inside))):
        np.testing.assert_allclose(found, spline(np.mod(inside, 2 * np.pi), order), atol=scaled(1e-12))
    np.testing.assert_allclose(rail.points(jnp.asarray(knots[:-1])), points, atol=scaled(1e-14))
    np.testing.assert_allclose(
        derivatives(rail, jnp.asarray(inside))[0], spline(np.mod(inside, 2 * np.pi)), atol=scaled(1e-12)
    )


EVERY = [*rails(np.random.default_rng(72)), *(rail for rail, _ in FAMILIES.values())]
JITTED = [jax.jit(lambda theta, rail=rail: rail.prepare().derivatives(theta)) for rail in EVERY]
angles = st.floats(-20, 20, allow_subnormal=False)


@pytest.mark.thorough
@given(st.sampled_from(range(len(EVERY))), angles)
def test_a_closed_rail_repeats_itself_after_its_period(index, theta):
    rail, at = EVERY[index], JITTED[index]
    if rail.period is None:
        assert isinstance(rail, jaxball.Tube | jaxball.FunctionRail)
        return
    for now, later in zip(at(theta)[:2], at(theta + rail.period)[:2], strict=True):
        np.testing.assert_allclose(later, now, atol=scaled(1e-11))


@pytest.mark.thorough
@differences_need_float64
@given(st.sampled_from(range(len(EVERY))), angles)
def test_slopes_are_those_of_chords(index, theta):
    """Central differences of ζ and ζ′: the error is of second order in the step of 1e-5."""
    at, h = JITTED[index], 1e-5
    before, here, after = (at(theta + step) for step in (-h, 0.0, h))
    np.testing.assert_allclose((after[0] - before[0]) / (2 * h), here[1], atol=1e-8)
    # The spline's ζ″ has corners at its points, where the difference errs in first order.
    np.testing.assert_allclose((after[1] - before[1]) / (2 * h), here[2], atol=1e-4)


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: jaxball.FourierRail(np.zeros((2, 3)), np.zeros((3, 3))), "cosine"),
        (lambda: jaxball.SplineRail(np.zeros((2, 3))), "points_on_rail"),
    ],
)
def test_shapes_that_do_not_fit_are_refused_in_a_sentence(make, named):
    with refuses(ValueError, named):
        make()
