"""Solvers and step-size controllers that wrap another: they project the state after each step, or end steps at kinks.

The loop of a solve wraps its own in them.
"""

from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, PyTree

from ...numerics.kinks import after, before, before_kink
from .base import approach_of


class AbstractWrappingSolver(diffrax.AbstractAdaptiveSolver, diffrax.AbstractWrappedSolver):
    """A solver that behaves like ``solver``, except for what its subclass changes."""

    solver: eqx.AbstractVar[diffrax.AbstractSolver]  # pyright: ignore[reportIncompatibleVariableOverride]

    term_structure = property(attrgetter("solver.term_structure"), doc="The terms that the inner solver takes.")
    interpolation_cls = property(attrgetter("solver.interpolation_cls"), doc="The inner solver's dense output.")  # pyright: ignore[reportAssignmentType]
    approach = property(
        lambda self: approach_of(self.solver), doc="The inner solver's part of the time until a singularity for a step."
    )
    root_finder = property(attrgetter("solver.root_finder"), doc="Where diffrax puts the tolerances.")
    controller_cls = property(attrgetter("solver.controller_cls"), doc="The controllers of a multistep method.")
    scan_kind = property(
        attrgetter("solver.scan_kind"),
        doc="The kind of loop of an explicit solver, which ``diffrax.ForwardMode`` replaces by one that has a jvp.",
    )

    def order(self, terms):
        return self.solver.order(terms)

    def error_order(self, terms):
        return self.solver.error_order(terms)

    def init(self, terms, t0, t1, y0, args):
        return self.solver.init(terms, t0, t1, y0, args)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        return self.solver.step(terms, t0, t1, y0, args, solver_state, made_jump)

    def func(self, terms, t0, y0, args):
        return self.solver.func(terms, t0, y0, args)


class AbstractWrappingController(diffrax.AbstractAdaptiveStepSizeController):
    """A step-size controller that chooses the steps of ``controller``, except for what its subclass changes."""

    controller: eqx.AbstractVar[diffrax.AbstractAdaptiveStepSizeController]

    rtol = property(attrgetter("controller.rtol"), doc="The relative tolerance of the inner controller.")  # pyright: ignore[reportAssignmentType]
    atol = property(attrgetter("controller.atol"), doc="The absolute tolerance of the inner controller.")  # pyright: ignore[reportAssignmentType]
    norm = property(attrgetter("controller.norm"), doc="The norm of the inner controller.")  # pyright: ignore[reportAssignmentType]

    def wrap(self, direction):
        return eqx.tree_at(lambda s: s.controller, self, self.controller.wrap(direction))

    def init(self, terms, t0: Any, t1: Any, y0, dt0, args, func, error_order):
        return self.controller.init(terms, t0, t1, y0, dt0, args, func, error_order)

    def adapt_step_size(self, t0, t1, y0, y1_candidate, args, y_error, error_order, controller_state):
        return self.controller.adapt_step_size(t0, t1, y0, y1_candidate, args, y_error, error_order, controller_state)


class Projected(AbstractWrappingSolver):
    """``solver`` with each step followed by a projection, such as that of a versor to |q| = 1.

    The order is preserved if ``project`` moves a state by no more than a multiple of its distance to the constraint, as
    the nearest point on it does: a step is off by its local error, and the projection moves it by at most as much again
    (Hairer, Lubich & Wanner 2006, section IV.4). Dense output is projected too.

    **Arguments:**

    - ``solver``: any diffrax solver.
    - ``project``: maps a state to a state on the constraint.

    **Example:**

    >>> import diffrax
    >>> import jax.numpy as jnp
    >>> from jaxball.simulation.solvers import Projected
    >>> solver = Projected(diffrax.Euler(), project=lambda y: y / jnp.sqrt((y**2).sum()))
    >>> turning = diffrax.ODETerm(lambda t, y, args: jnp.stack([-y[1], y[0]]))
    >>> end = diffrax.diffeqsolve(turning, solver, 0.0, 1.0, 0.1, jnp.array([1.0, 0.0])).ys[-1]
    >>> print((end**2).sum().round(12))  # Euler's method alone ends outside the circle
    1.0
    """

    solver: diffrax.AbstractSolver  # pyright: ignore[reportIncompatibleVariableOverride]
    project: Callable[[PyTree[Array]], PyTree[Array]]

    @property
    def interpolation_cls(self) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The inner solver's dense output, projected."""
        return self.projecting(self.solver.interpolation_cls)

    def projecting(self, interpolation: Callable[..., diffrax.AbstractLocalInterpolation]) -> Any:
        """Makes an interpolation projected."""
        return _ProjectedInterpolation(interpolation, self.project)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        y1, y_error, dense, state, result = self.solver.step(terms, t0, t1, y0, args, solver_state, made_jump)
        return self.project(y1), y_error, dense, state, result


class ProjectedSteps(AbstractWrappingSolver):
    """``solver`` with each step followed by a projection that may depend on the time and on the arguments of the field.

    Dense output is that of ``solver``, so that what is read off within a step is projected where it is read.

    **Arguments:**

    - ``solver``: any diffrax solver.
    - ``project``: maps a time, a state and the field's arguments to a state on the constraint at that time.

    **Example:**

    >>> import diffrax
    >>> import jax.numpy as jnp
    >>> from jaxball.simulation.solvers.wrapping import ProjectedSteps
    >>> solver = ProjectedSteps(diffrax.Euler(), project=lambda t, y, args: y.at[0].set(jnp.exp(t)))
    >>> growing = diffrax.ODETerm(lambda t, y, args: y)
    >>> end = diffrax.diffeqsolve(growing, solver, 0.0, 1.0, 0.1, jnp.array([1.0, 1.0])).ys[-1]
    >>> print(end.round(6))  # Euler's method alone gives 1.1¹⁰
    [2.718282 2.593742]
    """

    solver: diffrax.AbstractSolver  # pyright: ignore[reportIncompatibleVariableOverride]
    project: Callable[[Any, PyTree[Array], Any], PyTree[Array]] = eqx.field(static=True)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        y1, y_error, dense, state, result = self.solver.step(terms, t0, t1, y0, args, solver_state, made_jump)
        return self.project(t1, y1, args), y_error, dense, state, result


class _ProjectedInterpolation(eqx.Module):
    """Makes the interpolation of a step, like an interpolation class."""

    inner: Callable[..., diffrax.AbstractLocalInterpolation] = eqx.field(static=True)
    project: Callable[[PyTree[Array]], PyTree[Array]]

    def __call__(self, *, t0, t1, **dense_info) -> "_ProjectedStep":
        return _ProjectedStep(t0, t1, self.inner(t0=t0, t1=t1, **dense_info), self.project)


class _ProjectedStep(diffrax.AbstractLocalInterpolation):
    t0: Any
    t1: Any
    inner: diffrax.AbstractLocalInterpolation
    project: Callable[[PyTree[Array]], PyTree[Array]]

    def evaluate(self, t0, t1=None, left=True):
        if t1 is not None:
            return jax.tree.map(lambda a, b: b - a, self.evaluate(t0, left=left), self.evaluate(t1, left=left))
        return self.project(self.inner.evaluate(t0, left=left))


class StepToKinks(AbstractWrappingController):
    """Ends a step just before each kink and begins the next just after it, so that no step crosses one.

    Like ``diffrax.ClipStepSizeController(controller, jump_ts=kinks)``, for the few kinks of a driven ball: they are
    neither sorted nor searched, which took more than a quarter of a solve, and the step after a kink is as long as the
    step that the kink cut short would have been.

    **Arguments:**

    - ``controller``: the step-size controller that chooses the steps in between.
    - ``kinks``: times, in any order, inside the run or outside.

    Derivatives with respect to the times of kinks are right if each jump of the vector field belongs to a single kink.
    """

    controller: diffrax.AbstractAdaptiveStepSizeController  # pyright: ignore[reportIncompatibleVariableOverride]
    kinks: Float[Array, " kinks"]

    def __init__(
        self,
        controller: diffrax.AbstractAdaptiveStepSizeController,
        kinks: Float[ArrayLike, " kinks"] | Sequence[float],
    ):
        self.controller = controller
        self.kinks = jnp.asarray(kinks)

    def wrap(self, direction):
        controller = self.controller.wrap(direction)
        return eqx.tree_at(lambda s: (s.controller, s.kinks), self, (controller, self.kinks * direction))

    def init(self, terms, t0: Any, t1: Any, y0, dt0, args, func, error_order):
        t1, state = self.controller.init(terms, t0, t1, y0, dt0, args, func, error_order)
        return self._clip(t0, t1), (t1 - t0, state)

    def adapt_step_size(self, t0, t1, y0, y1_candidate, args, y_error, error_order, controller_state):
        target_length, state = controller_state
        keep, next_t0, next_t1, made_jump, state, result = self.controller.adapt_step_size(
            t0, t1, y0, y1_candidate, args, y_error, error_order, state
        )
        # Only the start of a step and kinks carry derivatives. A step length with a derivative would amplify it after a
        # kink, as the steps grow.
        length, target_length = jax.lax.stop_gradient((next_t1 - next_t0, target_length))
        # A step that was cut short says nothing about longer ones.
        length = jnp.where(keep & (t1 - t0 < 0.99 * target_length), jnp.maximum(length, target_length), length)
        past, jumped = self._past(jnp.asarray(next_t0))
        return keep, past, self._clip(past, past + length), made_jump | jumped, (length, state), result

    def _clip(self, t0: Float[Array, ""], t1: Float[Array, ""]) -> Float[Array, ""]:
        return before_kink(self.kinks.astype(t0.dtype), t0, t1)

    def _past(self, t: Float[Array, ""]) -> tuple[Float[Array, ""], Bool[Array, ""]]:
        """Returns the first time after the kink where ``t`` is the last one before it, and whether it is."""
        kinks = self.kinks.astype(t.dtype)
        here = (t == before(kinks)) | (t == kinks)
        beyond = jnp.min(jnp.where(here, after(kinks), jnp.inf))
        jumped = jnp.any(here)
        return jnp.where(jumped, beyond, t), jumped
