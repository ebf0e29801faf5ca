"""Stepping to kinks, on ẏ = u(t) y with a piecewise constant u that jumps by aₖ at each kink.

y(T) is y₀ exp Σ aₖ (T − τₖ) for kinks τₖ within the run, and its derivative with respect to τₖ is −aₖ y(T).
"""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.simulation import solvers
from jaxball.simulation.solvers.multistep import controller_class
from tests.solvers import solving

JUMPS = np.array([1.0, -1.5, 0.8, -0.7])
START, END = 0.25, 5.0
TOLERANCE = 1e-10
REVERSE, FORWARD = diffrax.RecursiveCheckpointAdjoint(), diffrax.ForwardMode()
DOPRI8, GAUSS, RADAU = diffrax.Dopri8(), solvers.Gauss(8), solvers.RadauIIA(stages=3)
ADAMS = solvers.Adams()
RIGHT = jnp.asarray(False)


def closed_form(kinks, start=START, end=END):
    """y at ``end``, from 1 at ``start``."""
    lengths = jnp.maximum(end - kinks, 0) - jnp.maximum(start - kinks, 0)
    return jnp.exp(jnp.sum(JUMPS * lengths))


def multiplied(t, y, args):
    """The vector field with the value before the jump at each kink, or with that after it."""
    kinks, from_the_left = args
    return jnp.sum(jnp.where((t > kinks) | (~from_the_left & (t == kinks)), JUMPS, 0.0)) * y


def risen(t, y, args):
    """0 before the first kink, 1 after it."""
    kinks, _ = args
    return jnp.where(t >= kinks[0], 1.0, 0.0)


def to_kinks(controller, kinks):
    return solvers.StepToKinks(controller, kinks)


def clipped(controller, kinks):
    return diffrax.ClipStepSizeController(controller, jump_ts=kinks)


@eqx.filter_jit
def solve(control, kinks, start, end, left=RIGHT, told=None, solver=DOPRI8, field=multiplied, adjoint=REVERSE):
    """y at ``end`` and the numbers of steps that were kept and rejected; ``told`` are the times that are stepped to."""
    told = kinks if told is None else told
    controller = control(controller_class(solver)(rtol=TOLERANCE, atol=TOLERANCE), told)
    options = {"stepsize_controller": controller, "adjoint": adjoint, "max_steps": 4000}
    solution = solving.solve(field, solver, 1.0, end, start=start, args=(kinks, left), **options)
    stats = solution.stats
    return solution.ys[0], stats["num_accepted_steps"], stats["num_rejected_steps"]


def measure(control, kinks, start=START, end=END, *, left=False, told=None, **options):
    """The relative error at ``end``, and the number of all steps."""
    kinks, told, start, end = (jnp.asarray(t, float) for t in (kinks, kinks if told is None else told, start, end))
    y, kept, rejected = solve(control, kinks, start, end, jnp.asarray(left), told, **options)
    return float(abs(y / closed_form(kinks, start, end) - 1)), int(kept + rejected)


def ulps(t, count):
    """The number ``count`` floating-point numbers after ``t``."""
    for _ in range(abs(count)):
        t = np.nextafter(t, np.sign(count) * np.inf)
    return t


WITHIN = np.array([0.6, 1.7, 2.9, 4.2])
LATER = END + WITHIN
KINKS = {
    "in order": WITHIN,
    "in no order": WITHIN[[3, 0, 2, 1]],
    "some outside of the run": [-1.0, 1.7, 7.0, 2.9],
    "all outside of the run": [-3.0, -1.0, 7.0, 9.0],
    "two at one time": [0.6, 1.7, 1.7, 4.2],
    "two neighbours": [0.6, 1.7, ulps(1.7, 1), 4.2],
    "two with one number between": [0.6, 1.7, ulps(1.7, 2), 4.2],
    "two with two numbers between": [0.6, 1.7, ulps(1.7, 3), 4.2],
    "four neighbours": [1.7, ulps(1.7, 1), ulps(1.7, 2), ulps(1.7, 3)],
    "two very near": [0.6, 1.7, 1.7 + 1e-9, 4.2],
    "at the start": [START, 1.7, 2.9, 4.2],
    "just after the start": [ulps(START, 1), 1.7, 2.9, 4.2],
}
EACH = pytest.mark.parametrize("kinks", KINKS.values(), ids=KINKS.keys())


@pytest.mark.thorough
@EACH
@pytest.mark.parametrize("solver", [DOPRI8, GAUSS, ADAMS], ids=["Dopri8", "Gauss", "Adams"])
@pytest.mark.parametrize(("start", "end"), [(START, END), (END, START)], ids=["forwards", "backwards"])
def test_result_is_the_closed_form(kinks, solver, start, end):
    """The relative tolerance is 1e-10, and |y| stays within e⁴ of its values at the ends, or falls to e⁻⁶.

    A step of the Adams method has an error near to the tolerance, which is absolute where |y| is small.
    """
    error, _ = measure(to_kinks, kinks, start, end, solver=solver)
    assert error < (6e-8 if solver is ADAMS else 2e-9)


@pytest.mark.thorough
@EACH
def test_result_does_not_depend_on_the_value_at_the_kinks(kinks):
    """Nor does the number of steps, unless the run starts at a kink."""
    error, steps = measure(to_kinks, kinks, left=True)
    assert error < 2e-9
    if START not in kinks:
        assert abs(steps - measure(to_kinks, kinks)[1]) <= 2


@pytest.mark.thorough
@EACH
def test_as_accurate_as_diffrax_in_no_more_steps(kinks):
    error, steps = measure(to_kinks, kinks)
    error_of_diffrax, steps_of_diffrax = measure(clipped, kinks)
    assert error < 3 * error_of_diffrax + 1e-11
    assert steps <= steps_of_diffrax + 1


@pytest.mark.thorough
def test_far_fewer_steps_than_without():
    _, steps = measure(to_kinks, WITHIN)
    _, steps_without = measure(to_kinks, WITHIN, told=LATER)
    assert steps_without > 10 * steps


@pytest.mark.thorough
def test_no_stage_at_the_end_of_a_step_is_past_the_kink():
    """y' jumps from 0 to 1, so that no step has an error. For some of these kinks t0 + (t1 - t0) is past t1."""
    for kink in (3.25, 3.7530809568010897, 4.0, 4.151022309110887):
        kinks = jnp.array([kink, 9.0, 9.0, 9.0])
        y, _, rejected = solve(to_kinks, kinks, jnp.array(0.0), jnp.array(5.0), solver=RADAU, field=risen)
        assert rejected == 0
        assert abs(float(y) - (6.0 - kink)) < 1e-13


@pytest.mark.thorough
def test_gauss_steps_over_a_jump_unseen_without():
    """No node is at the end of a step, so a jump after the last one is in no estimate of the error."""
    error, _ = measure(to_kinks, WITHIN, solver=GAUSS)
    error_without, _ = measure(to_kinks, WITHIN, told=LATER, solver=GAUSS)
    assert error < 1e-11
    assert error_without > 1e4 * TOLERANCE


@pytest.mark.parametrize("offset", [-2, -1, 0, 1, 2])
@pytest.mark.parametrize("end", [START, END], ids=["backwards", "forwards"])
def test_run_that_starts_next_to_a_kink(offset, end):
    """As a run does that goes on where another one was ended at the kink."""
    error, steps = measure(to_kinks, WITHIN, ulps(1.7, offset), end)
    assert error < 1e-10
    assert steps <= 12


@pytest.mark.parametrize("offset", [-1, 1])
@pytest.mark.parametrize("start", [START, END], ids=["forwards", "backwards"])
def test_run_that_ends_next_to_a_kink(offset, start):
    error, _ = measure(to_kinks, WITHIN, start, ulps(1.7, offset))
    assert error < 1e-9


@pytest.mark.thorough
def test_kink_at_time_zero():
    shift = 1.7
    _, steps = measure(to_kinks, WITHIN, START, END)
    for left in (True, False):
        error, steps_at_zero = measure(to_kinks, WITHIN - shift, START - shift, END - shift, left=left)
        assert error < 2e-9
        assert steps_at_zero <= steps + 4


@pytest.mark.long
@pytest.mark.parametrize(
    "solver",
    [
        pytest.param(GAUSS, id="Gauss"),
        pytest.param(ADAMS, id="Adams", marks=pytest.mark.slow),
        pytest.param(DOPRI8, id="Dopri8", marks=pytest.mark.slow),
    ],
)
def test_derivative_with_respect_to_the_times_of_kinks_backward_mode(solver):
    def end(kinks):
        return solve(to_kinks, kinks, jnp.asarray(START), jnp.asarray(END), solver=solver)[0]

    for kinks in (WITHIN, WITHIN[[3, 0, 2, 1]], np.array([-1.0, 1.7, 7.0, 2.9])):
        truth = jax.grad(closed_form)(jnp.asarray(kinks))
        np.testing.assert_allclose(jax.grad(end)(jnp.asarray(kinks)), truth, rtol=0, atol=1e-7 * np.max(np.abs(truth)))


@pytest.mark.parametrize(
    "solver",
    [
        pytest.param(DOPRI8, id="Dopri8"),
        pytest.param(ADAMS, id="Adams", marks=pytest.mark.slow),
        pytest.param(GAUSS, id="Gauss", marks=pytest.mark.slow),
    ],
)
def test_derivative_with_respect_to_the_times_of_kinks_forward_mode(solver):
    def end(kinks, start, end):
        return solve(to_kinks, kinks, start, end, solver=solver, adjoint=FORWARD)[0]

    for start, stop in ((START, END), (END, START)):
        at = jnp.asarray(WITHIN), jnp.asarray(start), jnp.asarray(stop)
        truth = jax.jacfwd(closed_form)(*at)
        np.testing.assert_allclose(jax.jacfwd(end)(*at), truth, rtol=0, atol=1e-7 * np.max(np.abs(truth)))
