"""How hard to look for a design."""

import dataclasses

from ..errors import DesignError

METHODS = ("bfgs", "gauss-newton")


@dataclasses.dataclass(frozen=True)
class Settings:
    """How a problem is solved.

    - ``starts``: how many starts, the given design and others about it, are improved side by side at first.
    - ``spread``: how far the others are from it, in scales; between two bounds they are anywhere.
    - ``steps``, ``learning_rate``: the steps of Adam that each start takes, in scales.
    - ``polished``: how many starts, the most promising after Adam, are polished.
    - ``rounds``, ``evaluations``: of the polish within an augmented Lagrangian, at most so many updates of the
      multipliers, and evaluations between two.
    - ``penalty``: the first penalty; it grows fourfold where a round does not bring the violation down to a quarter.
    - ``tolerance``: the largest violation of a design that counts as feasible, in radii, weights and the like; joints
      of pieces are held a thousand times better.
    - ``stationary``: the largest entry of the gradient of the Lagrangian with which a polish ends.
    - ``seed``: of the random starts.
    - ``method``: of the polish, ``bfgs`` or ``gauss-newton``.
    - ``intervals``: in how many pieces a run is simulated, whose joints are unknowns of the search (multiple shooting).

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
