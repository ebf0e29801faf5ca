"""A nonlinear program, whatever its unknowns stand for, the settings of its search, and its augmented Lagrangian."""

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
from jaxtyping import Array, Bool, Float, Int

from ..problem.problem import ConstraintLayout, Evaluation
from ..problem.variables import DesignError

METHODS = ("bfgs", "gauss-newton")
# Equalities must hold this many times more tightly, because a residual at a joint grows along the run.
STRICTER = 1e3


@dataclasses.dataclass(frozen=True)
class Settings:
    """The settings with which a problem is solved.

    - ``starts``: how many starts, the given design and others around it, are optimised side by side at first.
    - ``spread``: the standard deviation of the others about it, in scales; between two bounds they are uniformly
      distributed.
    - ``steps``, ``learning_rate``: the steps of Adam that each start takes, in scales.
    - ``polished``: how many starts, the most promising after Adam, are polished.
    - ``rounds``, ``evaluations``: the largest numbers of multiplier updates in the polish within an augmented
      Lagrangian, and of evaluations between two of them.
    - ``penalty``: the first penalty; it is quadrupled where a round does not reduce the violation to a quarter.
    - ``tolerance``: the largest violation of a feasible design, in radii, weights and the like; a thousandth of it for
      joints of pieces.
    - ``stationary``: the largest entry of the gradient of the Lagrangian at which a polish ends.
    - ``seed``: of the random starts.
    - ``method``: of the polish, ``bfgs`` or ``gauss-newton``.
    - ``intervals``: the number of pieces in which a run is simulated, whose joints are unknowns of the search (multiple
      shooting).

    **Raises:** :class:`DesignError` for a method that is none of these.
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


class AbstractProgram(abc.ABC):
    """Minimise Σ weight · term over the unknowns y, unbounded and of order one, where all constraints hold.

    Equal programs share compiled functions.
    """

    @property
    @abc.abstractmethod
    def weights(self) -> Float[np.ndarray, " terms"]:
        """The weights of the terms."""

    @property
    @abc.abstractmethod
    def layout(self) -> ConstraintLayout:
        """Where the constraints are evaluated."""

    @property
    @abc.abstractmethod
    def equal(self) -> Bool[np.ndarray, " places"]:
        """Which constraints are equalities c = 0; the others are c ≤ 0."""

    @property
    @abc.abstractmethod
    def names(self) -> tuple[str, ...]:
        """The names of the unknowns."""

    @abc.abstractmethod
    def starts(self, settings: Settings) -> Float[np.ndarray, "starts unknowns"]:
        """The starting points; the first is the given design."""

    @abc.abstractmethod
    def numbers(self, y: Float[Array, " unknowns"]) -> Float[Array, " numbers"]:
        """What the unknowns stand for: numbers within their bounds."""

    @abc.abstractmethod
    def simulate(self, numbers: Float[Array, " numbers"], adjoint: diffrax.AbstractAdjoint | None = None) -> Any:
        """The simulation that terms and constraints depend on; ``adjoint`` is for modes other than reverse."""

    @abc.abstractmethod
    def assess(self, runs: Any) -> Evaluation:
        """All terms and constraints of a simulation."""

    def evaluate(self, y: Float[Array, " unknowns"], adjoint: diffrax.AbstractAdjoint | None = None) -> Evaluation:
        """All terms and constraints; traceable, differentiable and vectorisable by JAX."""
        return self.assess(self.simulate(self.numbers(y), adjoint))


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


def augmented_lagrangian(program: AbstractProgram, at: Evaluation, multipliers: Multipliers) -> Float[Array, ""]:
    """f + Σ w (p² − λ²) / 2ρ, where p is the next λ and w the weight of a point in its constraint.

    Nocedal & Wright, Numerical Optimization, section 17.3.
    """
    objective = jnp.sum(jnp.asarray(program.weights, dtype=at.terms.dtype) * at.terms)
    following = next_multipliers(program, at, multipliers)
    shares = jnp.asarray(program.layout.shares, dtype=at.terms.dtype)
    return objective + jnp.sum(shares * (following**2 - multipliers.value**2)) / (2 * multipliers.penalty)


def next_multipliers(program: AbstractProgram, at: Evaluation, multipliers: Multipliers) -> Float[Array, " places"]:
    """λ + ρ c of an equality c = 0, and max(0, λ + ρ c) of an inequality c ≤ 0; c = violation + margin."""
    following = multipliers.value + multipliers.penalty * (at.violations + multipliers.margin)
    return jnp.where(jnp.asarray(program.equal), following, jnp.maximum(0.0, following))


@functools.lru_cache(maxsize=8)
def by_reverse_mode(program: AbstractProgram) -> Callable[..., Lagrangians]:
    """The augmented Lagrangian and its gradient, compiled once for a program."""

    def lagrangian(y: Float[Array, " n"], multipliers: Multipliers) -> tuple[Float[Array, ""], Evaluation]:
        at = program.evaluate(y)
        return augmented_lagrangian(program, at, multipliers), at

    def one(y: Float[Array, " n"], multipliers: Multipliers) -> Lagrangians:
        (value, at), gradient = jax.value_and_grad(lagrangian, has_aux=True)(y, multipliers)
        return _lagrangians(program, value, gradient, at, multipliers)

    return jax.jit(jax.vmap(one))


@functools.lru_cache(maxsize=8)
def by_gauss_newton(program: AbstractProgram) -> Callable[..., Lagrangians]:
    """The same by forward mode, with the Gauss–Newton Hessian: the run is assumed to be linear in a design's numbers.

    Terms and constraints as functions of a run enter with all second derivatives, and so do bounds. For a sum of
    squares this is JᵀJ, but no term needs to be written as one.
    """

    def one(y: Float[Array, " n"], multipliers: Multipliers) -> Lagrangians:
        x = program.numbers(y)

        def simulated(x: Float[Array, " numbers"]) -> tuple[Any, Any]:
            return eqx.partition(program.simulate(x, diffrax.ForwardMode()), eqx.is_inexact_array)

        def along(direction: Float[Array, " numbers"]) -> tuple[Any, Any, Any]:
            return jax.jvp(simulated, (x,), (direction,), has_aux=True)

        runs, slopes, rest = jax.vmap(along, out_axes=(None, 0, None))(jnp.eye(x.size, dtype=x.dtype))

        def lagrangian(y: Float[Array, " n"]) -> tuple[Float[Array, ""], Evaluation]:
            change = program.numbers(y) - x
            moved = jax.tree.map(lambda run, slope: run + jnp.tensordot(change, slope, 1), runs, slopes)
            at = program.assess(eqx.combine(moved, rest))
            return augmented_lagrangian(program, at, multipliers), at

        def gradient(y: Float[Array, " n"]) -> tuple[Any, Any]:
            (value, at), slope = jax.value_and_grad(lagrangian, has_aux=True)(y)
            return slope, (value, slope, at)

        hessian, (value, slope, at) = jax.jacfwd(gradient, has_aux=True)(y)
        return _lagrangians(program, value, slope, at, multipliers)._replace(hessian=hessian)

    return jax.jit(jax.vmap(one))


def _lagrangians(program: AbstractProgram, value, gradient, at: Evaluation, multipliers: Multipliers) -> Lagrangians:
    """For one point; an inequality is violated by c, and an equality by a thousand times |c|."""
    c = at.violations + multipliers.margin
    violations = jnp.where(jnp.asarray(program.equal), STRICTER * jnp.abs(c), c)
    return Lagrangians(value, gradient, at, next_multipliers(program, at, multipliers), violations)
