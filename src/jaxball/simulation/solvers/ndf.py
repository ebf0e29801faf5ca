"""The numerical differentiation formulas of variable order, with steps that are nearly constant."""

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from ...numerics.arrays import entry
from .base import NO_FAULT, UNKNOWN, FlatProblem, Slope, flat_problem, outcome
from .consistency import start_of_step
from .diagonal import diagonally_implicit
from .differences import (
    HARMONIC_SUMS,
    HIGHEST_BDF,
    KAPPAS,
    Kappa,
    advance,
    leading,
    ndf_error_constants,
    products,
    resample,
    stretch,
    up_to,
)
from .interpolation import BackwardPolynomial
from .mass import mass_term
from .multistep import EQUAL, AbstractMultistep, NDFController, Plan, check_order
from .stages import FROM_CONTROLLER, AbstractStageIteration, Memory, SimplifiedNewton, Stages

# The next step over the one that would have an error of 1, by the estimate.
CAUTION = 0.8
# Below this increase the step stays as it is, and so do the matrices of Newton's iteration.
LEAST_GROWTH = 1.2
GREATEST_GROWTH = 10.0
# If the error is so close to 1 that the next step should be shorter than this, it is shortened, before it fails.
LONGEST_SHRUNK = 0.9
SHORTEST_RETRY, LONGEST_RETRY = 0.2, 0.8
# After an iteration that did not converge.
GIVEN_UP = 0.3


def plan(errors: Float[Array, "3"], order: Int[Array, ""], equal: Int[Array, ""], highest: int) -> Plan:
    """Returns the plan after a step.

    **Arguments:**

    - ``errors``: of a step of this length by the formulas of order k − 1, k and k + 1, in units of the tolerance.
    - ``order``: that of the step, k, and ``highest`` the highest available.
    - ``equal``: how many steps, this one included, had the same length and order. Estimates are trusted after k + 1.
    """
    ready = equal > order
    orders = order - 1 + jnp.arange(3)
    exists = (orders >= 1) & (orders <= highest)
    # Whether the next step by each order would be longer than this one by this factor, computed without powers.
    grows = exists & (errors <= _error_of(LEAST_GROWTH, orders, highest, errors.dtype))
    stays = exists & (errors <= _error_of(LONGEST_SHRUNK, orders, highest, errors.dtype))
    changes = ready & (jnp.any(grows) | ~jnp.any(stays))

    def change() -> Plan:
        lengths = jnp.where(exists, CAUTION * _ratio(errors, orders), 0.0)
        longest, here = jnp.max(lengths), lengths[1]
        factor = jnp.where(ready | stays[1], 1.0, here)
        growth = jnp.where(changes, jnp.minimum(longest, GREATEST_GROWTH), factor)
        again = jnp.clip(LONGEST_SHRUNK * here, SHORTEST_RETRY, LONGEST_RETRY)
        shrink = jnp.where(jnp.isfinite(errors[1]), again, GIVEN_UP)
        return Plan(jnp.where(changes, order - 1 + jnp.argmax(lengths), order), growth, shrink)

    # Most steps change nothing, and powers are a large part of the cost of a step with few equations.
    same = Plan(order, jnp.ones_like(errors[1]), jnp.ones_like(errors[1]))
    return jax.lax.cond(changes | ~stays[1], change, lambda: same)


def _error_of(growth: float, orders: Int[Array, "3"], highest: int, dtype: Any) -> Float[Array, "3"]:
    """Computes the error of a step of each order, where the next one is to be ``growth`` times as long."""
    errors = jnp.asarray((CAUTION / growth) ** np.arange(1, highest + 3), dtype)
    return jnp.sum(jnp.where(orders[:, None] == jnp.arange(highest + 2)[None], errors[None], 0.0), axis=1)


def _ratio(errors: Float[Array, "3"], orders: Int[Array, "3"]) -> Float[Array, "3"]:
    """Computes the ratio of the length of a step with the error 1 to the length of one with ``errors``."""
    safe = jnp.where((errors > 0) & jnp.isfinite(errors), errors, jnp.finfo(errors.dtype).tiny)
    return (1 / safe) ** (1.0 / (orders + 1).astype(errors.dtype))


# M (x − P) − (h/α) g(t, x) = −M ψ is the equation of a step of Euler's implicit method, of length h/α.
EULER = diagonally_implicit([1.0], [[1.0]])
# A prediction from several points is so accurate that the iteration may be slower than in other methods, and end
# earlier. Compared with the usual numbers, these need a third fewer matrices and a seventh fewer evaluations, with no
# more steps and no larger error. A kappa of 0.05 costs some problems more steps.
ITERATION = SimplifiedNewton(kappa=0.03, reuse=0.6, slowest=0.3)
# Lengths of equal steps differ by rounding, and the square of the effect on their differences is negligible.
ROUNDING = 1e-8
# A step shorter than this, relative to the distance of the points, adds none.
SHORT_NDF_STEP = 0.2


class NDFState(NamedTuple):
    """The state passed from the steps so far to the next.

    - ``differences``: the backward differences of the last states, from order 0 to the highest; above that of the next
      step they are zero.
    - ``beyond``: those of the two orders after that of the next step, by which errors are estimated.
    - ``length``: the distance of their points, which is the length of the last step.
    - ``order``: of the next step; 0 where nothing is known yet.
    - ``equal``: how many of the last steps had the same length and order.
    - ``stayed``: whether the last step was so short that it added no point.
    - ``memory``: the state of the iteration.
    - ``fault``: what is wrong with a problem M ẋ = g.
    """

    differences: Float[Array, "rows n"]
    beyond: Float[Array, "2 n"]
    length: Float[Array, ""]
    order: Int[Array, ""]
    equal: Int[Array, ""]
    stayed: Bool[Array, ""]
    memory: Memory
    fault: Int[Array, ""] | None


class NDF(AbstractMultistep):
    """The numerical differentiation formulas of Klopfenstein and Shampine, of orders 1 to 5, as in MATLAB's ode15s.

    The derivative, at the end of the step, of the polynomial through the last k + 1 states equals the slope there. For
    stiff problems at moderate accuracy, and M ẋ = g(t, x) of index 1: a step solves one system of n real equations,
    with matrices that are often reused for several steps. Orders 1 and 2 are A-stable, 3 to 5 A(α)-stable: if
    eigenvalues of the Jacobian lie near the imaginary axis, :class:`RadauIIA` is better.

    The order is chosen together with the step, so the step-size controller must be :class:`NDFController`, which
    ``jaxball.simulate`` chooses automatically. The first step, and the first one after a jump, has order 1.

    **Arguments:**

    - ``max_order``: the largest order, from 1 to 5.
    - ``kappa``: "ndf" for the coefficients of Shampine & Reichelt (1997), whose steps may be up to a quarter longer, or
      "bdf" for the backward differentiation formulas, which are stable in wider sectors at orders 3 and 4.
    - ``root_finder``: :class:`SimplifiedNewton`, which by default keeps its matrices longer than in other methods and
      ends at 0.03 of the tolerance, or :class:`FixedPoint` if the problem is not stiff. Its tolerances are those of the
      controller.

    Source: Shampine & Reichelt, *The MATLAB ODE Suite*, SIAM J. Sci. Comput. 18 (1997) 1–22; Hairer, Nørsett & Wanner,
    *Solving Ordinary Differential Equations I* (1993), section III.5.

    **Raises:** ``ValueError`` for another ``max_order`` or ``kappa``, and for a root finder with tolerances of its own;
    in a solve, ``TypeError`` for another step-size controller.

    **Example:**

    >>> import jax
    >>> jax.config.update("jax_enable_x64", True)
    >>> from jaxball import paper, simulate
    >>> from jaxball.simulation.solvers import NDF
    >>> run = simulate(paper.ball(), [0.0, 20.0], solver=NDF())
    >>> print(run.state.z[-1].round(5))
    [-3.99234 -3.86667]
    """

    interpolation_cls: ClassVar = BackwardPolynomial
    controller_cls: ClassVar = NDFController

    max_order: int = eqx.field(static=True)
    kappa: Kappa = eqx.field(static=True)
    root_finder: AbstractStageIteration  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(
        self, max_order: int = HIGHEST_BDF, kappa: Kappa = "ndf", root_finder: AbstractStageIteration | None = None
    ):
        if kappa not in KAPPAS:
            raise ValueError(f'Argument `kappa` must be "ndf" or "bdf", but it is {kappa!r}.')
        root_finder = ITERATION if root_finder is None else root_finder
        if any(getattr(root_finder, name) is not FROM_CONTROLLER for name in ("rtol", "atol", "norm")):
            raise ValueError(
                "Argument `root_finder` must have no tolerances and no norm of its own, because the order is chosen by "
                "those of the step-size controller, but it has."
            )
        self.max_order, self.kappa = check_order(max_order, HIGHEST_BDF), kappa
        self.root_finder = root_finder  # pyright: ignore[reportIncompatibleVariableOverride]

    def order(self, terms) -> int:
        return self.max_order

    def init(self, terms, t0: Any, t1: Any, y0, args) -> NDFState:
        x0, _ = ravel_pytree(y0)
        return NDFState(
            differences=jnp.zeros((self.max_order + 1, x0.size), x0.dtype),
            beyond=jnp.zeros((2, x0.size), x0.dtype),
            length=terms.contr(t0, t1),
            order=jnp.asarray(0),
            equal=jnp.asarray(0),
            stayed=jnp.asarray(False),
            memory=self.root_finder.start(EULER, x0),
            fault=None if mass_term(terms) is None else jnp.asarray(UNKNOWN),
        )

    def step(self, terms, t0: Any, t1: Any, y0, args, solver_state, made_jump: Any):
        self.require_controller()
        problem, fault = flat_problem(terms, t0, t1, y0, args), solver_state.fault
        first = (solver_state.order == 0) | made_jump
        if problem.mass is not None:
            x0, fault = start_of_step(problem, problem.mass, t0, self.root_finder, fault, made_jump)
            problem = problem._replace(x0=x0)
        state = _begin(problem, t0, solver_state._replace(fault=fault), first)
        # The formulas are those of equal steps: the past is sampled again at the length of this one.
        before, beyond = _at_distance(state, problem.control / state.length)
        stages = self._solve(problem, t1, before, state)
        change = stages.Z[0]
        after = advance(before, change, state.order)
        # The differences of the orders k, k + 1 and k + 2 at the end of the step.
        last = jnp.stack([entry(state.order, before) + change, change, change - beyond[0]])
        sizes = self.sizes(problem, after[0], self._errors(problem, state.order, last))
        size, result = outcome(stages, sizes[1:2], t0, t1, NO_FAULT if fault is None else fault)
        moved, following = self._after(problem, state, stages, (after, last), sizes)
        dense = {"y0": problem.unravel(problem.x0), "terms": jax.vmap(problem.unravel)(after[1:])}
        return problem.unravel(after[0]), self.plan_error(size[0], following), dense, moved, result

    def _solve(
        self, problem: FlatProblem, t1: Float[Array, ""], before: Float[Array, "rows n"], state: NDFState
    ) -> Stages:
        """Solves for the correction to the state that ``before`` predicts for the step's end, as the only stage."""
        alpha = entry(state.order, jnp.asarray(leading(self.kappa), problem.x0.dtype))
        psi = jnp.sum(jnp.asarray(HARMONIC_SUMS[: len(before)], before.dtype)[:, None] * before, axis=0) / alpha
        mass_psi = (psi if problem.mass is None else problem.mass.times(psi[None])[0])[None]
        # Divided by α, the formula is a step of Euler's implicit method, whose matrices the iteration knows to make and
        # keep.
        control = problem.control / alpha.astype(problem.control.dtype)
        scaled = problem._replace(slope=Slope(problem.field, control), control=control)
        equations = scaled.equations(EULER, t1, t1[None], jnp.sum(before, axis=0), known=-mass_psi)
        return self.root_finder.solve(equations, mass_psi, state.memory)

    def _errors(self, problem: FlatProblem, order: Int[Array, ""], last: Float[Array, "3 n"]) -> Float[Array, "3 n"]:
        """Computes the errors of the formulas of one order less, of the step's own, and of one more."""
        constants = jnp.asarray([0.0, *ndf_error_constants(self.kappa), 0.0], last.dtype)
        errors = jnp.stack([entry(order + i, constants) for i in range(3)])[:, None] * last
        return errors if problem.mass is None else jax.vmap(problem.mass.without_algebraic)(errors)

    def _after(
        self,
        problem: FlatProblem,
        state: NDFState,
        stages: Stages,
        ended: tuple[Float[Array, "rows n"], Float[Array, "3 n"]],
        sizes: Float[Array, "3"],
    ) -> tuple[NDFState, Plan]:
        """Returns the state after an attempt if it is accepted, and the plan for the next in any case.

        ``ended`` are the differences at its end, and the last three of them.
        """
        after, last = ended
        ratio = problem.control / state.length
        equal = jnp.where(jnp.abs(ratio - 1) <= EQUAL, state.equal + 1, 1)
        following = plan(jnp.where(stages.converged, sizes, jnp.inf), state.order, equal, self.max_order)
        # After a step much shorter than those before, rounding errors of its differences would grow with the next
        # steps. So the points stay on their old polynomial; the next step begins where this one ended.
        # Only once: the next step adds its end, however short it is.
        stays = ~state.stayed & (ratio < SHORT_NDF_STEP)
        after, last = jax.lax.cond(stays, lambda: _differences_before(state, ratio), lambda: (after, last))
        changes = following.order != state.order
        differences, beyond = jax.lax.cond(
            changes, lambda: _of_order(following.order, state.order, after, last), lambda: (after, last[1:])
        )
        new = NDFState(
            differences=differences,
            beyond=beyond,
            length=jnp.where(stays, state.length, problem.control),
            order=following.order,
            equal=jnp.where(stays | changes, 0, equal),
            stayed=stays,
            # Matrices only say how fast the iteration gets to the stages, not to which.
            memory=jax.lax.stop_gradient(stages.memory),
            fault=state.fault,
        )
        return new, following


def _begin(problem: FlatProblem, t0: Float[Array, ""], state: NDFState, first: Bool[Array, ""]) -> NDFState:
    """Returns the state with x₀ as its last point, which a projection may have moved; in a first step, only with its
    slope.
    """

    def slope():
        K = problem.slope(t0, problem.x0)
        return K if problem.mass is None else problem.mass.rates(K)

    rows = jnp.arange(len(state.differences))[:, None]
    slopes = jax.lax.cond(first, slope, lambda: jnp.zeros_like(problem.x0))
    fresh = jnp.where(rows == 0, problem.x0[None], jnp.where(rows == 1, slopes[None], 0.0))
    # Every difference has the last point once.
    moved = state.differences + jnp.where(rows <= state.order, (problem.x0 - state.differences[0])[None], 0.0)
    return state._replace(
        differences=jnp.where(first, fresh, moved),
        beyond=jnp.where(first, 0.0, state.beyond),
        length=jnp.where(first, problem.control, state.length),
        order=jnp.where(first, 1, state.order),
        equal=jnp.where(first, 0, state.equal),
        stayed=state.stayed & ~first,
        memory=state.memory.forget(first),
    )


def _at_distance(state: NDFState, ratio: Float[Array, ""]) -> tuple[Float[Array, "rows n"], Float[Array, "2 n"]]:
    """Computes the differences for points at the distance ``ratio`` H, and the differences beyond them, which are
    scaled.
    """
    differences, beyond, order = state.differences, state.beyond, state.order

    def equal():
        orders = (order + jnp.arange(1, 3)).astype(ratio.dtype)
        return stretch(differences, ratio - 1), _scale(beyond, 1 + orders * (ratio - 1))

    def another():
        powers = products(jnp.broadcast_to(ratio, len(differences) + 1))
        scales = jnp.stack([entry(order + i, powers) for i in (1, 2)])
        inside = jnp.where(up_to(order, len(differences)), resample(differences, ratio), 0.0)
        return inside, _scale(beyond, scales)

    return jax.lax.cond(jnp.abs(ratio - 1) < ROUNDING, equal, another)


def _scale(rows: Float[Array, "rows n"], scales: Float[Array, " rows"]) -> Float[Array, "rows n"]:
    return scales.astype(rows.dtype)[:, None] * rows


def _differences_before(state: NDFState, ratio: Float[Array, ""]) -> tuple[Float[Array, "rows n"], Float[Array, "3 n"]]:
    """Moves the differences, and the last three, along their polynomial to the points of the step before."""
    moved = resample(state.differences, jnp.ones_like(ratio), ratio)
    inside = jnp.where(up_to(state.order, len(moved)), moved, 0.0)
    here = entry(state.order, inside)
    return inside, jnp.stack([here, jnp.zeros_like(here), jnp.zeros_like(here)])


def _of_order(
    order: Int[Array, ""], before: Int[Array, ""], after: Float[Array, "rows n"], last: Float[Array, "3 n"]
) -> tuple[Float[Array, "rows n"], Float[Array, "2 n"]]:
    """Returns the state for a step whose order is one more or one less than ``before``."""
    rises, rows = order > before, jnp.arange(len(after))[:, None]
    differences = jnp.where(rows == before + 1, last[1][None], after)
    beyond = jnp.where(rises, jnp.stack([last[2], jnp.zeros_like(last[2])]), last[:2])
    return jnp.where(rows <= order, differences, 0.0), beyond
