"""Estimates of the error of a step: which power of the step they are, and that they bound what they promise to."""

import diffrax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.simulation import solvers
from tests.solvers import rotating
from tests.solvers.fixed_steps import NEWTON, march, observed_order

ODE = diffrax.ODETerm(rotating.field)
ARGS = (3.0, 0.5)

EMBEDDED_RADAU = solvers.RadauIIA(5, root_finder=NEWTON)
EMBEDDED_GAUSS = solvers.Gauss(3, root_finder=NEWTON, error=solvers.EmbeddedError())
TAIL = solvers.Gauss(4, root_finder=NEWTON)
STEP, STEP_OF_MANY = (solvers.Gauss(k, root_finder=NEWTON, error=solvers.StepError()) for k in (4, 8))
TRAPEZOIDAL, TR_BDF2 = solvers.Trapezoidal(root_finder=NEWTON), solvers.TRBDF2(root_finder=NEWTON)


def errors(solver, lengths, steps=1):
    """The errors of runs of so many steps of these lengths."""
    return [march(solver, ODE, rotating.exact, steps * h, steps, ARGS) for h in lengths]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("solver", "shortest"),
    [
        pytest.param(EMBEDDED_RADAU, 2**-6, id="embedded, Radau IIA with 5 stages"),
        pytest.param(EMBEDDED_GAUSS, 2**-7, id="embedded, Gauss with 3 stages"),
        pytest.param(TAIL, 2**-7, id="tail, Gauss with 4 stages"),
        pytest.param(STEP, 2**-7, id="step, Gauss with 4 stages"),
        pytest.param(TRAPEZOIDAL, 2**-7, id="trapezoidal rule"),
        pytest.param(TR_BDF2, 2**-7, id="TR-BDF2"),
    ],
)
def test_estimate_is_the_power_of_the_step_that_it_says(solver, shortest):
    """On a second step, because the trapezoidal rule needs the one before."""
    lengths = shortest * np.array([1.0, 1.5, 2.0])
    estimates = [e.estimate for e in errors(solver, lengths, steps=2)]
    assert observed_order(lengths, estimates) == pytest.approx(solver.error_order(ODE), abs=0.4)


@pytest.mark.thorough
@pytest.mark.parametrize("solver", [EMBEDDED_RADAU, EMBEDDED_GAUSS, TAIL])
def test_embedded_error_and_tail_bound_the_error_throughout_the_step(solver):
    for error in errors(solver, 2.0 ** -np.arange(2, 6)):
        assert error.estimate > 1.5 * error.dense


@pytest.mark.thorough
def test_step_error_bounds_the_error_at_the_end_of_the_step():
    for error in errors(STEP, [0.0625, 0.125, 0.25]):
        assert error.end > 1e-15
        assert error.estimate > 5 * error.end


def test_step_error_is_far_below_the_error_within_the_step():
    """This is what makes its steps longer than those of the tail, and its dense output less accurate."""
    for error in errors(STEP_OF_MANY, [0.1, 0.15]):
        assert error.estimate < 0.1 * error.dense


def test_first_estimate_of_the_trapezoidal_rule_is_too_large():
    for error in errors(TRAPEZOIDAL, 2.0 ** -np.arange(3, 7)):
        assert error.estimate > 3 * error.end


def test_estimate_of_tr_bdf2_tends_to_the_error():
    coarse, fine = errors(TR_BDF2, [2**-5, 2**-8])
    assert coarse.estimate == pytest.approx(coarse.end, rel=0.05)
    assert fine.estimate == pytest.approx(fine.end, rel=0.01)


def test_estimate_of_the_trapezoidal_rule_is_exact_for_a_cubic():
    """ẏ = 3t²: every step errs by h³/2, whichever it is."""
    term = diffrax.ODETerm(lambda t, y, args: jnp.full_like(y, 3 * t**2))
    for steps in (2, 5):
        error = march(TRAPEZOIDAL, term, lambda t, args: jnp.stack([t**3]), 1.0, steps, 0.0)
        assert error.estimate == pytest.approx((1 / steps) ** 3 / 2, rel=1e-12)
        assert error.end == pytest.approx(steps * error.estimate, rel=1e-12)
