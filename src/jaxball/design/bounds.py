"""Bounded numbers as functions of unbounded ones, after MINUIT.

An optimum on a bound is an interior stationary point of the unbounded variable, at which the Hessian is
definite, so that it is nothing special to a quasi-Newton method (James & Roos, Comput. Phys. Commun. 10 (1975) 343).
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

# A start on a bound, from which it could not move away, is moved inside by this fraction of its scale.
INSIDE = 1e-3


class Bounds(NamedTuple):
    """The lower and upper bounds of n numbers, infinite where there are none, and their scales.

    **Arguments:**

    - ``lower``, ``upper``, ``scale``: one entry for each number, shape (n,).

    **Example:**

    >>> import jax.numpy as jnp
    >>> import numpy as np
    >>> from jaxball.design import Bounds
    >>> bounds = Bounds(lower=np.array([0.0]), upper=np.array([2.0]), scale=np.array([1.0]))
    >>> print(bounds.numbers(jnp.array([-jnp.pi / 2])), bounds.numbers(jnp.array([0.0])))
    [0.] [1.]
    """

    lower: Float[np.ndarray, " n"]
    upper: Float[np.ndarray, " n"]
    scale: Float[np.ndarray, " n"]

    def numbers(self, y: Float[Array, " n"]) -> Float[Array, " n"]:
        """The numbers of unbounded variables: scale y, scale (√(1 + y²) − 1) from one bound, or a sine between two."""
        low, high = (jnp.asarray(x, dtype=y.dtype) for x in self._finite())
        scale = jnp.asarray(self.scale, dtype=y.dtype)
        away = scale * (jnp.sqrt(1 + y**2) - 1)
        middle, half = (low + high) / 2, (high - low) / 2
        both = middle + half * jnp.sin(scale * y / jnp.where(half > 0, half, 1.0))
        below, above = np.isfinite(self.lower), np.isfinite(self.upper)
        return jnp.where(below & above, both, jnp.where(below, low + away, jnp.where(above, high - away, scale * y)))

    def variables(self, x: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """The unbounded variables of numbers; those on a bound are moved slightly inside."""
        below, above = np.isfinite(self.lower), np.isfinite(self.upper)
        low, high = self._finite()
        half = np.where(below & above, (high - low) / 2, 1.0)
        inside = INSIDE * np.where(below & above, np.minimum(self.scale, half), self.scale)
        x = np.where(below, np.maximum(x, low + inside), x)
        x = np.where(above, np.minimum(x, high - inside), x)
        away = np.where(below, x - low, high - x) / self.scale
        one = np.sqrt((1 + np.where(below ^ above, away, 0.0)) ** 2 - 1)
        both = half / self.scale * np.arcsin(np.clip((x - (low + high) / 2) / half, -1, 1))
        return np.where(below & above, both, np.where(below ^ above, one, x / self.scale))

    def _finite(self) -> tuple[np.ndarray, np.ndarray]:
        """The bounds, 0 where there is none."""
        return tuple(np.where(np.isfinite(x), x, 0.0) for x in (self.lower, self.upper))  # pyright: ignore[reportReturnType]
