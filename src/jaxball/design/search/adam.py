"""Adam (Kingma & Ba, ICLR 2015, algorithm 1), on arrays of NumPy, whose state can be written to a file."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

FIRST, SECOND, TINY = 0.9, 0.999, 1e-8


class Moments(NamedTuple):
    """The running means of gradients and of their squares, and how many there were."""

    first: Float[np.ndarray, "starts n"]
    second: Float[np.ndarray, "starts n"]
    taken: np.ndarray

    @staticmethod
    def none(shape: tuple[int, ...]) -> "Moments":
        """Before the first gradient."""
        return Moments(np.zeros(shape), np.zeros(shape), np.asarray(0))

    def after(self, gradient: Float[np.ndarray, "starts n"]) -> "Moments":
        """With one gradient more."""
        first = FIRST * self.first + (1 - FIRST) * gradient
        return Moments(first, SECOND * self.second + (1 - SECOND) * gradient**2, self.taken + 1)

    def step(self, rate: float) -> Float[np.ndarray, "starts n"]:
        """The step to take."""
        first = self.first / (1 - FIRST**self.taken)
        return -rate * first / (np.sqrt(self.second / (1 - SECOND**self.taken)) + TINY)
