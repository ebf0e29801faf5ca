"""Derivatives by central differences of runs, and of models, that are more exact than these."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Array, Float

# By the number of points, which is the order of the error: of the differences over one, two and three steps.
WEIGHTS = {2: (1 / 2,), 4: (2 / 3, -1 / 12), 6: (3 / 4, -3 / 20, 1 / 60)}


def slope(values: Callable, at: float | Array, step: float | Array, points: int = 4) -> Array:
    """The derivative of what ``values`` returns by one number, over ``points`` multiples of ``step``.

    In an array the number is that entry of ``at`` at which ``step`` is not 0.
    """
    weights = enumerate(WEIGHTS[points], start=1)
    return sum(w * (values(at + m * step) - values(at - m * step)) for m, w in weights) / np.sum(step)


def jacobian(values: Callable, at: Float[Array, " n"], steps, points: int = 4) -> Float[Array, "... n"]:
    """The derivatives of what ``values`` returns along each entry of ``at``, with one step for all or one for each."""
    units = np.eye(len(at)) * np.broadcast_to(steps, len(at))
    return np.stack([slope(values, at, unit, points) for unit in units], axis=-1)
