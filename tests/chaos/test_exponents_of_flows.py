"""Lyapunov exponents of flows whose exponents are known: linear ones, Lorenz's, and integrable ones."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.analysis.chaos import lyapunov_spectrum_of
from jaxball.analysis.chaos.result import limits_of, sentences
from jaxball.numerics.vectors import cross
from tests.support.sentences import refuses

SIGMA, RHO, BETA = 10.0, 28.0, 8 / 3


def linear(t, x, A):
    return jnp.sum(A * x[None, :], axis=1)


def lorenz(t, x, args):
    return jnp.stack([SIGMA * (x[1] - x[0]), x[0] * (RHO - x[2]) - x[1], x[0] * x[1] - BETA * x[2]])


def symmetric_top(t, x, args):
    """Euler and Poisson's equations with d = (1, 1, 0.6) and the centre of mass on E3, M g ℓ = 0.8."""
    d, Omega, Gamma = jnp.asarray([1.0, 1.0, 0.6]), x[:3], x[3:]
    torque = cross(d * Omega, Omega) + 0.8 * cross(Gamma, jnp.asarray([0.0, 0.0, 1.0]))
    return jnp.concatenate([torque / d, cross(Gamma, Omega)])


def vertical(x):
    return jnp.concatenate([jnp.zeros(3), x[3:]])


@pytest.fixture(scope="module")
def lorenz_spectrum():
    return lyapunov_spectrum_of(
        lorenz, (0.0, 320.0), [1.0, 1.0, 20.0], transient=20.0, interval=0.5, rtol=1e-8, atol=1e-8
    ).raise_if_failed()


def test_a_linear_flow_has_the_real_parts_of_its_eigenvalues():
    """Real eigenvalues and a matrix that is not normal: after the transient, exp(−0.5 · 20 π) is left of the error."""
    rng = np.random.default_rng(3)
    wanted = np.array([0.3, -0.2, -0.9, -1.5])
    basis = np.eye(4) + 0.4 * rng.normal(size=(4, 4))
    found = linear_spectrum(basis @ np.diag(wanted) @ np.linalg.inv(basis))
    np.testing.assert_allclose(found.exponents, wanted, atol=1e-8)
    np.testing.assert_allclose(found.running, np.broadcast_to(wanted, found.running.shape), atol=1e-8)
    assert float(jnp.max(found.standard_error)) < 1e-8


def test_complex_eigenvalues_give_their_real_part_twice():
    """The rates turn with half the period of the eigenvalues −0.1 ± i, so that means over whole periods are exact."""
    found = linear_spectrum([[-0.1, 2.0, 0, 0], [-0.5, -0.1, 0, 0], [0, 0, -3.0, 0.4], [0, 0, 0, -1.0]])
    np.testing.assert_allclose(found.exponents, [-0.1, -0.1, -1.0, -3.0], atol=1e-8)
    assert float(jnp.std(found.rates[:, 0])) > 0.1


def linear_spectrum(A):
    return lyapunov_spectrum_of(
        linear, (0.0, 30 * np.pi), np.zeros(4), jnp.asarray(A), transient=20 * np.pi, interval=np.pi / 4
    ).raise_if_failed()


def test_exponents_of_lorenz_sum_to_the_trace(lorenz_spectrum):
    """−(σ + 1 + β) in every interval, since the divergence is constant.

    Rounding decides which orbit it is, and where that turns quickly an error of the solve, 1e-8, grows to some 1e-6.
    """
    np.testing.assert_allclose(jnp.sum(lorenz_spectrum.rates, axis=1), -(SIGMA + 1 + BETA), atol=1e-5)


def test_exponents_of_lorenz(lorenz_spectrum):
    """0.9056, 0 and −14.5723 (Sprott 2003) within the standard error, and dimension 2.062."""
    wanted = np.array([0.9056, 0.0, -14.5723])
    error = np.asarray(lorenz_spectrum.standard_error)
    assert np.all(np.abs(np.asarray(lorenz_spectrum.exponents) - wanted) < 4 * error + 5e-4)
    assert 1e-3 < error[0] < 0.06  # twelve starts give 0.016 to 0.043
    assert lorenz_spectrum.dimension == pytest.approx(2.062, abs=3e-3)


def test_a_chaotic_run_tells_its_exponents_from_zero_and_the_zero_along_the_flow_from_none(lorenz_spectrum):
    np.testing.assert_array_equal(lorenz_spectrum.told_from_zero, [True, False, True])
    assert np.all(np.abs(lorenz_spectrum.limits.limits - [0.9056, 0.0, -14.5723]) < 5 * lorenz_spectrum.limits.errors)
    assert "cannot distinguish λ2 from zero" in str(lorenz_spectrum)
    assert "drift" not in lorenz_spectrum.message


@pytest.mark.slow
def test_the_first_exponents_alone_are_those_of_the_whole_spectrum(lorenz_spectrum):
    """In theory exactly; the steps differ, so that chaos parts the runs."""
    found = lyapunov_spectrum_of(
        lorenz, (0.0, 320.0), [1.0, 1.0, 20.0], exponents=1, transient=20.0, interval=0.5, rtol=1e-8, atol=1e-8
    )
    difference = abs(float(found.exponents[0] - lorenz_spectrum.exponents[0]))
    assert difference < 4 * float(found.standard_error[0] + lorenz_spectrum.standard_error[0])


def euler(t, x, d):
    return cross(d * x, x) / d


@pytest.mark.long
@pytest.mark.parametrize("end", [20.0, 160.0])
def test_integrable_tops_are_told_from_chaos(end):
    """Lagrange's heavy top and Euler's free one: growth is linear in time, whatever the standard errors say.

    Of the largest exponents, most look like 0.1 ± 0.04 after 20 units of time.
    """
    rng = np.random.default_rng(7)
    theta = rng.uniform(0.3, 2.7, 6)
    starts = np.stack([*rng.normal(size=(3, 6)), np.sin(theta), 0 * theta, np.cos(theta)], axis=1)

    def heavy(x):
        return lyapunov_spectrum_of(symmetric_top, (0.0, end), x, normal=vertical, rtol=1e-7, atol=1e-7)

    def free(x):
        return lyapunov_spectrum_of(euler, (0.0, end), x, jnp.asarray([1.0, 2.0, 2.5]), rtol=1e-7, atol=1e-7)

    for several in (jax.vmap(heavy)(jnp.asarray(starts)), jax.vmap(free)(jnp.asarray(starts[:, :3]))):
        assert np.all(np.asarray(several.exponents[:, 0]) > 0)
        for k in range(6):
            one = jax.tree.map(lambda leaf, k=k: leaf[k], several)
            assert not np.any(one.told_from_zero)
            assert "The run cannot distinguish λ1 to λ" in one.message


def test_exponents_fall_and_all_that_belongs_to_them_follows():
    """Of a rotation in two planes all are zero, and a run finds them in any order."""
    A = jnp.asarray([[0, 1.0, 0, 0], [-3.0, 0, 0, 0], [0, 0, 0, 2.0], [0, 0, -0.4, 0]])
    found = lyapunov_spectrum_of(linear, (0.0, 7.3), np.ones(4), A, interval=0.7, rtol=1e-9, atol=1e-9)
    assert np.all(np.diff(found.exponents) < 0)
    np.testing.assert_allclose(found.running[-1], found.exponents, atol=1e-14)
    np.testing.assert_allclose(jnp.mean(found.rates, axis=0), found.exponents, atol=1e-14)
    np.testing.assert_allclose(found.vectors @ found.vectors.T, np.eye(4), atol=1e-12)
    rates = np.asarray(found.rates)
    np.testing.assert_allclose(found.standard_error, rates.std(axis=0, ddof=1) / np.sqrt(len(rates)), rtol=1e-10)


@pytest.mark.parametrize("power", [1, 2])
@pytest.mark.parametrize("begin", [0.0, 0.5])
def test_growth_as_a_power_of_time_is_no_exponent_wherever_it_begins(power, begin):
    """|δx| = (1 + c²t²)^(p/2): flat before 1/c, and tᵖ after."""
    times = np.arange(1, 401.0)
    for c in np.geomspace(1e-4, 1e2, 60):
        grown = power / 2 * np.log1p((c * np.arange(401.0)) ** 2)
        rates = np.diff(grown)[times > begin * 400, None]
        assert not limits_of(0.0, times[times > begin * 400], rates, np.zeros(1)).told[0]


def test_a_drift_that_remains_is_said_and_the_limit_has_the_error_it_claims():
    """λ + a/t, with noise: the mean is not yet the limit. Student's t with 14 degrees has a spread of 1.08."""
    times = np.arange(1, 321.0)
    drift = 0.05 + 4 * np.log((times + 20) / (times + 19))
    noise = 1e-3 * np.random.default_rng(0).normal(size=(300, 320))
    found = limits_of(-20.0, times, (drift + noise).T, np.full(300, 1e-4))
    assert np.all(found.told)
    assert np.all(found.drifting)
    assert np.std((found.limits - 0.05) / found.errors) == pytest.approx(1.08, abs=0.1)
    assert "drift, as 1/t towards 0.0" in sentences(found)[0]


def test_too_few_intervals_tell_nothing():
    found = lyapunov_spectrum_of(linear, (0.0, 3.0), np.ones(2), jnp.eye(2))
    assert not np.any(found.told_from_zero)
    assert "too few intervals to distinguish any exponent from zero" in found.message


@pytest.mark.slow
def test_a_heavy_symmetric_top_has_no_exponent_but_zero():
    """It is integrable, so that deviations grow linearly and means tend to zero as log(t) / t."""
    x = np.array([0.4, -0.3, 1.5, np.sin(0.7), 0.0, np.cos(0.7)])
    found = lyapunov_spectrum_of(symmetric_top, (0.0, 400.0), x, normal=vertical, interval=4.0, rtol=1e-8, atol=1e-8)
    assert found.exponents.shape == (5,)
    assert float(jnp.max(jnp.abs(found.exponents))) < 4 * np.log(400.0) / 400.0
    assert abs(float(jnp.sum(found.exponents))) < 1e-7
    np.testing.assert_allclose(jnp.sum(found.vectors[:, 3:] * found.x[None, 3:], axis=1), 0, atol=1e-10)


@pytest.mark.slow
def test_the_largest_exponent_of_lorenz_to_three_digits():
    found = lyapunov_spectrum_of(
        lorenz, (0.0, 20050.0), [1.0, 1.0, 20.0], exponents=1, transient=50.0, rtol=1e-8, atol=1e-8
    )
    assert float(found.exponents[0]) == pytest.approx(0.9056, abs=2e-3)


def pole(t, x, args):
    return jnp.stack([x[0] ** 2, -x[1]])


def test_a_solution_that_ends_is_a_status():
    """ẋ = x² from 1 ends at t = 1."""
    found = lyapunov_spectrum_of(pole, (0.0, 3.0), [1.0, 1.0], interval=0.5, max_steps=300)
    assert not found.ok
    assert float(found.reached) == pytest.approx(1.0, abs=1e-6)
    assert found.message.startswith("The solve stopped at t = 0.99999")
    assert np.all(np.isnan(found.exponents))
    assert np.isnan(found.dimension)
    assert np.all(np.isfinite(found.rates[0]))
    assert np.all(np.isnan(found.rates[2:]))


def test_a_state_that_is_not_finite_is_a_status():
    found = lyapunov_spectrum_of(pole, (0.0, 3.0), [np.nan, 1.0], interval=0.5, max_steps=300)
    assert "did not start" in found.message


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"times": (1.0, 1.0)}, "times"),
        ({"times": (0.0, 1.0, 2.0)}, "times"),
        ({"exponents": 3}, "exponents"),
        ({"exponents": 0}, "exponents"),
        ({"interval": 0.0}, "interval"),
        ({"transient": 1.0}, "transient"),
    ],
)
def test_wrong_arguments(changes, named):
    arguments = {"times": (0.0, 1.0), "x": [1.0, 1.0]} | changes
    with refuses(ValueError, named):
        lyapunov_spectrum_of(pole, **arguments)
