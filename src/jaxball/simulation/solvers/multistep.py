"""What ``adams`` and ``ndf`` share: step-size controllers of methods that choose their order together with the step."""

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float, Int, PyTree

from ...programs.derivatives.steering import control_error
from .base import AbstractImplicit, FlatProblem

# Two steps are equal if their lengths differ by less than this, relative to them.
EQUAL = 0.01


class PlannedError(eqx.Module):
    """What a multistep method passes to its controller about a step.

    - ``size``: the norm of its error in units of the tolerance.
    - ``growth``, ``shrink``: the length of the next step over that of this one if it is accepted, and if not.
    - ``controller``: the class of the controller that it is for.
    """

    size: Float[Array, ""]
    growth: Float[Array, ""]
    shrink: Float[Array, ""]
    controller: type = eqx.field(static=True)


class Plan(NamedTuple):
    """The plan after a step.

    - ``order``: that of the next step.
    - ``growth``: the next step over this one, if this one is accepted.
    - ``shrink``: the same if it is rejected.
    """

    order: Int[Array, ""]
    growth: Float[Array, ""]
    shrink: Float[Array, ""]


class PairedNorm(eqx.Module):
    """A norm that tells the solver, through diffrax, the class of the step-size controller."""

    norm: Callable[[PyTree], Float[Array, ""]]
    controller: type = eqx.field(static=True)

    def __call__(self, x: PyTree) -> Float[Array, ""]:
        return self.norm(x)


class AbstractMultistepController(diffrax.AbstractAdaptiveStepSizeController):
    """Takes the steps that a multistep method plans together with its order.

    A step is accepted if its error, in the norm, is at most 1 in units of atol + rtol |x|. A step that an outer
    controller has cut short says nothing about longer ones.

    - ``solver``: the name of the method that it pairs with.
    """

    rtol: Any
    atol: Any
    norm: Callable[[PyTree], Float[Array, ""]]  # pyright: ignore[reportIncompatibleVariableOverride]
    dtmin: Any
    dtmax: Any

    solver: ClassVar[str]

    def __init__(
        self,
        rtol: Any,
        atol: Any,
        norm: Callable[[PyTree], Float[Array, ""]] = optx.rms_norm,
        dtmin: Any = None,
        dtmax: Any = None,
    ):
        self.rtol, self.atol, self.norm = rtol, atol, PairedNorm(norm, type(self))
        self.dtmin, self.dtmax = dtmin, dtmax

    def wrap(self, direction):
        return self

    def init(self, terms, t0: Any, t1: Any, y0, dt0, args, func, error_order):
        # A run starts at order 1, whose error is of order 2.
        first = diffrax.PIDController(rtol=self.rtol, atol=self.atol, norm=self.norm)
        end, _ = first.init(terms, t0, t1, y0, dt0, args, func, 2)
        length = self._bound(end - t0)
        return t0 + length, (length, jnp.asarray(False))

    def adapt_step_size(self, t0: Any, t1: Any, y0, y1_candidate, args, y_error, error_order, controller_state):
        if not (isinstance(y_error, PlannedError) and y_error.controller is type(self)):
            raise TypeError(
                f"Argument `solver` must be a jaxball.simulation.solvers.{self.solver} where the step-size "
                f"controller is {type(self).__name__}, which takes the steps that this method plans, but it is a "
                "different one; use diffrax.PIDController for it, or the controller with its name."
            )
        target_length, failed = controller_state
        keep = y_error.size <= 1
        # Only the start of a step carries derivatives: a length with a derivative would amplify it as the steps grow.
        h = jax.lax.stop_gradient(t1 - t0)
        length = h * jnp.where(keep, y_error.growth, y_error.shrink).astype(h.dtype)
        cut = keep & ~failed & (h < 0.99 * target_length)
        length = self._bound(jnp.where(cut, jnp.maximum(length, target_length), length))
        result = diffrax.RESULTS.successful
        if self.dtmin is not None:
            short = ~keep & (length < self.dtmin)
            result = diffrax.RESULTS.where(short, diffrax.RESULTS.dt_min_reached, result)
        start = jnp.where(keep, t1, t0)
        return keep, start, start + length, False, (length, ~keep), result

    def _bound(self, length: Float[Array, ""]) -> Float[Array, ""]:
        return length if self.dtmax is None else jnp.minimum(length, jnp.asarray(self.dtmax, length.dtype))


class AdamsController(AbstractMultistepController):
    """The step-size controller of :class:`Adams`, which takes the steps that the method plans with its order.

    A step is accepted if its error, in the norm, is at most 1 in units of atol + rtol |x|. The next one is twice as
    long, equally long, or shorter, because the method trusts its estimates for higher orders only after several steps
    of the same length. A step that an outer controller has cut short says nothing about longer ones.

    **Arguments:**

    - ``rtol``, ``atol``: the relative and the absolute tolerance.
    - ``norm``: of a state; by default the root mean square.
    - ``dtmin``: a step shorter than this ends the solve with ``RESULTS.dt_min_reached``.
    - ``dtmax``: the longest step.

    **Raises:** ``TypeError`` where the solver is not an :class:`Adams`.

    **Example:**

    >>> import diffrax
    >>> import jax
    >>> import jax.numpy as jnp
    >>> jax.config.update("jax_enable_x64", True)
    >>> from jaxball.simulation.solvers import Adams, AdamsController
    >>> solution = diffrax.diffeqsolve(
    ...     diffrax.ODETerm(lambda t, y, args: -y),
    ...     Adams(),
    ...     t0=0.0,
    ...     t1=1.0,
    ...     dt0=None,
    ...     y0=jnp.array(1.0),
    ...     stepsize_controller=AdamsController(rtol=1e-10, atol=1e-10),
    ... )
    >>> print(solution.ys[0].round(8))
    0.36787944
    """

    solver: ClassVar[str] = "Adams"


class NDFController(AbstractMultistepController):
    """The step-size controller of :class:`NDF`, which takes the steps that the method plans with its order.

    A step is accepted if its error, in the norm, is at most 1 in units of atol + rtol |x|. The length is changed at
    most once in as many steps as the method has points, because its differences are those of equal steps. A step that
    an outer controller has cut short says nothing about longer ones.

    **Arguments:**

    - ``rtol``, ``atol``: the relative and the absolute tolerance.
    - ``norm``: of a state; by default the root mean square.
    - ``dtmin``: a step shorter than this ends the solve with ``RESULTS.dt_min_reached``.
    - ``dtmax``: the longest step.

    **Raises:** ``TypeError`` where the solver is not an :class:`NDF`.

    **Example:**

    >>> import diffrax
    >>> import jax
    >>> import jax.numpy as jnp
    >>> jax.config.update("jax_enable_x64", True)
    >>> from jaxball.simulation.solvers import NDF, NDFController
    >>> solution = diffrax.diffeqsolve(
    ...     diffrax.ODETerm(lambda t, y, args: -1e6 * (y - jnp.cos(t))),
    ...     NDF(),
    ...     t0=0.0,
    ...     t1=1.0,
    ...     dt0=None,
    ...     y0=jnp.array(0.0),
    ...     stepsize_controller=NDFController(rtol=1e-8, atol=1e-8),
    ... )
    >>> print(solution.ys[0].round(6))
    0.540303
    """

    solver: ClassVar[str] = "NDF"


class AbstractMultistep(AbstractImplicit):
    """A multistep method for diffrax that chooses its order together with its step.

    In diffrax a controller only gets the error of a step, and a solver only gets the ends of the steps to come. So the
    solver, which diffrax gives the tolerances like the root finder of an implicit one, plans the next step, and passes
    its plan to the controller, a ``controller_cls``, instead of a bare error.
    """

    controller_cls: ClassVar[type[AbstractMultistepController]]

    max_order: eqx.AbstractVar[int]

    def require_controller(self) -> None:
        """Raises ``TypeError`` where the tolerances are not those of the controller that this method needs."""
        norm, needed = self.root_finder.norm, self.controller_cls
        if not (isinstance(norm, PairedNorm) and norm.controller is needed):
            name = type(self).__name__
            raise TypeError(
                f"Argument `stepsize_controller` must be a jaxball.simulation.solvers.{needed.__name__}, or a "
                f"controller around one, where the solver is {name}, which chooses its order together "
                "with the step, but it is a different one."
            )

    def plan_error(self, size: Float[Array, ""], plan: Plan) -> PlannedError:
        """Returns what the controller is passed about a step with an error of this size."""
        return PlannedError(size, plan.growth, plan.shrink, self.controller_cls)

    def sizes(
        self, problem: FlatProblem, x1: Float[Array, " n"], errors: Float[Array, "rows n"]
    ) -> Float[Array, " rows"]:
        """Computes the norms of errors of a step to x₁, in units of the tolerance, in which those of a probe count.

        They are only for choosing steps, and must not be differentiated.
        """
        rtol, atol, norm = self.root_finder.rtol, self.root_finder.atol, self.root_finder.norm
        weights = atol + rtol * jnp.maximum(*jnp.abs(jax.lax.stop_gradient(jnp.stack([problem.x0, x1]))))
        ends = jnp.broadcast_to(problem.x0, errors.shape), jnp.broadcast_to(x1, errors.shape)
        rows = jnp.zeros(errors.shape[0], errors.dtype)
        tolerance = rows + jnp.maximum(rtol, atol).astype(rows.dtype)
        errors, _ = control_error(errors, ends, jnp.broadcast_to(weights, errors.shape), tolerance, rows)
        shares = jax.lax.stop_gradient(errors) * (1 / weights)[None]
        return jax.vmap(lambda row: norm(problem.unravel(row)))(shares)


def check_order(max_order: int, highest: int) -> int:
    """Checks the highest order that a method may take.

    **Raises:** ``ValueError`` for one that is not from 1 to ``highest``.
    """
    if isinstance(max_order, bool) or max_order not in range(1, highest + 1):
        raise ValueError(f"Argument `max_order` must be a whole number from 1 to {highest}, but it is {max_order}.")
    return max_order


def controller_class(solver: diffrax.AbstractSolver | None) -> type:
    """Returns the class of the controllers that choose steps for ``solver`` by the tolerances only."""
    return solver.controller_cls if isinstance(solver, AbstractMultistep) else diffrax.PIDController
