"""Methods with an explicit first stage and one coefficient on the diagonal of all others: trapezoidal rule, TR-BDF2."""

import abc
import math
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from .base import NO_FAULT, UNKNOWN, AbstractStageSolver, FlatProblem, flat_problem, outcome
from .collocation import smooth
from .consistency import start_of_step
from .interpolation import CubicHermite
from .mass import mass_term
from .stages import AbstractStageIteration, Memory, SimplifiedNewton, Stages, combine
from .tableau import Tableau


class Form(NamedTuple):
    """The state after the last step of a problem M ẋ = g.

    - ``mass``: M.
    - ``secant``: the mean ẋ over the step.
    - ``fault``: what is wrong with the problem.
    """

    mass: Float[Array, "n n"]
    secant: Float[Array, " n"]
    fault: Int[Array, ""]


class StepBefore(NamedTuple):
    """The state after the last step: its length, ẋ at its start and end, and whether there was one."""

    length: Float[Array, ""]
    f_start: Float[Array, " n"]
    f_end: Float[Array, " n"]
    memory: Memory
    known: Bool[Array, ""]
    form: Form | None


class AbstractDiagonallyImplicit(AbstractStageSolver):
    """A method of order 2 with an error estimate of order 3, whose last stage is the end of the step.

    In a problem M ẋ = g of index 1, the equations without a derivative hold at each stage.

    - ``tableau``: the implicit stages. ``first``: what the explicit first stage contributes to each, shape (s, 1).
    """

    interpolation_cls: ClassVar = CubicHermite
    tableau: ClassVar[Tableau]
    first: ClassVar[np.ndarray]

    root_finder: AbstractStageIteration = SimplifiedNewton()

    @abc.abstractmethod
    def estimate_error(
        self, K: Float[Array, "s_plus_one n"], h: Float[Array, ""], before: StepBefore
    ) -> Float[Array, " n"]:
        """Estimates the error of a step of length h, from ẋ at all stages in units of 1/h and the step before."""

    def order(self, terms) -> int:
        return 2

    def error_order(self, terms) -> int:
        return 3

    def init(self, terms, t0: Any, t1: Any, y0, args) -> StepBefore:
        x0, _ = ravel_pytree(y0)
        nothing, memory = jnp.zeros_like(x0), self.root_finder.start(self.tableau, x0)
        is_ode = mass_term(terms) is None
        form = None if is_ode else Form(jnp.zeros((x0.size, x0.size), x0.dtype), nothing, jnp.asarray(UNKNOWN))
        return StepBefore(jnp.ones((), x0.dtype), nothing, nothing, memory, jnp.asarray(False), form)

    def step(self, terms, t0: Any, t1: Any, y0, args, solver_state: StepBefore, made_jump: Any):
        problem, fault = flat_problem(terms, t0, t1, y0, args), NO_FAULT
        before = solver_state._replace(known=solver_state.known & ~jnp.asarray(made_jump))
        if problem.mass is not None and before.form is not None:
            x0, fault = start_of_step(problem, problem.mass, t0, self.root_finder, before.form.fault, made_jump)
            problem = problem._replace(x0=x0)
        x0, unravel, h = problem.x0, problem.unravel, problem.control.astype(problem.x0.dtype)
        k0 = _first_slope(problem, before, t0, h)
        times = jnp.stack([*(t0 + float(c) * (t1 - t0) for c in self.tableau.c[:-1]), t1])
        from_first = combine(self.first, k0[None])
        known_terms = from_first if problem.mass is None else problem.mass.times(from_first)
        equations = problem.equations(self.tableau, t0, times, x0, known=known_terms)
        guess = jnp.broadcast_to(k0, known_terms.shape)
        if problem.mass is not None:
            # `equations` take slopes times M, and have no use for those of algebraic variables.
            guess = combine(self.tableau.A_inverse, combine(self.tableau.A, guess) + from_first - known_terms)
        stages = self.root_finder.solve(equations, guess, before.memory.forget(made_jump))
        k0, K, form = _slopes(problem, stages, k0, combine(self.tableau.A_inverse, stages.Z - from_first), before)
        error = self.estimate_error(jnp.concatenate([k0[None], K]), h, before)
        if problem.mass is None:
            error = smooth(equations, stages, error)
        else:
            error = smooth(equations, stages, problem.mass.times(error[None])[0])
            error = problem.mass.without_algebraic(error)
        y_error, result = outcome(stages, error, t0, t1, fault)
        y1, k1 = unravel(x0 + stages.Z[-1]), K[-1]
        dense = {"y0": unravel(x0), "y1": y1, "k0": unravel(k0), "k1": unravel(k1)}
        form = None if form is None else form._replace(fault=fault)
        state = StepBefore(h, k0 / h, k1 / h, jax.lax.stop_gradient(stages.memory), jnp.asarray(True), form)
        return y1, unravel(y_error), dense, state, result


def _first_slope(problem: FlatProblem, before: StepBefore, t0: Float[Array, ""], h: Float[Array, ""]) -> Any:
    """Returns h ẋ at the start of a step.

    The last stage of the step before satisfies its equation. Re-evaluated in a stiff problem, f would multiply the
    error of that stage by the large eigenvalues (Hosea & Shampine 1996, section 4). That of an algebraic variable is
    only estimated, so where another M is chosen, it is evaluated.
    """
    reusable, mass = before.known, problem.mass
    if mass is not None and before.form is not None:
        reusable = reusable & jnp.all(mass.matrix == before.form.mass)

    def evaluate():
        slope = problem.slope(t0, problem.x0)
        return slope if mass is None else mass.rates(slope)

    return jax.lax.cond(reusable, lambda: h * before.f_end, evaluate)


def _slopes(
    problem: FlatProblem, stages: Stages, k0: Float[Array, " n"], K: Float[Array, "s n"], before: StepBefore
) -> tuple[Float[Array, " n"], Float[Array, "s n"], Form | None]:
    """Computes h ẋ at the start and at all stages from increments by which M ẋ is right, and the form that the next
    step needs.

    The equations contain no ẋ of algebraic variables: theirs are those of the parabola through three points, or of the
    line through two.
    """
    mass, h = problem.mass, problem.control.astype(problem.x0.dtype)
    if mass is None or before.form is None:
        return k0, stages.K, None
    change = stages.Z[-1]
    bend = jnp.where(before.known, (change - h * before.form.secant) * h / (h + before.length), 0.0)

    def complete(k, estimate):
        return mass.without_algebraic(k) + estimate - mass.without_algebraic(estimate)

    K = jax.vmap(lambda k: complete(k, change + bend))(K)
    return complete(k0, change - bend), K, Form(mass.matrix, change / h, before.form.fault)


def diagonally_implicit(c: list[float], A: list[list[float]]) -> Tableau:
    """Returns the tableau of the implicit stages; their ``A`` is lower triangular with one number on the diagonal.

    A⁻¹ then has one eigenvalue and no basis of eigenvectors. Stages serve in place of modes: on a
    linear problem, the iteration is exact after as many passes as there are stages.
    """
    matrix = np.asarray(A)
    identity = np.eye(len(c))
    return Tableau(
        c=np.asarray(c),
        b=matrix[-1],
        A=matrix,
        A_inverse=np.linalg.inv(matrix),
        expansion=identity,
        eigenvalues=1 / matrix[:1, 0],
        to_modes=identity,
        from_modes=identity,
    )


class Trapezoidal(AbstractDiagonallyImplicit):
    """The trapezoidal rule, y₁ = y₀ + h/2 (f₀ + f₁), as in MATLAB's ode23t.

    Order 2, A-stable and not L-stable: it adds no damping, and stiff components that the steps do not resolve oscillate
    for a long time. For low accuracy.

    The error h³y‴/12 is taken from the second divided difference of f over this step and the one before (Shampine,
    Reichelt & Kierzenka 1999). On a first step and after a jump there is none, and the difference to Euler's rule is
    used instead, which is too large and makes the step short.

    **Arguments:**

    - ``root_finder``: :class:`~jaxball.simulation.solvers.SimplifiedNewton` or
      :class:`~jaxball.simulation.solvers.FixedPoint`.
    """

    tableau: ClassVar[Tableau] = diagonally_implicit([1.0], [[0.5]])
    first: ClassVar[np.ndarray] = np.array([[0.5]])

    def estimate_error(self, K, h, before):
        k0, k1 = K
        # h³/12 times the second derivative of f, from f at three times; k₀ = h f₀, k₁ = h f₁.
        second = k1 - k0 - (k0 - h * before.f_start) * h / before.length
        return jnp.where(before.known, h / (6 * (h + before.length)) * second, (k1 - k0) / 2)


TR_BDF2_GAMMA = 2 - math.sqrt(2)
W, D = math.sqrt(2) / 4, TR_BDF2_GAMMA / 2
# The difference to the embedded formula of order 3.
ERROR_WEIGHTS = np.array([[(4 * W - 1) / 3, -1 / 3, 2 * D / 3]])


class TRBDF2(AbstractDiagonallyImplicit):
    """TR-BDF2, as in MATLAB's ode23tb: the trapezoidal rule to t₀ + (2 − √2) h, then the BDF formula of order 2.

    Order 2, L-stable, stiffly accurate. For stiff problems at low accuracy, with f that is expensive or
    not smooth. Both stages share one matrix, and an embedded formula of order 3 estimates the error (Bank et
    al. 1985; Hosea & Shampine 1996).

    **Arguments:**

    - ``root_finder``: :class:`~jaxball.simulation.solvers.SimplifiedNewton` or
      :class:`~jaxball.simulation.solvers.FixedPoint`.
    """

    tableau: ClassVar[Tableau] = diagonally_implicit([TR_BDF2_GAMMA, 1.0], [[D, 0.0], [W, D]])
    first: ClassVar[np.ndarray] = np.array([[D], [W]])

    def estimate_error(self, K, h, before):
        return combine(ERROR_WEIGHTS, K)[0]
