"""A nonlinear program, whatever its unknowns stand for, and the settings of its search."""

import abc
import dataclasses
from typing import Any

import diffrax
import numpy as np
from jaxtyping import Array, Bool, Float

from ..problem.problem import Evaluation, Places
from ..problem.variables import DesignError

METHODS = ("bfgs", "gauss-newton")


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
    def places(self) -> Places:
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
