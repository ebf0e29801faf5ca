"""Steps of the numerical differentiation formulas with an order, lengths and points that a test gives."""

import diffrax
import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from jaxball.simulation.solvers import NDF, NDFController
from jaxball.simulation.solvers.differences import HIGHEST_BDF
from jaxball.simulation.solvers.multistep import PairedNorm

ROWS = 8
KAPPAS = ("ndf", "bdf")
# The order is given, so that a tolerance says only when Newton's iteration ends: at the level of rounding.
TOLERANCE = 1e-14
SOLVERS = {
    kappa: eqx.tree_at(
        lambda s: (s.root_finder.rtol, s.root_finder.atol, s.root_finder.norm),
        NDF(kappa=kappa),
        (TOLERANCE, TOLERANCE, PairedNorm(optx.max_norm, NDFController)),
    )
    for kappa in KAPPAS
}


def backward_differences(values):
    """x₀, x₀ − x₁, …, of the first axis."""
    table, first = np.asarray(values, float), []
    for _ in range(len(values)):
        first.append(table[0])
        table = table[:-1] - table[1:]
    return np.stack(first)


def state_of(values, distance, order, term=None):
    """The state after points at this distance, latest first, with these values."""
    values = np.asarray(values, float).reshape(ROWS, -1)
    term = diffrax.ODETerm(lambda t, y, args: y) if term is None else term
    zero = jnp.asarray(0.0)
    state = SOLVERS["ndf"].init(term, zero, jnp.asarray(distance, float), jnp.asarray(values[0]), None)
    return _split(state, jnp.asarray(backward_differences(values)), jnp.asarray(order))


def at_order(state, order):
    """The state for a step of this order, whichever the method has planned."""
    rows, (first, second) = jnp.arange(ROWS)[:, None], state.beyond
    last = jnp.where(rows == state.order + 1, first[None], jnp.where(rows == state.order + 2, second[None], 0.0))
    return _split(state, last.at[: HIGHEST_BDF + 1].add(state.differences), order)


def _split(state, differences, order):
    rows = jnp.arange(HIGHEST_BDF + 1)[:, None]
    inside = jnp.where(rows <= order, differences[: HIGHEST_BDF + 1], 0.0)
    return state._replace(differences=inside, beyond=differences[order + 1 + jnp.arange(2)], order=order)


def step(kappa, field, state, t0, t1, y0, args=None):
    """A step: its end, its error in units of |y| + 1, its polynomial, and the state after it."""
    solver = SOLVERS[kappa]
    term = field if isinstance(field, diffrax.AbstractTerm) else diffrax.ODETerm(field)
    y1, error, dense, after, _ = solver.step(term, t0, t1, y0, args, state, False)
    return y1, error.size * TOLERANCE, solver.interpolation_cls(t0=t0, t1=t1, **dense), after
