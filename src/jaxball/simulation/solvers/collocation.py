"""The collocation methods, at the nodes of Gauss and at those of Radau, and estimates of the error of their steps."""

import abc
import functools
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from .base import NO_FAULT, UNKNOWN, AbstractStageSolver, flat_problem, outcome
from .consistency import start_of_step
from .interpolation import CollocationPolynomial, legendre
from .mass import mass_term
from .stages import AbstractStageIteration, FixedPoint, Memory, SimplifiedNewton, StageEquations, Stages, combine
from .tableau import Tableau, gauss, radau_right


class AbstractErrorEstimate(eqx.Module):
    """An estimate of the error of a step."""

    @abc.abstractmethod
    def order(self, stages: int) -> int:
        """Returns the power of the step that the estimate is proportional to."""

    @abc.abstractmethod
    def estimate(
        self, equations: StageEquations, stages: Stages, coefficients: Float[Array, "s n"]
    ) -> Float[Array, " n"]:
        """Computes the estimate, given the Legendre ``coefficients`` of the slopes K."""


class EmbeddedError(AbstractErrorEstimate):
    """For stiff problems: the estimate of radau5, for any odd number of stages.

    The slope of the collocation polynomial at the start of the step misses the vector field there by a
    defect; (γM − h∂g/∂x)⁻¹ times it is the distance to an embedded formula of order s, and stays small
    in stiff components (Hairer & Wanner 1996, section IV.8, eqs. (8.17)–(8.19)).
    """

    def order(self, stages: int) -> int:
        return stages + 1

    def estimate(self, equations, stages, coefficients):
        f0 = equations.slope(equations.t0, equations.x0) if stages.f0 is None else stages.f0
        # P̃ₖ at the start of the step is (−1)ᵏ.
        at_start = (-1.0) ** np.arange(len(coefficients))
        defect = f0 - equations.mass_times(combine(at_start[None], coefficients))[0]
        return smooth(equations, stages, defect / float(equations.tableau.eigenvalues[0].real))


class TailError(AbstractErrorEstimate):
    """For smooth problems, where the solution is needed between the steps as well.

    The last Legendre coefficients of the slopes predict the next ones, which the collocation polynomial lacks, so its
    error is controlled over the whole step.
    """

    def order(self, stages: int) -> int:
        return stages - 1

    def estimate(self, equations, stages, coefficients):
        return _size_of(_tail, coefficients) / (2 * len(coefficients))


class StepError(AbstractErrorEstimate):
    """For smooth problems, where the solution is needed only at the ends of steps.

    There a collocation method has about twice the order that it has between (superconvergence): its error is the
    product of two truncated tails of the same decay, that of the polynomial and that of the problem's sensitivity, and
    is estimated as the tail squared over the leading coefficient. Steps become about twice as long as with
    :class:`TailError`; the dense output then has only about half the requested digits.
    """

    def order(self, stages: int) -> int:
        return 2 * stages - 3

    def estimate(self, equations, stages, coefficients):
        return _size_of(_tail_squared, coefficients)


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _size_of(size: Callable[[Array], Array], coefficients: Float[Array, "s n"]) -> Float[Array, " n"]:
    """Computes the ``size`` of coefficients. In the place of its derivative is the size of their tangents: where all
    are 0, their sizes have no derivative, and the error of a probe is that of a series of its own.
    """
    return size(coefficients)


@_size_of.defjvp
def _size_of_tangents(size: Any, primals: Any, tangents: Any) -> tuple[Array, Array]:
    return size(*primals), size(*tangents)


def _tail_squared(coefficients: Float[Array, "s n"]) -> Float[Array, " n"]:
    """Computes the tail squared over the leading coefficient."""
    tail, largest = _tail(coefficients), jnp.max(jnp.abs(coefficients), axis=0)
    return tail * tail / jnp.maximum(largest, jnp.finfo(tail.dtype).tiny)


def _tail(coefficients: Float[Array, "s n"]) -> Float[Array, " n"]:
    """Returns the larger of the last two coefficients: either alone may vanish by symmetry."""
    return jnp.max(jnp.abs(coefficients[-2:]), axis=0)


def smooth(equations: StageEquations, stages: Stages, error: Float[Array, " n"]) -> Float[Array, " n"]:
    """Damps the stiff components of ``error``, as γ (γM − h∂g/∂x)⁻¹ does, where the iteration has the matrix.

    The result is only for choosing steps. Its derivative, for the error of a probe, takes the matrix as constant.
    """
    if stages.smooth is None:
        return error
    return float(equations.tableau.eigenvalues[0].real) * jnp.sum(stages.smooth * error[None], axis=1)


class CollocationState(NamedTuple):
    """The state passed from one step to the next: its polynomial, the slope at its end, and its iteration's state.

    ``fault`` says what is wrong with a problem M ẋ = g.
    """

    coefficients: Float[Array, "s n"]
    control: Float[Array, ""]
    slope: Float[Array, " n"]
    memory: Memory
    fault: Int[Array, ""] | None


class AbstractCollocation(AbstractStageSolver):
    """Collocation: the polynomial of degree s through y₀ that satisfies the equation at s nodes."""

    interpolation_cls: ClassVar = CollocationPolynomial

    error: eqx.AbstractVar[AbstractErrorEstimate]

    @property
    @abc.abstractmethod
    def tableau(self) -> Tableau:
        """The coefficients."""

    def error_order(self, terms) -> int:
        return self.error.order(len(self.tableau.c))

    def init(self, terms, t0: Any, t1: Any, y0, args) -> CollocationState:
        x0, _ = ravel_pytree(y0)
        fault = None if mass_term(terms) is None else jnp.asarray(UNKNOWN)
        empty = jnp.zeros((len(self.tableau.c), x0.size), x0.dtype)
        return CollocationState(empty, terms.contr(t0, t1), empty[0], self.root_finder.start(self.tableau, x0), fault)

    def step(self, terms, t0: Any, t1: Any, y0, args, solver_state, made_jump: Any):
        problem = flat_problem(terms, t0, t1, y0, args)
        tableau, unravel, mass = self.tableau, problem.unravel, problem.mass
        x0, fault = problem.x0, solver_state.fault
        if tableau.c[-1] != 1:
            # The end of a step is not a stage, and would not satisfy the equations without a derivative.
            problem.refuse_mass(self)
        if mass is not None:
            x0, fault = start_of_step(problem, mass, t0, self.root_finder, fault, made_jump)
        # Rounding must not lead past the end, which may be a kink.
        times = jnp.minimum(t0 + (t1 - t0) * jnp.asarray(tableau.c, jnp.result_type(t0)), t1)
        f0 = None
        if tableau.c[-1] == 1:
            # The last stage of the step before ended here. In a first step and after a jump it did not, but there the
            # matrices of Newton's iteration are new, and f₀ with them.
            slope = solver_state.slope * (problem.control / solver_state.control).astype(x0.dtype)
            f0 = slope if mass is None else mass.times(slope[None])[0]
        equations = problem.equations(tableau, t0, times, x0, f0=f0)
        guess = jnp.where(made_jump, 0.0, _predict(tableau, solver_state, problem.control))
        stages = self.root_finder.solve(equations, guess, solver_state.memory.forget(made_jump))
        coefficients = combine(tableau.expansion, stages.K)
        increment = stages.Z[-1] if tableau.c[-1] == 1 else coefficients[0]
        error = self.error.estimate(equations, stages, coefficients)
        if mass is not None:
            error = mass.without_algebraic(error)
        y_error, result = outcome(stages, error, t0, t1, NO_FAULT if fault is None else fault)
        dense = {"y0": unravel(x0), "coefficients": jax.vmap(unravel)(coefficients)}
        state = CollocationState(coefficients, problem.control, stages.K[-1], stages.memory, fault)
        # The next step uses the state for guesses and estimates only, which do not change what its iteration converges
        # to.
        return unravel(x0 + increment), unravel(y_error), dense, jax.lax.stop_gradient(state), result


def fills_vectors(solver: diffrax.AbstractSolver) -> bool:
    """Returns whether a step of one run fills vectors by itself, by its stages and their matrices.

    Of runs side by side, all would make new matrices whenever one of them does.
    """
    while isinstance(solver, diffrax.AbstractWrappedSolver):
        solver = solver.solver
    return isinstance(solver, AbstractCollocation) and isinstance(solver.root_finder, SimplifiedNewton)


def _predict(tableau: Tableau, state: CollocationState, control: Float[Array, ""]) -> Float[Array, "s n"]:
    """Predicts the slopes at the nodes, by extrapolating the polynomial of the last step.

    Beyond its step P̃ₖ grows, the faster the higher k, so the last coefficients may be meaningless: terms are used as
    long as they decrease.
    """
    coefficients, s = state.coefficients, len(tableau.c)
    dtype, ratio = coefficients.dtype, control / state.control
    beyond = jnp.stack(legendre(1 + ratio * jnp.asarray(tableau.c, control.dtype), s), axis=1).astype(dtype)
    sizes = jnp.max(jnp.abs(coefficients), axis=1) * jnp.abs(beyond[-1])
    # Beyond the smallest term they grow again: a coefficient of rounding times a large P̃ₖ.
    last = jnp.argmin(jnp.where(sizes > 0, sizes, jnp.inf))
    terms = jnp.where((jnp.arange(s) <= last)[:, None], coefficients, 0.0)
    return ratio.astype(dtype) * jnp.sum(beyond[:, :, None] * terms[None], axis=1)


MOST_STAGES = 20
# With more, the modes of A⁻¹ are too nearly parallel for float64.
MOST_STAGES_NEWTON = 12


class Gauss(AbstractCollocation):
    """Gauss collocation with s stages: order 2s, the highest that s stages can have.

    A-stable and symmetric. It preserves every quadratic invariant, including the norm |q| of a versor, as accurately as
    the iteration is solved, and nearly preserves energy; it does not damp stiff components (R(∞) = ±1). With
    fixed-point iteration and 6 to 12 stages, it is the method of choice for smooth, non-stiff problems at tight
    tolerances, down to rounding.

    The vector field must be smooth within each step: give its kinks to :class:`StepToKinks`. A jump after the last node
    of a step is seen by no stage and no estimate, and the result is silently wrong.

    **Arguments:**

    - ``stages``: from 2 to 20; 8 suits tolerances from 1e-6 to 1e-13.
    - ``root_finder``: :class:`FixedPoint`, or :class:`SimplifiedNewton` (up to 12 stages) if the problem is stiff.
    - ``error``: :class:`TailError`, :class:`StepError` if the solution is needed only at the ends of steps, or
      :class:`EmbeddedError` (odd numbers of stages).

    Source: Hairer, Lubich & Wanner, *Geometric Numerical Integration* (2006), sections II.1.3, IV.2.1 and
    VIII.6; Antoñana, Makazaga & Murua, *Numer. Algorithms* 76 (2017) 861–880, on its fixed-point iteration.

    **Raises:** ``ValueError`` for a number of stages that does not fit the other arguments.

    **Example:**

    >>> import diffrax
    >>> from jaxball.simulation.solvers import Gauss
    >>> Gauss(stages=4).order(diffrax.ODETerm(lambda t, y, args: -y))
    8
    """

    stages: int = eqx.field(static=True, default=8)
    root_finder: AbstractStageIteration = FixedPoint()
    error: AbstractErrorEstimate = TailError()

    def __check_init__(self):
        newton = isinstance(self.root_finder, SimplifiedNewton)
        most = MOST_STAGES_NEWTON if newton else MOST_STAGES
        if not 2 <= self.stages <= most:
            with_newton = " with SimplifiedNewton" if newton else ""
            raise ValueError(f"Argument `stages` must be from 2 to {most}{with_newton}, but it is {self.stages}.")
        if isinstance(self.error, EmbeddedError) and self.stages % 2 == 0:
            raise ValueError(
                "Argument `stages` must be odd with EmbeddedError, which needs a real eigenvalue of A⁻¹, "
                f"but it is {self.stages}; use TailError."
            )

    @property
    def tableau(self) -> Tableau:
        """The coefficients."""
        return gauss(self.stages)

    def order(self, terms) -> int:
        return 2 * self.stages


STAGES = (3, 5, 7)


class RadauIIA(AbstractCollocation):
    """Radau IIA with 3, 5 or 7 stages: orders 5, 9 and 13.

    Collocation at the Radau points, the last of which is the end of the step. A- and L-stable, stiffly accurate, and of
    full order in the algebraic variables of M ẋ = g(t, x) with index 1. The method of the codes radau5 and radau; the
    paper uses the former.

    **Arguments:**

    - ``stages``: 3 for accuracies to about 1e-6, 5 to about 1e-9, 7 beyond; at loose tolerances on rough
      solutions, fewer stages.
    - ``root_finder``: :class:`SimplifiedNewton`, or :class:`FixedPoint` if the problem is not stiff.
    - ``error``: :class:`EmbeddedError`, or :class:`TailError` and :class:`StepError` for smooth problems.

    Source: Hairer & Wanner, *Solving Ordinary Differential Equations II* (1996), sections IV.5 and IV.8;
    Hairer & Wanner, *Stiff differential equations solved by Radau methods*, J. Comput. Appl. Math. 111
    (1999) 93–111, for 5 and 7 stages.

    **Raises:** ``ValueError`` for another number of stages.

    **Example:**

    >>> import diffrax
    >>> from jaxball.simulation.solvers import RadauIIA
    >>> RadauIIA(stages=5).order(diffrax.ODETerm(lambda t, y, args: -y))
    9
    """

    stages: int = eqx.field(static=True, default=3)
    root_finder: AbstractStageIteration = SimplifiedNewton()
    error: AbstractErrorEstimate = EmbeddedError()

    def __check_init__(self):
        if self.stages not in STAGES:
            raise ValueError(f"Argument `stages` must be 3, 5 or 7, but it is {self.stages}.")

    @property
    def tableau(self) -> Tableau:
        """The coefficients."""
        return radau_right(self.stages)

    def order(self, terms) -> int:
        return 2 * self.stages - 1
