"""The nonlinear program that a search minimises, its settings, its augmented Lagrangian, and one made from a problem.

A run may be cut in pieces that are simulated side by side (multiple shooting). The states at which the pieces start are
additional unknowns, and equality constraints require that each piece ends where the next one starts (Bock & Plitt, A
multiple shooting algorithm for direct solution of optimal control problems, IFAC Proc. 17 (1984) 1603). An error at the
start of a run then grows only over a piece, not over the whole run. Single shooting is the case of one piece, without
such unknowns.
"""

import abc
import dataclasses
import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from .... import programs
from ....files.scenario.body import kind_of
from ....files.scenario.initial import INITIAL
from ....interface.arguments import whole_number
from ....numerics.arrays import arrays_of, positive_number
from ....physics.body import System
from ....physics.state import BallState, DiskState
from ....programs.batches import of_rows
from ..problem.problem import ConstraintLayout, Evaluation, Known, Problem, TracedProblem, merge, reveal
from ..problem.run import Run, Solve, run_of
from ..problem.space import Candidate, DesignError, DesignSpace, default_scale

METHODS = ("bfgs", "gauss-newton")
# The settings that count something, with the least of each; the others are positive numbers, or a method.
COUNTS = dict.fromkeys(("starts", "polished", "rounds", "evaluations", "intervals"), 1) | {"steps": 0, "seed": 0}
MOST = 10**6
# Equalities must hold this many times more tightly, because a residual at a joint grows along the run.
STRICTER = 1e3


@dataclasses.dataclass(frozen=True)
class Settings:
    """The settings with which a problem is solved.

    - ``starts``: the number of starts, the given design and others around it, that are optimised side by side at first.
    - ``spread``: the standard deviation of the other starts about the given one, in scales. Between two bounds they are
      uniformly distributed.
    - ``steps``: the number of steps of Adam that each start takes.
    - ``learning_rate``: the size of these steps, in scales.
    - ``polished``: the number of starts, the most promising after Adam, that are polished.
    - ``rounds``: the largest number of rounds of polishing, after each of which the multipliers of the augmented
      Lagrangian are updated.
    - ``evaluations``: the largest number of evaluations in a round.
    - ``penalty``: the first penalty of the augmented Lagrangian. It is quadrupled where a round does not reduce the
      violation to a quarter.
    - ``tolerance``: the largest violation of a feasible design, in radii, weights and the like. A thousandth of it for
      joints of pieces.
    - ``stationary``: the largest entry of the gradient of the Lagrangian at which a polish ends.
    - ``seed``: the seed of the random starts.
    - ``method``: the method of polishing, ``bfgs`` or ``gauss-newton``.
    - ``intervals``: the number of pieces in which a run is simulated, whose joints are unknowns of the search (multiple
      shooting).

    **Raises:** :class:`DesignError` for a method that is none of these, ``TypeError`` and ``ValueError`` for counts
    that are not whole, and for numbers that are not positive.
    """

    starts: int = 8
    spread: float = 0.3
    steps: int = 150
    learning_rate: float = 0.02
    polished: int = 8
    rounds: int = 12
    evaluations: int = 80
    penalty: float = 10.0
    tolerance: float = 1e-4
    stationary: float = 1e-4
    seed: int = 0
    method: str = "bfgs"
    intervals: int = 1

    def __post_init__(self):
        if self.method not in METHODS:
            raise DesignError(f"Argument `method` must be one of {', '.join(METHODS)}, but it is {self.method!r}.")
        for name, least in COUNTS.items():
            whole_number(name, getattr(self, name), least, MOST)
        for name in vars(self).keys() - COUNTS.keys() - {"method"}:
            positive_number(name, getattr(self, name))

    @property
    def evaluations_at_most(self) -> int:
        """How often designs are evaluated, if no constraint has to be tightened."""
        polished = min(self.starts, self.polished)
        return self.starts * self.steps + polished * self.rounds * self.evaluations


class AbstractTerms(abc.ABC):
    """Terms with weights, and constraints, as functions of the unknowns y."""

    @property
    @abc.abstractmethod
    def weights(self) -> Float[Array | np.ndarray, " terms"]:
        """The weights of the terms."""

    @property
    @abc.abstractmethod
    def layout(self) -> ConstraintLayout:
        """Where the constraints are evaluated."""

    @property
    @abc.abstractmethod
    def equal(self) -> Bool[np.ndarray, " places"]:
        """Which constraints are equalities c = 0; the others are c ≤ 0."""

    @abc.abstractmethod
    def numbers(self, y: Float[Array, " unknowns"]) -> Float[Array, " numbers"]:
        """Computes the numbers, within their bounds, that the unknowns stand for."""

    @abc.abstractmethod
    def simulate(self, numbers: Float[Array, " numbers"], adjoint: diffrax.AbstractAdjoint | None = None) -> Any:
        """Simulates the runs that terms and constraints depend on; ``adjoint`` is for modes other than reverse."""

    @abc.abstractmethod
    def assess(self, runs: Any) -> Evaluation:
        """Evaluates all terms and constraints of a simulation."""

    def evaluate(self, y: Float[Array, " unknowns"], adjoint: diffrax.AbstractAdjoint | None = None) -> Evaluation:
        """Evaluates all terms and constraints; traceable, differentiable and vectorisable by JAX."""
        return self.assess(self.simulate(self.numbers(y), adjoint))


class AbstractProgram(abc.ABC):
    """Minimise Σ weight · term over the unknowns y, unbounded and of order one, where all constraints hold.

    A program whose ``pytree`` is not given has the terms itself.
    """

    @property
    @abc.abstractmethod
    def names(self) -> tuple[str, ...]:
        """The names of the unknowns."""

    @abc.abstractmethod
    def starts(self, settings: Settings) -> Float[np.ndarray, "starts unknowns"]:
        """Returns the starting points; the first is the given design."""

    @functools.cached_property
    def pytree(self) -> Any:
        """What compiled functions take for it; by default itself, whose numbers they know.

        A PyTree with the same terms is traced, so that programs that differ in numbers alone share these functions.
        """
        return Known(self)

    @property
    def terms(self) -> AbstractTerms:
        """The terms and the constraints."""
        return reveal(self.pytree)


class Multipliers(NamedTuple):
    """λ for each point, ≥ 0 for an inequality, the penalty ρ, and the margin of each."""

    value: Float[Array | np.ndarray, "*batch places"]
    penalty: Float[Array | np.ndarray, "*batch"]
    margin: Float[Array | np.ndarray, "*batch places"]


class Lagrangians(NamedTuple):
    """The augmented Lagrangian at each of many points, with its derivatives.

    - ``at``: the terms and constraints from which it is made.
    - ``multipliers``: λ of the next round.
    - ``violations``: the violation at each point, margins included.
    - ``hessian``: that of Gauss and Newton, if requested.
    """

    value: Float[Array | np.ndarray, "*points"]
    gradient: Float[Array | np.ndarray, "*points n"]
    at: Evaluation
    multipliers: Float[Array | np.ndarray, "*points places"]
    violations: Float[Array | np.ndarray, "*points places"]
    hessian: Float[Array | np.ndarray, "*points n n"] | None = None

    @property
    def violation(self) -> Float[np.ndarray, " points"]:
        """The largest violation of each point; −∞ where there are no constraints."""
        return np.max(self.violations, axis=1, initial=-np.inf)

    @property
    def worst(self) -> Int[np.ndarray, " points"]:
        """The index of the largest violation; −1 where there are no constraints."""
        points, places = self.violations.shape
        return np.argmax(self.violations, axis=1) if places else np.full(points, -1)


def augmented_lagrangian(terms: AbstractTerms, at: Evaluation, multipliers: Multipliers) -> Float[Array, ""]:
    """Computes f + Σ w (p² − λ²) / 2ρ, where p is the next λ and w the weight of a point in its constraint.

    Nocedal & Wright, Numerical Optimization, section 17.3.
    """
    # Weights may be arrays of NumPy in float64, where the run is in float32.
    objective = jnp.sum(jnp.asarray(terms.weights, dtype=at.terms.dtype) * at.terms)
    following = next_multipliers(terms, at, multipliers)
    # A constraint at many points should weigh as much as one at a single point, whatever the number of save times.
    shares = jnp.asarray(terms.layout.shares, dtype=at.terms.dtype)
    return objective + jnp.sum(shares * (following**2 - multipliers.value**2)) / (2 * multipliers.penalty)


def next_multipliers(terms: AbstractTerms, at: Evaluation, multipliers: Multipliers) -> Float[Array, " places"]:
    """Computes λ + ρ c for an equality c = 0, and max(0, λ + ρ c) for an inequality c ≤ 0; c = violation + margin."""
    following = multipliers.value + multipliers.penalty * (at.violations + multipliers.margin)
    # An inequality that is inactive has multiplier 0, and thus no part in the gradient.
    return jnp.where(jnp.asarray(terms.equal), following, jnp.maximum(0.0, following))


def by_reverse_mode(program: AbstractProgram) -> Callable[..., Lagrangians]:
    """Returns a function that computes the augmented Lagrangian and its gradient at many points."""
    return functools.partial(_of_points, _by_reverse_mode, program.pytree)


def by_gauss_newton(program: AbstractProgram) -> Callable[..., Lagrangians]:
    """Returns a function that computes the augmented Lagrangian, its gradient and the Gauss–Newton Hessian at many
    points by forward mode: the run is assumed to be linear in a design's numbers.

    Terms and constraints as functions of a run enter with all second derivatives, and so do bounds. For a sum of
    squares this is JᵀJ, but no term needs to be written as one.
    """
    return functools.partial(_of_points, _by_gauss_newton, program.pytree)


@programs.filter_jit
def _of_points(of_one: Any, terms: AbstractTerms | Known, y: Float[Array, "points n"], multipliers: Multipliers):
    return of_rows(functools.partial(of_one, reveal(terms)), y, multipliers)


def _by_reverse_mode(terms: AbstractTerms, y: Float[Array, " n"], multipliers: Multipliers) -> Lagrangians:
    def lagrangian(y: Float[Array, " n"]) -> tuple[Float[Array, ""], Evaluation]:
        evaluation = terms.evaluate(y)
        return augmented_lagrangian(terms, evaluation, multipliers), evaluation

    (value, evaluation), gradient = jax.value_and_grad(lagrangian, has_aux=True)(y)
    return _lagrangians(terms, value, gradient, evaluation, multipliers)


def _by_gauss_newton(terms: AbstractTerms, y: Float[Array, " n"], multipliers: Multipliers) -> Lagrangians:
    # Only the run is linearised. Bounds and constraints come after it and keep their second derivatives, which
    # Newton's method needs near them.
    x = terms.numbers(y)

    def simulate_arrays(x: Float[Array, " numbers"]) -> tuple[Any, Any]:
        # `jvp` takes only arrays of floating point; the status and the like go around it.
        return eqx.partition(terms.simulate(x, diffrax.ForwardMode()), eqx.is_inexact_array)

    def along(direction: Float[Array, " numbers"]) -> tuple[Any, Any, Any]:
        return jax.jvp(simulate_arrays, (x,), (direction,), has_aux=True)

    runs, slopes, rest = of_rows(along, jnp.eye(x.size, dtype=x.dtype))
    # All rows have the same run; they differ in their slopes.
    runs, rest = jax.tree.map(lambda leaf: leaf[0], (runs, rest))

    def lagrangian(y: Float[Array, " n"]) -> tuple[Float[Array, ""], Evaluation]:
        change = terms.numbers(y) - x
        # `change` is 0 here; it carries the derivatives of the numbers by y.
        moved = jax.tree.map(lambda run, slope: run + jnp.tensordot(change, slope, 1), runs, slopes)
        evaluation = terms.assess(eqx.combine(moved, rest))
        return augmented_lagrangian(terms, evaluation, multipliers), evaluation

    def gradient(y: Float[Array, " n"]) -> tuple[Any, Any]:
        (value, evaluation), slope = jax.value_and_grad(lagrangian, has_aux=True)(y)
        return slope, (value, slope, evaluation)

    columns, rows = of_rows(lambda v: jax.jvp(gradient, (y,), (v,), has_aux=True)[1:], jnp.eye(y.size, dtype=y.dtype))
    value, slope, evaluation = jax.tree.map(lambda leaf: leaf[0], rows)
    return _lagrangians(terms, value, slope, evaluation, multipliers)._replace(hessian=columns.T)


def _lagrangians(
    terms: AbstractTerms, value, gradient, evaluation: Evaluation, multipliers: Multipliers
) -> Lagrangians:
    """Returns the Lagrangian and its parts for one point; an inequality is violated by c, and an equality by a thousand
    times |c|.
    """
    c = evaluation.violations + multipliers.margin
    # |c| has no sign, so that a gap counts in both directions.
    violations = jnp.where(jnp.asarray(terms.equal), STRICTER * jnp.abs(c), c)
    return Lagrangians(value, gradient, evaluation, next_multipliers(terms, evaluation, multipliers), violations)


CONTINUITY = "continuity"


class Components(eqx.Module):
    """States of one kind as vectors of order one: each component, a versor's four too, over its scale."""

    scale: Float[Array, " components"]

    @classmethod
    def of(cls, system: System, state: BallState | DiskState) -> "Components":
        """Returns the components of states such as this one."""
        kinds = {name: key.kind for name, key in INITIAL[kind_of(system)].items()}
        scales = []
        for name, values in arrays_of(state).items():
            dimension = getattr(kinds.get(name), "dimension", None)
            # A component without a dimension, as those of versors, has scale 1.
            scales.append(np.full(np.size(values), default_scale(dimension, 1.0, system)))
        return cls(jnp.asarray(np.concatenate(scales)))

    @property
    def size(self) -> int:
        """How many there are."""
        return self.scale.size

    def pack(self, state: Any) -> Float[Array, " components"]:
        """Returns the components of a state."""
        x = ravel_pytree(state)[0]
        return x / self.scale.astype(x.dtype)

    def unpack(self, components: Float[Array, " components"], like: Any) -> Any:
        """Returns the state of the components, of the kind of another, its versor normalised."""
        # An optimiser changes the four components of a versor freely; only its direction has a meaning.
        return ravel_pytree(like)[1](components * self.scale.astype(components.dtype)).projected()


def starting_points(space: DesignSpace, settings: Settings) -> Float[np.ndarray, "starts n"]:
    """Draws starting points: the given design first, then others, normally distributed about it, or uniformly between
    two bounds.
    """
    random, bounds = np.random.default_rng(settings.seed), space.bounds
    shape = (settings.starts - 1, space.size)
    # Bounds are functions of y, so a uniform distribution must be drawn in the numbers and carried over.
    both = np.isfinite(bounds.lower) & np.isfinite(bounds.upper)
    low, high = np.where(both, bounds.lower, 0.0), np.where(both, bounds.upper, 1.0)
    anywhere = low + (high - low) * random.uniform(size=shape)
    about = space.start + settings.spread * random.normal(size=shape)
    others = [np.where(both, bounds.variables(x), y) for x, y in zip(anywhere, about, strict=True)]
    return np.stack([space.start, *others])


class Pieces(eqx.Module, AbstractTerms):
    """The terms of a :class:`Shooting`: a PyTree of the numbers of its problem and the scales of its components."""

    problem: TracedProblem
    components: Components
    intervals: int = eqx.field(static=True)

    @property
    def weights(self):
        return self.problem.weights

    @property
    def layout(self):
        layout = self.problem.layout
        return ConstraintLayout({**layout.sizes, CONTINUITY: self.joints * self.components.size}, layout.balls)

    @property
    def equal(self):
        return self.layout.spread({CONTINUITY: 1.0}) > 0

    @property
    def joints(self) -> int:
        """How many joints there are between the pieces."""
        return self.intervals - 1

    @property
    def rows(self) -> Int[np.ndarray, "intervals samples"]:
        """The samples of each piece; its last is the first of the next."""
        each = (self.problem.space.times.size - 1) // self.intervals
        return np.arange(self.intervals)[:, None] * each + np.arange(each + 1)[None]

    def numbers(self, y):
        n = self.problem.space.size
        return jnp.concatenate([self.problem.space.numbers(y[:n]), y[n:]])

    def simulate(self, numbers, adjoint=None):
        problem, solve, n = self.problem, self.problem.solve(adjoint), self.problem.space.size
        states = jnp.reshape(numbers[n:], (problem.balls, self.joints, self.components.size))
        candidate = problem.space.candidate_of(numbers[:n])
        return problem.of_each(candidate, lambda ball, states: self.in_pieces(ball, states, solve), states)

    def assess(self, runs):
        def of_ball(run: Run, defects: Float[Array, "joints components"]) -> Evaluation:
            evaluation = self.problem.evaluate_run(run)
            return evaluation._replace(violations=jnp.concatenate([evaluation.violations, jnp.ravel(defects)]))

        return merge(of_rows(of_ball, *runs))

    def in_pieces(
        self, candidate: Candidate, states: Float[Array, "joints components"], solve: Solve
    ) -> tuple[Run, Float[Array, "joints components"]]:
        """Simulates the run in pieces from ``states``, and returns the gap between the end of each and the start of the
        next too.
        """

        def piece(times: Float[Array, " t"], state: BallState | DiskState) -> tuple[Any, Int[Array, ""]]:
            run = run_of(candidate._replace(times=times, state=state), solve)
            return run.state, run.status

        if self.intervals == 1:
            return run_of(candidate, solve), states
        later = jax.vmap(lambda components: self.components.unpack(components, candidate.state))(states)
        # The first piece starts at the initial state, which the design determines; the others at unknowns.
        begin = jax.tree.map(lambda x, others: jnp.concatenate([x[None], others]), candidate.state, later)
        pieces, status = of_rows(piece, candidate.times[self.rows], begin)
        # The last sample of a piece is the first of the next one, which stands for both; their gap is a constraint.
        whole = jax.tree.map(lambda x: jnp.concatenate([*x[:, :-1], x[-1, -1:]]), pieces)
        ends = jax.tree.map(lambda x: x[:-1, -1], pieces)
        pack = jax.vmap(self.components.pack)
        # 0 is success, so that the maximum is a failure if any piece failed.
        return Run(candidate.system, candidate.times, whole, jnp.max(status)), pack(ends) - pack(later)

    def states_along(self, y: Float[Array, " n"]) -> Float[Array, "balls t components"]:
        """Computes the components of the states of a design's run, simulated in one piece."""
        problem, pack, solve = self.problem, jax.vmap(self.components.pack), self.problem.solve()
        return problem.of_each(problem.space.candidate(y), lambda ball: pack(run_of(ball, solve).state))


@dataclasses.dataclass(frozen=True)
class Shooting(AbstractProgram):
    """A ``problem`` whose runs are simulated in ``intervals`` pieces with equal numbers of samples.

    The unknowns y are those of the design space and, ball by ball, the components of the state at each joint, where a
    piece after the first starts. Continuity is the last constraint.

    **Raises:** :class:`DesignError` where the steps between save times cannot be divided equally.
    """

    problem: Problem
    intervals: int = 1

    def __post_init__(self):
        steps = self.problem.space.scenario.times.size - 1
        if self.intervals < 1 or steps % self.intervals:
            raise DesignError(
                f"Key `search.intervals` must divide the number of steps between save times, {steps}, but it is "
                f"{self.intervals}; choose another number, or another number of save times."
            )
        if self.intervals > 1 and self.problem.space.scenario.may_slip:
            raise DesignError(
                f"Key `search.intervals` must be 1 for a body with a law of contact, but it is {self.intervals}: where "
                "a run is cut, its mode would have to be an unknown as well."
            )

    @functools.cached_property
    def pytree(self) -> Pieces:
        """Its terms, which compiled functions take."""
        space = self.problem.space
        return Pieces(self.problem.pytree, Components.of(space.system, space.placed), self.intervals)

    @property
    def names(self):
        states = np.repeat(np.arange(1, self.intervals), self.pytree.components.size)
        return (*self.problem.space.names, *(f"the state at joint {k}" for k in np.tile(states, self.problem.balls)))

    def starts(self, settings):
        return self.append_joints(starting_points(self.problem.space, settings))

    def append_joints(self, y: Float[np.ndarray, "starts n"]) -> Float[np.ndarray, "starts unknowns"]:
        """Appends to the unknowns of designs the states of their runs where the pieces join.

        Where a run failed before a joint, it is the last state that it reached.
        """
        if self.intervals == 1:
            return y
        saved = np.asarray(_states_along(self.pytree, jnp.asarray(y)))
        # An optimiser cannot start from NaN; where a run stopped early, any state near it will do.
        finite = np.all(np.isfinite(saved), axis=-1)
        last = np.max(np.where(finite, np.arange(saved.shape[-2]), 0), axis=-1)
        rows = np.minimum(self.pytree.rows[1:, 0], last[..., None])
        return np.concatenate([y, np.reshape(np.take_along_axis(saved, rows[..., None], axis=2), (len(y), -1))], axis=1)

    def design(self, y: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, " n"]:
        """Returns the unknowns of the design space among all unknowns."""
        return y[: self.problem.space.size]


@programs.filter_jit
def _states_along(pieces: Pieces, y: Float[Array, "starts n"]) -> Float[Array, "starts balls t components"]:
    return of_rows(pieces.states_along, y)
