"""A solve by diffrax as most tests of solvers make it, and differential-algebraic equations with closed solutions."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from jaxball.simulation.solvers import MassMatrixTerm, SwitchingMassMatrixTerm
from jaxball.simulation.solvers.multistep import controller_class


def solve(field, solver, x0, end, tolerance=None, *, start=0.0, step=None, **options):
    """Solves a term, or the equation of a field, by steps that keep the errors to ``tolerance``, relative and absolute.

    Derivatives are those of forward mode; ``options`` are diffrax's, such as another ``stepsize_controller``.
    """
    term = field if isinstance(field, diffrax.AbstractTerm) else diffrax.ODETerm(field)
    if tolerance is not None:
        options["stepsize_controller"] = controller_class(solver)(rtol=tolerance, atol=tolerance)
    options = {"adjoint": diffrax.ForwardMode()} | options
    return diffrax.diffeqsolve(term, solver, start, end, step, jax.tree.map(jnp.asarray, x0), **options)


def mixed(t, x, args):
    """With u = x₁ + x₂ and v = x₁ − x₂: u̇ = −u and 0 = v − sin t, both in both equations."""
    u, v = x[0] + x[1], x[0] - x[1]
    return jnp.stack([-u + 3.0 * (v - jnp.sin(t)), -u - 3.0 * (v - jnp.sin(t))])


# M ẋ = (u̇, u̇)
MIXED = MassMatrixTerm(mixed, np.ones((2, 2)))


def balance(t, x, args):
    """ẏ = −z with 0 = z − y before t = 1 and 0 = z − 2y after it."""
    factor = jnp.where(t < 1.0, 1.0, 2.0)
    return {"y": -x["z"], "z": x["z"] - factor * x["y"]}


BALANCE = MassMatrixTerm(balance, {"y": 1.0, "z": 0.0})


def turn(t, x, args, component):
    """(cos t, sin t) with |x| = 1 for the rate of the larger component."""
    return jnp.where(jnp.arange(2) == component, jnp.sum(x * x) - 1.0, jnp.stack([-x[1], x[0]]))


TURN = SwitchingMassMatrixTerm(
    turn,
    mass=lambda component: jnp.where(jnp.arange(2) == component, 0.0, 1.0),
    choose=lambda t, x, args: jnp.argmax(jnp.abs(x)),
)
