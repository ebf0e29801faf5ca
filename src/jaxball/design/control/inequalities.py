"""The inequalities of a problem along a path, between the nodes as well."""

import numpy as np
from jaxtyping import Float

from .collocation import Collocation
from .path import Path

# Of each interval, so many places are looked at, both its ends among them.
PLACES = 11


def margins(collocation: Collocation, path: Path, times: Float[np.ndarray, " k"], parameter: float):
    """What must not be negative, at given times of a path; shape (k, i)."""
    if not collocation.inequalities:
        return np.zeros((len(times), 0))
    return collocation.along("inequalities", times, path.states(times), path.inputs(times), parameter)


def violations(collocation: Collocation, path: Path, parameter: float) -> Float[np.ndarray, " N"]:
    """For each interval, by how much an inequality is violated at most; 0 where all hold.

    **Arguments:**

    - ``collocation``, ``path``, ``parameter``: the equations, states and controls, and λ.
    """
    times = path.within(PLACES)
    found = margins(collocation, path, np.ravel(times), parameter)
    return np.max(-found.reshape(*times.shape, collocation.inequalities), axis=(1, 2), initial=0.0)
