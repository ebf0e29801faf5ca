"""What each objective of a solution is."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

from .chunks import in_chunks
from .refine import Solution
from .rolling import Rolling, rolling


def means(solution: Solution) -> dict[str, float]:
    """The mean of each objective's integrand over the run, by the weights of Gauss, without its weight.

    **Arguments:**

    - ``solution``: a :class:`Solution` of a :class:`Rolling`.
    """
    problem, collocation = rolling(solution.problem), solution.collocation
    path = solution.path
    states, controls = (part.reshape(-1, part.shape[-1]) for part in (path.nodes, path.controls))
    terms = in_chunks(functools.partial(_terms, problem), np.ravel(collocation.times), states, controls)
    weights = np.ravel(collocation.steps[:, None] * collocation.tableau.b) / np.sum(collocation.steps)
    return {name: float(weights @ values) for name, values in terms.items()}


@jax.jit
def _terms(problem: Rolling, times, states, controls) -> dict[str, jnp.ndarray]:
    return jax.vmap(problem.terms)(times, states, controls)
