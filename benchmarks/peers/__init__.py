"""The paper's ball in other integrators: the state is (θ, θ̇, q, Ω, z), the paper's fifteen numbers.

Its equations are those of ``python -m benchmarks``. Their derivatives are taken with respect to ten parameters: the
masses m_0 … m_3, the inertia, and the shell's centre of mass.
"""

from typing import Any

import numpy as np
from comparison.problems.rolling import PAPER, BallNumbers

PLACE = -2  # z1 in the state


def parameters() -> np.ndarray:
    """The ten parameters."""
    return np.concatenate([PAPER.m, PAPER.d, PAPER.zeta0])


def with_parameters(values: Any) -> BallNumbers:
    """The ball with other ones, numbers or expressions."""
    n = len(PAPER.m)
    return PAPER._replace(m=values[:n], d=values[n : n + 3], zeta0=values[n + 3 :])
