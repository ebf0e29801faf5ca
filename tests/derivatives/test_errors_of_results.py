"""The estimated error of derivatives, against the error itself, which closed forms and linear theory tell.

An estimate must be within a factor of 10 of the error, and is that of the run less that of one at a hundredth of the
tolerance: right to a few percent, except where the error happens to be almost 0.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

import jaxball
from jaxball import BallState, Contact, Disk, DiskState, simulate
from jaxball.interface import compat
from jaxball.interface.status import SolveError
from jaxball.physics import SpeedLimitedMotor
from jaxball.programs import traces
from jaxball.simulation import estimate_error_of, global_error
from tests.derivatives.test_sensitivity_control import (
    END,
    MARBLE,
    OMEGA,
    end_of_marble,
    linear_pendulum,
    pendulum,
    swing,
)
from tests.support.sentences import refuses

ROLLING = Disk(mass=1.0, inertia=0.5, offset=(0.0, 0.0, -0.2))  # it rocks to and fro


def place(speed, tolerance=1e-6, max_steps=512):
    start = DiskState(phidot=-speed)
    return simulate(ROLLING, [0.0, 5.0], start, rtol=tolerance, atol=tolerance, max_steps=max_steps).state.z[-1]


@pytest.mark.parametrize("mode", [jax.grad, pytest.param(jax.jacfwd, marks=pytest.mark.thorough)])
def test_a_marble_at_rest_and_close_to_it(mode):
    derivative = mode(end_of_marble)
    for start in (0.0, 1e-6, 1e-2):
        exact = swing(start)[1][0]
        for tolerance in (1e-4, 1e-6, 1e-8, 1e-10, 1e-12):
            estimate = estimate_error_of(derivative, start, tolerance)
            assert 0.1 < estimate / (derivative(start, tolerance) - exact) < 10, (start, tolerance)


@pytest.mark.thorough
def test_each_entry_has_its_error():
    """Of a robot at rest: how its end moves with its start (z, z', θ, θ') and with the voltage of its motor."""

    def derivatives(tolerance):
        def end(initial, voltage):
            return pendulum(SpeedLimitedMotor(voltage, 3.0, 4.0), initial, tolerance)

        return jax.jacrev(end, argnums=(0, 1))(jnp.zeros(4), jnp.asarray(0.0))

    A, b = linear_pendulum(3.0, 4.0)
    to_x = np.array([[1.0, 0, 0, 0], [1, 0, 1, 0], [0, 1, 0, 0], [0, 1, 0, 1]])
    augmented = scipy.linalg.expm(np.block([[A, b[:, None]], [np.zeros((1, 5))]]) * 5.0)
    exact = (augmented[0, :4] @ to_x, 3.0 * augmented[0, 4])
    for tolerance in (1e-5, 1e-8):
        estimates = estimate_error_of(derivatives, tolerance)
        errors = jax.tree.map(lambda found, true: found - true, derivatives(tolerance), exact)
        assert jax.tree.structure(estimates) == jax.tree.structure(errors)
        for estimate, error in zip(estimates, errors, strict=True):
            np.testing.assert_allclose(estimate, error, rtol=0.5, atol=0.05 * np.max(np.abs(error)))


@pytest.mark.thorough
def test_a_marble_that_could_slip():
    def end(x, tolerance):
        law = Contact(friction=0.5)
        run = simulate(MARBLE, [0.0, END], BallState(z=(x, 0.0)), rtol=tolerance, atol=tolerance, contact=law)
        return run.state.z[-1, 0]

    derivative = jax.jacfwd(end)
    for tolerance in (1e-6, 1e-9):
        estimate = estimate_error_of(derivative, 0.0, tolerance)
        assert 0.1 < estimate / (derivative(0.0, tolerance) - np.cos(OMEGA * END)) < 10


@pytest.mark.parametrize("compiled", [lambda f: f, jax.jit, jaxball.jit], ids=["as it is", "by jax", "by jaxball"])
def test_compiled_functions_are_solved_again(compiled):
    function = compiled(place)
    error = function(0.5) - place(0.5, 1e-13)
    for _ in range(2):  # also when it has been compiled before
        np.testing.assert_allclose(estimate_error_of(function, 0.5), error, rtol=0.1)
    assert function(0.5) == compiled(place)(0.5)  # and its own run stays as it was


def test_a_derivative_that_runs_out_of_steps_says_so():
    def end(x):
        return simulate(MARBLE, [0.0, END], BallState(z=(x, 0.0)), max_steps=32).state.z[-1, 0]

    few = jax.grad(end)
    assert end(0.0) == 0.0
    assert np.isnan(few(0.0))
    with refuses(SolveError, "max_steps"):
        estimate_error_of(few, 0.0)


@pytest.mark.thorough
def test_finer_runs_may_take_more_steps():
    def end(x):
        return simulate(MARBLE, [0.0, END], BallState(z=(x, 0.0)), max_steps=180).state.z[-1, 0]

    derivative = jax.grad(end)  # which has enough steps, but not at a hundredth of the tolerance
    assert 0.1 < estimate_error_of(derivative, 0.0) / (derivative(0.0) - np.cos(OMEGA * END)) < 10


def test_numbers_that_are_unknown_stay_so():
    def both(speed):
        z = place(speed)
        return {"z": z, "never": jnp.where(z > 1e3, z, jnp.nan)}

    estimates = estimate_error_of(both, 0.5)
    assert np.isnan(estimates["never"])
    assert np.isfinite(estimates["z"])


def test_what_is_refused():
    with pytest.raises(TypeError, match="function"):
        estimate_error_of(3)  # pyright: ignore[reportArgumentType]
    with refuses(TypeError, "function"):
        estimate_error_of(lambda: None)
    with refuses(ValueError, "The error of a result"):
        jax.jit(lambda speed: estimate_error_of(place, speed))(0.5)
    run = simulate(ROLLING, [0.0, 5.0], DiskState(phidot=-0.5))
    with refuses(ValueError, "function"):
        estimate_error_of(lambda: run.state.z)
    with refuses(jaxball.simulation.PrecisionError, "1.8e-15", "float64"):
        estimate_error_of(place, 0.5, 2e-15)
    with refuses(ValueError, "function"):
        estimate_error_of(lambda: jnp.zeros(1 if traces.finer.value is None else 2))


@pytest.mark.thorough
def test_where_jax_does_not_keep_traces_apart(monkeypatch):
    monkeypatch.setattr(traces, "finer", compat._Setting(None))
    monkeypatch.setattr(global_error, "HAS_SETTINGS_OF_TRACES", False)
    function = jax.jit(place)
    error = function(0.5) - place(0.5, 1e-13)
    for _ in range(2):
        np.testing.assert_allclose(estimate_error_of(function, 0.5), error, rtol=0.1)
    np.testing.assert_allclose(function(0.5) - place(0.5, 1e-13), error, rtol=1e-6)
