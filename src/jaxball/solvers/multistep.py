"""Common to the multistep methods of this package."""

from typing import Any, ClassVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .flat import FlatProblem
from .multistep_controller import AbstractMultistepController, PairedNorm


class AbstractMultistep(diffrax.AbstractImplicitSolver, diffrax.AbstractAdaptiveSolver):
    """A multistep method for diffrax that chooses its order together with its step.

    In diffrax a controller only gets the error of a step, and a solver only gets the ends of the steps to come. So the
    solver, which diffrax gives the tolerances like the root finder of an implicit one, plans the next step, and passes
    its plan to the controller, a ``controller_cls``, instead of a bare error.
    """

    term_structure: ClassVar = diffrax.AbstractTerm
    controller_cls: ClassVar[type[AbstractMultistepController]]

    max_order: eqx.AbstractVar[int]
    root_finder: eqx.AbstractVar[Any]  # pyright: ignore[reportIncompatibleVariableOverride]

    def func(self, terms, t0, y0, args):
        return terms.vf(t0, y0, args)

    def require_controller(self) -> None:
        """Raises ``TypeError`` where the tolerances are not those of the controller that this method needs."""
        norm, needed = self.root_finder.norm, self.controller_cls
        if not (isinstance(norm, PairedNorm) and norm.controller is needed):
            name = type(self).__name__
            raise TypeError(
                f"Argument `stepsize_controller` must be a jaxball.solvers.{needed.__name__}, or a controller around "
                f"one, where the solver is {name}, which chooses its order together with the step, but it is a "
                "different one."
            )

    def sizes(
        self, problem: FlatProblem, x1: Float[Array, " n"], errors: Float[Array, "rows n"]
    ) -> Float[Array, " rows"]:
        """The norms of errors of a step to x₁, in units of the tolerance.

        They are only for choosing steps, and must not be differentiated.
        """
        x0, x1, errors = jax.lax.stop_gradient((problem.x0, x1, errors))
        rtol, atol, norm = self.root_finder.rtol, self.root_finder.atol, self.root_finder.norm
        weight = 1 / (atol + rtol * jnp.maximum(jnp.abs(x0), jnp.abs(x1)))
        return jax.vmap(lambda row: norm(problem.unravel(row * weight)))(errors)


def checked_order(max_order: int, highest: int) -> int:
    """The highest order that a method may take.

    **Raises:** ``ValueError`` for one that is not from 1 to ``highest``.
    """
    if isinstance(max_order, bool) or max_order not in range(1, highest + 1):
        raise ValueError(f"Argument `max_order` must be a whole number from 1 to {highest}, but it is {max_order}.")
    return max_order


def controller_class(solver: diffrax.AbstractSolver | None) -> type:
    """The class of the controllers that choose steps for ``solver`` by the tolerances only."""
    return solver.controller_cls if isinstance(solver, AbstractMultistep) else diffrax.PIDController
