"""Schedules against each other, SciPy's splines and quadrature of their accelerations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import CubicSpline

import jaxball
from tests.support.precision import differences_need_float64, scaled
from tests.support.sentences import refuses
from tests.support.systems import schedules, swing

pytestmark = pytest.mark.any_precision

TIMES = np.linspace(-0.5, 2.5, 61)
ROUNDING = scaled(1e-13)


@jax.jit
def rates(schedule, t):
    """θ, θ̇ and θ̈ at many times."""
    return jax.vmap(schedule.prepare().derivatives)(t)


def assert_same(one, other, times=TIMES):
    for found, expected in zip(rates(one, jnp.asarray(times)), rates(other, jnp.asarray(times)), strict=True):
        np.testing.assert_allclose(found, expected, atol=ROUNDING)


def test_the_papers_pulse():
    """``eq_prescribed_u_ball``; θ̇ = 0.15 after it, and θ(20) − θ_a = 2.98833…"""
    t = np.array([0.05, 0.15, 0.3, 20.0])
    theta, thetadot, thetaddot = rates(jaxball.Pulse(0.4), jnp.asarray(t))
    np.testing.assert_allclose(thetaddot, [1, 2 - 10 * 0.15, 0, 0], atol=scaled(1e-14))
    np.testing.assert_allclose(thetadot[2:], 0.15, atol=scaled(1e-15))
    np.testing.assert_allclose(theta[3], 0.4 + 2.98833333333333333, atol=scaled(1e-14))
    np.testing.assert_array_equal(jaxball.Pulse(0.4).kinks(), jnp.asarray([0.0, 0.1, 0.2]))


def test_a_pulse_is_a_piecewise_acceleration():
    pulse = jaxball.Pulse(0.3, height=-1.4, rate=0.6, start=0.2, hold=0.7, end=1.1)
    pieces = jaxball.PiecewiseAcceleration(0.3, [0.2, 0.7, 1.1], [[-1.4, 0.0], [-1.4, 1.4 / 0.4]], 0.6)
    assert_same(pulse, pieces)


def test_an_acceleration_is_integrated_twice():
    """Against adaptive quadrature of the acceleration as it is written: θ̇ = ∫ u, θ = ∫ (t − s) u(s) ds."""
    times, coefficients = np.array([0.1, 0.5, 1.3]), np.array([[0.4, -1.0, 2.0], [-0.7, 0.3, 1.1]])
    schedule = jaxball.PiecewiseAcceleration(0.2, times, coefficients, -0.3)

    def u(s):
        j = np.searchsorted(times, s, side="right") - 1
        return np.polyval(coefficients[j][::-1], s - times[j]) if 0 <= j < 2 else 0.0

    for t in (0.3, 0.9, 2.0):
        theta, thetadot, thetaddot = (float(x[0]) for x in rates(schedule, jnp.asarray([t])))
        points = [p for p in times if p < t]
        gain, _ = quad(u, 0.1, t, points=points, epsabs=1e-13)
        path, _ = quad(lambda s, t=t: (t - s) * u(s), 0.1, t, points=points, epsabs=1e-13)
        np.testing.assert_allclose(thetaddot, u(t), atol=scaled(1e-14))
        np.testing.assert_allclose(thetadot, -0.3 + gain, atol=scaled(1e-12))
        np.testing.assert_allclose(theta, 0.2 - 0.3 * (t - 0.1) + path, atol=scaled(1e-12))
    before = rates(schedule, jnp.asarray([-1.0]))
    np.testing.assert_allclose([x[0] for x in before], [0.2 + 0.3 * 1.1, -0.3, 0.0], atol=scaled(1e-15))


def test_at_a_kink_the_later_side_holds():
    _, _, thetaddot = rates(jaxball.PiecewiseAcceleration(0.0, [0.0, 1.0], [[3.0]]), jnp.asarray([0.0, 1.0]))
    np.testing.assert_array_equal(thetaddot, [3.0, 0.0])


def test_waypoints_are_joined_by_scipys_clamped_cubic():
    times, angles, ends = np.array([0.0, 0.4, 1.3, 2.0]), np.array([0.1, 0.9, -0.4, 0.3]), (0.7, -0.2)
    schedule = jaxball.Waypoints(times, angles, ends)
    spline = CubicSpline(times, angles, bc_type=((1, ends[0]), (1, ends[1])))
    inside = np.linspace(0.0, 1.99, 41)
    for order, found in enumerate(rates(schedule, jnp.asarray(inside))):
        np.testing.assert_allclose(found, spline(inside, order), atol=scaled(1e-12))
    outside = np.array([-0.3, 2.6])
    theta, thetadot, thetaddot = rates(schedule, jnp.asarray(outside))
    np.testing.assert_allclose(theta, [0.1 - 0.3 * 0.7, 0.3 - 0.6 * 0.2], atol=scaled(1e-14))
    np.testing.assert_allclose(thetadot, ends, atol=scaled(1e-14))
    np.testing.assert_array_equal(thetaddot, 0)
    np.testing.assert_array_equal(schedule.kinks(), jnp.asarray(times))


def test_two_waypoints_are_enough():
    found = rates(jaxball.Waypoints([0.0, 2.0], [0.0, 1.0]), jnp.asarray([1.0]))
    np.testing.assert_allclose([x[0] for x in found], [0.5, 0.75, 0.0], atol=scaled(1e-15))


def test_sinusoids_are_the_sum_that_they_say():
    a, w, p = np.array([0.5, -0.2]), np.array([1.3, 2.9]), np.array([0.1, 0.7])
    theta, thetadot, thetaddot = rates(jaxball.Sinusoids(0.3, a, w, p, 0.4), jnp.asarray(TIMES))
    waves = w * TIMES[:, None] + p
    np.testing.assert_allclose(theta, 0.3 + 0.4 * TIMES + np.sin(waves) @ a, atol=ROUNDING)
    np.testing.assert_allclose(thetadot, 0.4 + np.cos(waves) @ (a * w), atol=ROUNDING)
    np.testing.assert_allclose(thetaddot, -np.sin(waves) @ (a * w**2), atol=ROUNDING)


def test_a_constant_rate_is_a_line():
    theta, thetadot, thetaddot = rates(jaxball.ConstantRate(0.3, -1.2), jnp.asarray(TIMES))
    np.testing.assert_allclose(theta, 0.3 - 1.2 * TIMES, atol=scaled(1e-15))
    np.testing.assert_array_equal(thetadot, jnp.asarray(-1.2))
    np.testing.assert_array_equal(thetaddot, 0)


def test_a_function_may_be_a_schedule():
    """θ = theta + a tanh(b t) sin t, differentiated by hand."""
    a, b, theta0, t = 0.8, 1.3, 0.4, TIMES
    theta, thetadot, thetaddot = rates(jaxball.FunctionSchedule(swing, jnp.asarray([a, b]), theta0), jnp.asarray(t))
    rise, slope = np.tanh(b * t), b / np.cosh(b * t) ** 2
    np.testing.assert_allclose(theta, theta0 + a * rise * np.sin(t), atol=ROUNDING)
    np.testing.assert_allclose(thetadot, a * (slope * np.sin(t) + rise * np.cos(t)), atol=ROUNDING)
    curvature = -2 * b * rise * slope
    expected = a * (curvature * np.sin(t) + 2 * slope * np.cos(t) - rise * np.sin(t))
    np.testing.assert_allclose(thetaddot, expected, atol=ROUNDING)


@pytest.mark.thorough
@pytest.mark.parametrize("index", range(6))
def test_a_schedule_may_be_moved_by_a_constant(index):
    schedule = schedules(np.random.default_rng(81))[index]
    t = jnp.asarray(TIMES)
    plain = rates(schedule, t)
    moved = rates(schedule.shift(jnp.asarray(0.7)), t)
    placed = rates(schedule.starting_at(jnp.asarray(1.9), 0.6), t)
    np.testing.assert_allclose(moved[0], plain[0] + 0.7, atol=ROUNDING)
    offset = placed[0] - plain[0]
    np.testing.assert_allclose(offset, offset[0], atol=ROUNDING)
    there = rates(schedule.starting_at(jnp.asarray(1.9), 0.6), jnp.asarray([0.6]))[0]
    np.testing.assert_allclose(there, 1.9, atol=ROUNDING)
    for found in (moved, placed):
        np.testing.assert_allclose(found[1], plain[1], atol=ROUNDING)
        np.testing.assert_allclose(found[2], plain[2], atol=ROUNDING)


@differences_need_float64
@pytest.mark.parametrize("index", range(6))
def test_kinks_are_where_the_acceleration_breaks_and_nowhere_else(index):
    """Off the kinks, central differences of θ̇ give θ̈; a kink that was not told of would show."""
    schedule = schedules(np.random.default_rng(82))[index]
    kinks, h = np.asarray(schedule.kinks()), 1e-5
    t = np.setdiff1d(np.linspace(0.003, 2.2, 500), kinks)
    t = t[np.all(np.abs(t[:, None] - kinks) > 2 * h, axis=1)]
    before, here, after = (rates(schedule, jnp.asarray(t + step)) for step in (-h, 0.0, h))
    np.testing.assert_allclose((after[1] - before[1]) / (2 * h), here[2], atol=1e-6)
    np.testing.assert_allclose((after[0] - before[0]) / (2 * h), here[1], atol=1e-6)


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: jaxball.PiecewiseAcceleration(0.0, [0.0, 1.0], [[1.0], [2.0]]), "accelerations"),
        (lambda: jaxball.Waypoints([0.0, 1.0], [0.0]), "times"),
        (lambda: jaxball.Waypoints([0.0], [0.0]), "times"),
        (lambda: jaxball.Sinusoids(0.0, [1.0, 2.0], [1.0]), "amplitude"),
    ],
)
def test_shapes_that_do_not_fit_are_refused_in_a_sentence(make, named):
    with refuses(ValueError, named):
        make()


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: jaxball.Pulse(0.8, start=5.0), "hold"),
        (lambda: jaxball.Pulse(0.8, hold=0.2), "end"),
        (lambda: jaxball.Waypoints([0.0, 3.0, 1.0], [0.0, 1.0, 2.0]), "times[2]"),
        (lambda: jaxball.Waypoints([0.0, 0.0, 1.0], [0.0, 1.0, 2.0]), "times[1]"),
        (lambda: jaxball.PiecewiseAcceleration(0.0, [1.0, 0.0, 2.0], [[1.0], [2.0]]), "times[1]"),
        (lambda: jaxball.PiecewiseSignal([0.0, 3.0, 1.0], [0.1, 0.2]), "times[2]"),
    ],
)
def test_times_out_of_order_are_refused(make, named):
    """As in files: the pieces of such a schedule overlap, and θ jumped by many turns in a run that succeeded."""
    with refuses(ValueError, named):
        make()


def test_a_schedule_of_traced_times_is_not_checked():
    end = jax.jit(lambda start: jaxball.Pulse(0.8, start=start, hold=start + 0.1, end=start + 0.2)(jnp.array(9.0)))(5.0)
    np.testing.assert_allclose(end, jaxball.Pulse(0.8)(jnp.array(4.0)), atol=scaled(1e-14))
