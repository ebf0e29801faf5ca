"""Runs in steps of one length beside a closed form, and the orders that they show."""

from typing import NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from jaxball.simulation import solvers
from jaxball.simulation.solvers.dense.continuous import DenseOutput

NEWTON = solvers.SimplifiedNewton(max_steps=300, rtol=1e-13, atol=1e-13, norm=optx.max_norm)
FIXED_POINT = solvers.FixedPoint(max_steps=300, rtol=1e-14, atol=1e-14, norm=optx.max_norm)
# Where in a step its dense output is looked at: no special points of any polynomial.
FRACTIONS = np.linspace(0.0137, 0.9871, 23)


class Errors(NamedTuple):
    """Errors, in the Euclidean norm: at the end of a run, anywhere within it, and as its last step estimates it."""

    end: float
    dense: float
    estimate: float


def march(solver, term, exact, length, steps, args, components=slice(None)):
    """The errors of some ``components`` after a number of equal ``steps`` from 0 to ``length``.

    ``exact(t, args)`` is the solution.
    """
    length, steps, args = jnp.asarray(length, float), jnp.asarray(steps, int), jnp.asarray(args, float)
    *errors, ok = _march(solver, term, exact, length, steps, args)
    assert ok, f"the iteration of {type(solver).__name__} did not converge"
    return Errors(*(float(np.linalg.norm(np.asarray(e)[components])) for e in errors))


@eqx.filter_jit
def _march(solver, term, exact, length, steps, args):
    h = length / steps.astype(length.dtype)

    def distance(y, t):
        return jnp.abs(y - exact(t, args))

    def step(i, carry):
        y, state, dense, _, ok = carry
        t0, t1 = h * i.astype(h.dtype), h * (i + 1).astype(h.dtype)
        y1, error, info, state, result = solver.step(term, t0, t1, y, args, state, False)
        output = DenseOutput.of(solver)
        info = output.info(info, term, t0, t1, args, jnp.asarray(True))
        between = output.interpolation(t0=t0, t1=t1, **info).evaluate
        within = jnp.max(jax.vmap(lambda t: distance(between(t), t))(t0 + FRACTIONS * h), axis=0)
        return y1, state, jnp.maximum(dense, within), error, ok & (result == diffrax.RESULTS.successful)

    start = exact(jnp.zeros_like(h), args)
    state = solver.init(term, jnp.zeros_like(h), h, start, args)
    zero = jnp.zeros_like(start)
    y, _, dense, estimate, ok = jax.lax.fori_loop(0, steps, step, (start, state, zero, zero, jnp.asarray(True)))
    return distance(y, length), dense, estimate, ok


def observed_order(lengths, errors):
    """The slope of the straight line through the logarithms of errors over those of the lengths of steps."""
    return np.polyfit(np.log(np.asarray(lengths)), np.log(np.asarray(errors)), 1)[0]
