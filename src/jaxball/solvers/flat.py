"""The problem of one step over a flat state."""

from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, PyTree

from .mass import Mass, mass_term


class FlatProblem(NamedTuple):
    """h g(t, x) and M for one step, with x of one axis."""

    slope: Callable[[Float[Array, ""], Float[Array, " n"]], Float[Array, " n"]]
    x0: Float[Array, " n"]
    unravel: Callable[[Float[Array, " n"]], PyTree[Array]]
    control: Float[Array, ""]
    mass: Mass | None


def flat_problem(terms: diffrax.AbstractTerm, t0, t1, y0: PyTree[Array], args: Any) -> FlatProblem:
    """The problem that ``terms`` pose for the step from ``t0`` to ``t1``.

    **Raises:** ``TypeError`` for a term whose control is not time, as in a stochastic equation, and for a
    state that is not real.
    """
    x0, unravel = ravel_pytree(y0)
    control = terms.contr(t0, t1)
    if jnp.shape(control) != ():
        raise TypeError(
            "Argument `terms` must be an ordinary differential equation, with time as its control, for a solver of "
            f"jaxball.solvers, but the control's shape is {jnp.shape(control)}; use a solver for stochastic equations."
        )
    if not jnp.issubdtype(x0.dtype, jnp.floating):
        raise TypeError(
            f"Argument `y0` must be real floating-point numbers of one kind, but it is {x0.dtype}; "
            "give a complex state as its real and imaginary parts."
        )
    switched = mass_term(terms)
    field, mass = (terms.vf, None)
    if switched is not None:
        direction = getattr(terms, "direction", 1)
        choice, mass = switched.at_step(t0 * direction, y0, args)
        field = terms.vf if switched.constant else lambda t, y, args: choice(t * direction, y, args)

    def slope(t, x):
        rates, _ = ravel_pytree(field(t, unravel(x), args))
        return rates.astype(x.dtype) * control.astype(x.dtype)

    return FlatProblem(slope, x0, unravel, control, mass)
