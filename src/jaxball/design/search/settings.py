"""Settings of the search for a design."""

import dataclasses

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
