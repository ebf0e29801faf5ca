"""Steps of the Adams method with an order, lengths and points that a test gives, from slopes that are known."""

import diffrax
import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from jaxball.simulation.solvers import Adams, AdamsController
from jaxball.simulation.solvers.adams import AdamsState
from jaxball.simulation.solvers.differences import fold
from jaxball.simulation.solvers.multistep import PairedNorm

ROWS = 13
# Tolerances that say nothing: the order is given.
SOLVER = eqx.tree_at(
    lambda s: (s.root_finder.rtol, s.root_finder.atol, s.root_finder.norm),
    Adams(),
    (1.0, 1.0, PairedNorm(optx.max_norm, AdamsController)),
)


def divided_differences(times, values):
    """f[t₀], f[t₀, t₁], …, of the first axis."""
    table, first = np.asarray(values, float), []
    for j in range(len(times)):
        first.append(table[0])
        lengths = np.asarray(times[: len(times) - 1 - j] - times[1 + j :])
        table = (table[:-1] - table[1:]) / lengths.reshape(-1, *(1,) * (table.ndim - 1))
    return np.stack(first)


def state_of(times, slopes, order):
    """The state at ``times[0]``, after points at ``times``, latest first, with these ``slopes``."""
    times, slopes = np.asarray(times, float), np.asarray(slopes, float)
    products = np.concatenate([[1.0], np.cumprod(times[0] - times[1:])])
    differences = divided_differences(times, slopes.reshape(ROWS, -1)) * products[:, None]
    return AdamsState(
        differences=fold(jnp.asarray(differences)),
        past=jnp.asarray(times[0] - times),
        order=jnp.asarray(order),
        equal=jnp.asarray(0),
        rising=jnp.asarray(False),
    )


def step(field, state, t0, t1, y0, args=None):
    """A step: its end, its error in units of |y| + 1, its polynomial, and the state after it."""
    y1, error, dense, after, _ = SOLVER.step(diffrax.ODETerm(field), t0, t1, y0, args, state, False)
    return y1, error.size, SOLVER.interpolation_cls(t0=t0, t1=t1, **dense), after
