"""How long stretches of sampled functions are polynomials: where a step of an integrator sees what happens within it.

The samples are equally spaced. A window of n + 1 of them is followed if the Chebyshev coefficient of order n of the
polynomial through them, which their n-th difference tells, is small. Long windows have every 16th, 8th, … sample. n is
16, so that a step whose own error resolves a function is hardly ever found too long.
"""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt32

INTERVALS = 256  # between samples
CELLS = 32  # parts of the samples in each of which the longest step is the same; a number has a bit for each
HIGHEST = 16  # order
VISIBLE = 1e-3  # of a function's variation: what a step can tell from nothing
LEAST_VARIATION = 64  # roundings of a function's size


class _Window(NamedTuple):
    """A stretch of ``order`` + 1 samples, every ``stride``-th one.

    Where a function varies more within it than a polynomial, steps are no ``longest`` intervals long.
    """

    order: int
    stride: int
    longest: int

    @property
    def number(self) -> int:
        """How many there are, each a stride after the one before."""
        return INTERVALS // self.stride - self.order + 1

    @property
    def weights(self) -> list[float]:
        """What takes the samples to the Chebyshev coefficient of the order, (n/4)ⁿ 2/n! times the n-th difference."""
        n = self.order
        size = 2 * (n / 4) ** n / math.factorial(n)
        return [(-1) ** k * math.comb(n, k) * size for k in range(n + 1)]

    @property
    def cells(self) -> np.ndarray:
        """The cells into which each of them reaches, one bit for each."""
        first = np.arange(self.number) * self.stride
        last = first + self.order * self.stride
        starts = np.arange(CELLS) * (INTERVALS // CELLS)
        ends = starts + INTERVALS // CELLS
        reaches = (first[:, None] < ends) & (starts < last[:, None])
        return np.sum(reaches << np.arange(CELLS), axis=1).astype(np.uint32)

    def failing(
        self,
        samples: Float[Array, "samples k"],
        breaks: Int[Array, " samples"] | None,
        most: Float[Array, " k"],
    ) -> UInt32[Array, ""]:
        """Returns the cells in which a function is not followed, because a coefficient is larger than ``most``."""
        samples, count = samples[:: self.stride], self.number
        coefficients = sum(weight * samples[k : k + count] for k, weight in enumerate(self.weights))
        fails = jnp.any(jnp.abs(coefficients) > most[None], axis=1)
        if breaks is not None:
            breaks = breaks[:: self.stride]
            fails &= breaks[self.order : self.order + count] == breaks[:count]
        return jax.lax.reduce(jnp.where(fails, self.cells, 0), np.uint32(0), jax.lax.bitwise_or, (0,))


# The short windows tell how much shorter the steps must be where the shortest one of the highest order is not followed.
LONG = tuple(_Window(HIGHEST, stride, 8 * stride) for stride in (16, 8, 4, 2, 1))
SHORT = (_Window(8, 1, 4), _Window(4, 1, 1))


class Range(NamedTuple):
    """The extreme values of functions, as far as they are known."""

    least: Float[Array, " k"]
    largest: Float[Array, " k"]

    @classmethod
    def none(cls, of: Any) -> "Range":
        """Returns that of no samples of functions with values of this shape and type."""
        no = jnp.full(of.shape, jnp.inf, of.dtype)
        return cls(no, -no)

    def including(self, samples: Float[Array, "samples k"]) -> "Range":
        """Returns the extreme values of these samples, too."""
        return Range(
            jnp.minimum(self.least, jnp.min(samples, axis=0)), jnp.maximum(self.largest, jnp.max(samples, axis=0))
        )

    def share(self, of: Float[Array, ""]) -> Float[Array, " k"]:
        """Returns a part of how much each function varies; at least what rounding makes of its size."""
        size = jnp.maximum(jnp.abs(self.least), jnp.abs(self.largest))
        rounding = LEAST_VARIATION * float(jnp.finfo(size.dtype).eps) * size
        return jnp.maximum(of * (self.largest - self.least), rounding)


def failing_windows(
    samples: Float[Array, "samples k"],
    breaks: Int[Array, " samples"] | None,
    extent: Range,
    tolerance: Float[Array, ""],
) -> UInt32[Array, " kinds"]:
    """Returns the cells in which each kind of window is not followed, as bits.

    ``samples`` may have more rows than those that count.

    - ``breaks``: how many jumps there are before each sample; None without any. Steps end at them, so that a window
      across one tells nothing.
    - ``extent``: of the functions, to which the ``tolerance`` is relative.
    """
    small = extent.share(tolerance)
    failing = [window.failing(samples, breaks, small) for window in LONG]

    def look_closer(last: UInt32[Array, ""]) -> list[UInt32[Array, ""]]:
        shorter, visible = [last], extent.share(jnp.maximum(tolerance, VISIBLE))
        for window in SHORT:
            shorter.append(shorter[-1] & window.failing(samples, breaks, visible))
        return shorter[1:]

    none = [jnp.zeros_like(failing[-1])] * len(SHORT)
    return jnp.stack(failing + jax.lax.cond(failing[-1] > 0, look_closer, lambda last: none, failing[-1]))


def in_cell(failing: UInt32[Array, " kinds"], cell: Int[Array, ""]) -> Bool[Array, " kinds"]:
    """Returns which kinds of windows are not followed in a cell."""
    return failing & (np.uint32(1) << cell.astype(np.uint32)) > 0


def longest_step(failing: Bool[Array, " kinds"]) -> Float[Array, ""]:
    """Returns the longest step where these kinds of windows are not followed, in intervals; infinite without any."""
    longest = jnp.asarray(jnp.inf)
    for k, window in enumerate(LONG + SHORT):
        longest = jnp.where(failing[k], window.longest, longest)
    return longest


def extent_of(cells: UInt32[Array, ""]) -> tuple[Int[Array, ""], Int[Array, ""]]:
    """Returns the first of some cells, and the one after the last; the first is beyond all if there are none."""
    place = np.arange(CELLS)
    inside = (cells >> place.astype(np.uint32)) & 1 > 0
    return jnp.min(jnp.where(inside, place, CELLS)), jnp.max(jnp.where(inside, place + 1, 0))
