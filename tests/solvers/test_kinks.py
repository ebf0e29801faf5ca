"""Stepping to kinks, on ẏ = u(t) y with a piecewise constant u that jumps by aₖ at each kink.

y(T) is y₀ exp Σ aₖ (T − τₖ) for kinks τₖ within the run, and its derivative with respect to τₖ is −aₖ y(T).
"""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import solvers

JUMPS = np.array([1.0, -1.5, 0.8, -0.7])
START, END = 0.0, 5.0
TOLERANCE = 1e-10
DOPRI8, TSIT5, GAUSS = diffrax.Dopri8(), diffrax.Tsit5(), solvers.Gauss(8)


def closed_form(kinks, start=START, end=END):
    """y at ``end``, from 1 at ``start``."""
    lengths = jnp.maximum(end - kinks, 0) - jnp.maximum(start - kinks, 0)
    return jnp.exp(jnp.sum(JUMPS * lengths))


def from_the_right(t, y, kinks):
    """The vector field with the value after the jump at each kink."""
    return jnp.sum(jnp.where(t >= kinks, JUMPS, 0.0)) * y


def from_the_left(t, y, kinks):
    """The vector field with the value before the jump at each kink."""
    return jnp.sum(jnp.where(t > kinks, JUMPS, 0.0)) * y


def to_kinks(controller, kinks):
    return solvers.StepToKinks(controller, kinks)


def clipped(controller, kinks):
    return diffrax.ClipStepSizeController(controller, jump_ts=kinks)


def plain(controller, kinks):
    return controller


@eqx.filter_jit
def solve(control, kinks, start, end, solver=DOPRI8, field=from_the_right, adjoint=None):
    """y at ``end`` and the numbers of steps that were kept and rejected."""
    controller = control(diffrax.PIDController(rtol=TOLERANCE, atol=TOLERANCE), kinks)
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(field),
        solver,
        start,
        end,
        None,
        jnp.array(1.0),
        kinks,
        stepsize_controller=controller,
        adjoint=diffrax.RecursiveCheckpointAdjoint() if adjoint is None else adjoint,
        max_steps=4000,
    )
    stats = solution.stats
    return solution.ys[0], stats["num_accepted_steps"], stats["num_rejected_steps"]


def outcome(control, kinks, start=START, end=END, **options):
    """The relative error at ``end``, and all steps."""
    kinks, start, end = jnp.asarray(kinks), jnp.asarray(start), jnp.asarray(end)
    y, kept, rejected = solve(control, kinks, start, end, **options)
    return float(abs(y / closed_form(kinks, start, end) - 1)), int(kept + rejected)


def ulps(t, count):
    """The number ``count`` floating-point numbers after ``t``."""
    for _ in range(abs(count)):
        t = np.nextafter(t, np.sign(count) * np.inf)
    return t


KINKS = {
    "sorted": [0.6, 1.7, 2.9, 4.2],
    "unsorted": [4.2, 0.6, 2.9, 1.7],
    "some outside of the run": [-1.0, 1.7, 7.0, 2.9],
    "all outside of the run": [-3.0, -1.0, 7.0, 9.0],
    "at both ends": [START, 1.7, 2.9, END],
    "next to both ends": [ulps(START, 1), 1.7, 2.9, ulps(END, -1)],
    "two at one time": [0.6, 1.7, 1.7, 4.2],
    "a unit of the last digit apart": [0.6, 1.7, ulps(1.7, 1), 4.2],
    "two units apart": [0.6, 1.7, ulps(1.7, 2), 4.2],
    "three units apart": [0.6, 1.7, ulps(1.7, 3), 4.2],
    "four in a row": [1.7, ulps(1.7, 1), ulps(1.7, 2), ulps(1.7, 3)],
    "very near": [0.6, 1.7, 1.7 + 1e-9, 4.2],
}
