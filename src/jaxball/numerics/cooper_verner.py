"""One step of the explicit Runge–Kutta method of order 8 with eleven stages.

The laws of contact integrate impacts and the ends of slips by it.

G. J. Cooper & J. H. Verner, Some explicit Runge–Kutta methods of high order, SIAM J. Numer. Anal. 9 (1972) 389–405.
"""

from collections.abc import Callable
from math import sqrt

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

S = sqrt(21)
STAGES = (
    (1 / 2,),
    (1 / 4, 1 / 4),
    (1 / 7, (-7 - 3 * S) / 98, (21 + 5 * S) / 49),
    ((11 + S) / 84, 0.0, (18 + 4 * S) / 63, (21 - S) / 252),
    ((5 + S) / 48, 0.0, (9 + S) / 36, (-231 + 14 * S) / 360, (63 - 7 * S) / 80),
    ((10 - S) / 42, 0.0, (-432 + 92 * S) / 315, (633 - 145 * S) / 90, (-504 + 115 * S) / 70, (63 - 13 * S) / 35),
    (1 / 14, 0.0, 0.0, 0.0, (14 - 3 * S) / 126, (13 - 3 * S) / 63, 1 / 9),
    (1 / 32, 0.0, 0.0, 0.0, (91 - 21 * S) / 576, 11 / 72, (-385 - 75 * S) / 1152, (63 + 13 * S) / 128),
    (
        *(1 / 14, 0.0, 0.0, 0.0, 1 / 9),
        *((-733 - 147 * S) / 2205, (515 + 111 * S) / 504, (-51 - 11 * S) / 56, (132 + 28 * S) / 245),
    ),
    (
        *(0.0, 0.0, 0.0, 0.0, (-42 + 7 * S) / 18, (-18 + 28 * S) / 45),
        *((-273 - 53 * S) / 72, (301 + 53 * S) / 72, (28 - 28 * S) / 45, (49 - 7 * S) / 18),
    ),
)
WEIGHTS = (1 / 20, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 49 / 180, 16 / 45, 49 / 180, 1 / 20)


def step(
    slope: Callable[[Float[Array, " n"]], Float[Array, " n"]], x: Float[Array, " n"], h: Float[Array, ""]
) -> Float[Array, " n"]:
    """Computes x(h) of ẋ = slope(x), where x is given at 0."""
    count = len(WEIGHTS)
    rows = np.array([(*row, *(0.0,) * (count - len(row))) for row in ((), *STAGES)])

    def stage(slopes: Float[Array, "stages n"], entry: tuple[Array, Array]) -> tuple[Float[Array, "stages n"], None]:
        place, row = entry
        return slopes.at[place].set(slope(x + h * _add_weighted(row, slopes))), None

    # A loop, so that the slope is traced and compiled once.
    nothing = jnp.zeros((count, *x.shape), x.dtype)
    slopes, _ = jax.lax.scan(stage, nothing, (jnp.arange(count), jnp.asarray(rows, x.dtype)))
    return x + h * _add_weighted(jnp.asarray(WEIGHTS, x.dtype), slopes)


def _add_weighted(weights: Float[Array, " stages"], slopes: Float[Array, "stages n"]) -> Float[Array, " n"]:
    return jnp.sum(weights[:, None] * slopes, axis=0)
