"""What each objective of a solution is."""

import numpy as np

from .refine import Solution
from .rolling import rolling


def means(solution: Solution) -> dict[str, float]:
    """The mean of each objective's integrand over the run, by the weights of Gauss, without its weight.

    **Arguments:**

    - ``solution``: a :class:`Solution` of a :class:`Rolling`.
    """
    rolling(solution.problem)
    collocation, path = solution.collocation, solution.path
    states, controls = (part.reshape(-1, part.shape[-1]) for part in (path.nodes, path.controls))
    terms = collocation.along("terms", np.ravel(collocation.times), states, controls, solution.parameter)
    weights = np.ravel(collocation.steps[:, None] * collocation.tableau.b) / np.sum(collocation.steps)
    return {name: float(weights @ values) for name, values in terms.items()}
