"""Modified divided differences of slopes at the last points, and integrals of the polynomial through them.

``adams`` advances a solve by them.

Slopes f_n, f_{n−1}, … at the points t_n, t_{n−1}, … have the differences

    Φ_j(n) = (t_n − t_{n−1}) (t_n − t_{n−2}) ⋯ (t_n − t_{n−j}) δʲf[t_n, …, t_{n−j}],

with δʲ the divided difference of order j, so that Φ_0 is f_n, and for equal steps Φ_j is the backward difference ∇ʲf_n.
At t_{n+1} they are Φ_0 = f_{n+1} and Φ_{j+1}(n+1) = Φ_j(n+1) − β_j Φ_j(n): this is how they are advanced, and how a
polynomial is extrapolated, whose value there is Σ β_j Φ_j(n).

Krogh, *Changing stepsize in the integration of differential equations using modified divided differences*, Lecture
Notes in Mathematics 362 (1974) 22–71; Hairer, Nørsett & Wanner, *Solving Ordinary Differential Equations I* (1993),
section III.5, from where the names β, Φ and g are.
"""

import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

# Components in a vector, and how many of them are not worth one.
COMPONENTS_OF_VECTOR, FEW_COMPONENTS = 8, 2


class Points(NamedTuple):
    """The points behind a step of length ``h``: ``past`` are the times from each of them to the step's start.

    The last point is the start itself, ``past[0]`` = 0, or shortly before it.
    """

    past: Float[Array, " rows"]
    h: Float[Array, ""]

    def factors(self) -> Float[Array, " rows"]:
        """Computes β_j, the product of (t − t_{n−i}) / (t_n − t_{n−1−i}) over i < j, with t the end of the step."""
        return products((self.h + self.past[:-1]) / (self.past[1:] - self.past[0]))

    def evenness(self) -> Float[Array, " rows"]:
        """Computes j! hʲ over the product of t − t_{n−i} over i < j: 1 if all steps had the length h.

        It estimates what a difference would be with equal steps.
        """
        return products(jnp.arange(1, self.past.size, dtype=self.h.dtype) * self._shares())

    def integrals(self, end: Float[Array, ""] | None = None) -> Float[Array, " rows"]:
        """Computes g_j, the integrals of the products of (s − t_{n−i}) / (t − t_{n−i}) over i < j, from 0 to ``end``,
        over h.

        ``end`` is a fraction of the step, by default all of it. With P_j the product and X the end, the integrals of
        P_j(s) (1 − s/X)ᵐ from 0 to X follow from those of P_{j−1}, because s − t_{n−i} is linear in 1 − s/X (Shampine &
        Gordon 1975, chapter 5).
        """
        shares = self._shares()
        moments = jnp.asarray(1 / np.arange(1, self.past.size + 1), self.h.dtype)
        values = [moments[0]]
        for share in shares:
            whole, part = (1.0, share) if end is None else (1 - (1 - end) * share, end * share)
            moments = whole * moments[:-1] - part * moments[1:]
            values.append(moments[0])
        g = jnp.stack(values)
        return g if end is None else end * g

    def _shares(self) -> Float[Array, " count"]:
        """Computes h/(t − t_{n−i})."""
        return self.h / (self.h + self.past[:-1])

    def advance(self) -> Float[Array, " rows"]:
        """Computes ``past`` of the next step."""
        return jnp.concatenate([jnp.zeros_like(self.past[:1]), self.h + self.past[:-1]])


def sums(rows: Float[Array, "*n rows"]) -> Float[Array, "*n rows"]:
    """Computes the sums of all rows before each."""
    items = [rows[..., j] for j in range(rows.shape[-1] - 1)]
    return jnp.stack(_before_each(jnp.add, items, jnp.zeros_like(rows[..., 0])), -1)


def products(factors: Float[Array, "count *n"]) -> Float[Array, "rows *n"]:
    """Computes the products 1, a, ab, abc, … of all factors before each place, and of all of them."""
    return jnp.stack(_before_each(jnp.multiply, list(factors), jnp.ones_like(factors[0])))


def _before_each(combined: Callable[[Array, Array], Array], items: Sequence[Array], first: Array) -> list[Array]:
    """Combines the items one after another: a loop or a library call would cost more."""
    return [first, *itertools.accumulate(items, combined)]


def fold(rows: Float[Array, "rows n"]) -> Float[Array, "lanes columns rows"]:
    """Folds rows of n components to a first axis of eight, along which the native compiler computes in vectors.

    They end with zeros where n is no multiple of eight. One or two components stay as they are.
    """
    n = rows.shape[-1]
    lanes = n if n <= FEW_COMPONENTS else COMPONENTS_OF_VECTOR
    columns = -(-n // lanes) if n else 0
    padded = jnp.pad(rows, ((0, 0), (0, lanes * columns - n)))
    return jnp.transpose(padded.reshape(len(rows), columns, lanes), (2, 1, 0))


def unfold(folds: Float[Array, "lanes columns rows"], n: int) -> Float[Array, "rows n"]:
    """Restores the rows of n components from what :func:`fold` returned."""
    return jnp.transpose(folds, (2, 1, 0)).reshape(folds.shape[2], folds.shape[0] * folds.shape[1])[:, :n]


def error_constants(rows: int) -> np.ndarray:
    """Computes |γ*_j|: the error of the integral over a step by the formula with j points for equal steps, in units of
    h ∇ʲf.

    They are the coefficients of the Adams–Moulton formulas: Hairer, Nørsett & Wanner I, eqs. (III.1.11) and (III.1.12).
    """
    gamma = np.ones(rows)
    for j in range(1, rows):
        gamma[j] = -sum(gamma[i] / (j + 1 - i) for i in range(j))
    return np.abs(gamma)
