"""The problem of one step over a flat state."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, PyTree

from .mass import Mass, mass_term, unwrapped
from .stages import StageEquations
from .tableau import Tableau


class Slope(eqx.Module):
    """h g(t, x)."""

    field: Callable[[Float[Array, ""], Float[Array, " n"]], Float[Array, " n"]]
    control: Float[Array, ""]

    def __call__(self, t: Float[Array, ""], x: Float[Array, " n"]) -> Float[Array, " n"]:
        return self.field(t, x) * self.control.astype(x.dtype)


class FlatProblem(NamedTuple):
    """g(t, x), h g(t, x) and M for one step, with x of one axis."""

    field: Callable[[Float[Array, ""], Float[Array, " n"]], Float[Array, " n"]]
    slope: Slope
    x0: Float[Array, " n"]
    unravel: Callable[[Float[Array, " n"]], PyTree[Array]]
    control: Float[Array, ""]
    mass: Mass | None

    def equations(
        self, tableau: Tableau, t0: Float[Array, ""], times: Float[Array, " s"], x0: Float[Array, " n"], **known: Any
    ) -> StageEquations:
        """What the stages at ``times`` of a step from x₀ satisfy; ``known`` are its other fields."""
        return StageEquations(
            tableau=tableau,
            slope=self.slope,
            t0=t0,
            times=times,
            x0=x0,
            control=self.control,
            unravel=self.unravel,
            mass=self.mass,
            **known,
        )

    def refuse_mass(self, solver: diffrax.AbstractSolver) -> None:
        """Raises ``TypeError`` if there is a mass matrix, which ``solver`` does not support."""
        if self.mass is not None:
            raise TypeError(
                "Argument `solver` must be a RadauIIA, NDF, Trapezoidal or TRBDF2 for a term with a mass matrix, "
                "M ẋ = g(t, x), "
                f"but it is a {type(solver).__name__}."
            )


def flat_problem(
    terms: diffrax.AbstractTerm, t0: Float[Array, ""], t1: Float[Array, ""], y0: PyTree[Array], args: Any
) -> FlatProblem:
    """The problem that ``terms`` pose for the step from ``t0`` to ``t1``.

    **Raises:** ``TypeError`` for a term whose control is not time, as in a stochastic equation, and for a
    state that is not real.
    """
    x0, unravel = ravel_pytree(y0)
    term = unwrapped(terms)
    if isinstance(term, (diffrax.ControlTerm, diffrax.MultiTerm)):
        raise TypeError(
            "Argument `terms` must be an ordinary differential equation for a solver of jaxball.solvers, an ODETerm or "
            f"a MassMatrixTerm, but it is a {type(term).__name__}; use one of diffrax's solvers for it."
        )
    control = terms.contr(t0, t1)
    if not jnp.issubdtype(x0.dtype, jnp.floating):
        raise TypeError(
            f"Argument `y0` must be real floating-point numbers of one kind, but it is {x0.dtype}; "
            "give a complex state as its real and imaginary parts."
        )
    mass_problem = mass_term(terms)
    if mass_problem is None:
        field, mass = terms.vf, None
    else:
        # diffrax runs time backwards by changing its sign.
        direction = getattr(terms, "direction", 1)
        g, mass = mass_problem.at_step(t0 * direction, y0, args)
        field = functools.partial(_reflected, g, direction)

    def flat(t, x):
        return ravel_pytree(field(t, unravel(x), args))[0].astype(x.dtype)

    # Traced once here, rather than by each user.
    flat = eqx.filter_closure_convert(flat, t0, x0)
    return FlatProblem(flat, Slope(flat, control), x0, unravel, control, mass)


def _reflected(g, direction, t, y, args):
    return g(t * direction, y, args)
