"""A nonlinear program, whatever its unknowns stand for."""

import abc
from typing import Any

import diffrax
import numpy as np
from jaxtyping import Array, Bool, Float

from ..problem.problem import Evaluation, Places
from .settings import Settings


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
