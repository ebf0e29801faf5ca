"""Functions in the forms that rails, schedules, motions, forces and laws share.

A constant plus sinusoids and powers of the time, polynomials joined at breaks, and a function that a user gives.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..interface.arguments import call_with, require_function
from ..interface.printing import Printed
from .arrays import Numbers, a_number, to_array
from .declare import TIME, number
from .kinks import kinks_of_function
from .linear import tridiagonal_solution
from .vectors import sine_cosine

MOST_CHOSEN = 64  # breaks up to which choosing among all pieces takes less time than a search for one


class HarmonicSeries(Printed):
    """f(t) = constant + Σ powers_j t^(j + 1) + Σ amplitude_k sin(frequency_k t + phase_k).

    **Arguments:**

    - ``constant``: of any shape and unit.
    - ``amplitude``: in the same unit, one entry for each sinusoid, shape (terms, ...).
    - ``frequency``: rad/time, shape (terms,).
    - ``phase``: rad, shape (terms,); zero if not given.
    - ``powers``: the coefficients of t, t², …, in the unit of ``constant`` over powers of time, shape (degree, ...);
      none, at no cost, if not given.

    **Raises:** ``ValueError`` when the shapes do not fit each other.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import HarmonicSeries
    >>> series = HarmonicSeries((0.0, 0.0, 0.3), amplitude=[(0.2, 0.0, 0.0)], frequency=[2.0], phase=[jnp.pi / 2])
    >>> series(jnp.array(0.0))
    Array([0.2, 0. , 0.3], dtype=float64)
    >>> fall = HarmonicSeries(1.0, powers=[0.0, -0.5])  # 1 − t²/2
    >>> float(fall(jnp.array(2.0)))
    -1.0
    """

    constant: Float[Array, "..."]
    amplitude: Float[Array, "..."]
    frequency: Float[Array, "*group terms"]
    phase: Float[Array, "*group terms"]
    powers: Float[Array, "..."] | None

    def __init__(
        self,
        constant: Numbers,
        amplitude: Numbers | None = None,
        frequency: Numbers = (),
        phase: Numbers | None = None,
        powers: Numbers | None = None,
    ):
        self.constant = to_array(constant, "constant")
        self.frequency = to_array(frequency, "frequency")
        terms = self.frequency.shape[0] if self.frequency.ndim == 1 else None
        shape = (terms, *self.constant.shape)
        self.amplitude = (
            jnp.zeros_like(self.constant, shape=(0, *shape[1:]))
            if amplitude is None
            else to_array(amplitude, "amplitude")
        )
        self.phase = jnp.zeros_like(self.frequency) if phase is None else to_array(phase, "phase")
        if self.amplitude.shape != shape or self.phase.shape != self.frequency.shape:
            raise ValueError(
                "Arguments `amplitude`, `frequency` and `phase` must have one entry for each "
                f"sinusoid, but their shapes are {self.amplitude.shape}, {self.frequency.shape} and "
                f"{self.phase.shape}, beside a constant of shape {self.constant.shape}."
            )
        self.powers = None if powers is None else to_array(powers, "powers")
        if self.powers is not None and (self.powers.ndim == 0 or self.powers.shape[1:] != shape[1:]):
            raise ValueError(
                "Argument `powers` must have one entry for each power of the time, each of the shape "
                f"{self.constant.shape} of the constant, but its shape is {self.powers.shape}."
            )

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "*shape"]:
        waves, _ = sine_cosine(self.frequency * t + self.phase)
        waves = waves.reshape(waves.shape + (1,) * self.constant.ndim)
        value = self.constant + jnp.sum(self.amplitude * waves, axis=0)
        if self.powers is None:
            return value
        polynomial = jnp.zeros_like(self.constant)
        for row in self.powers[::-1]:  # by Horner's rule
            polynomial = (polynomial + row) * t
        return value + polynomial


class PiecewisePolynomial(eqx.Module):
    """Polynomials joined at ``breaks``; the first and the last extend to infinity.

    Piece j is Σ_k coefficients[j, k] (x − origins[j])ᵏ and holds for breaks[j−1] ≤ x < breaks[j].
    """

    breaks: Float[Array, "*group breaks"]
    origins: Float[Array, "*group pieces"]
    coefficients: Float[Array, "..."]

    def __call__(self, x: Float[Array, ""]) -> Float[Array, "*shape"]:
        origin, c = self._piece_at(x)
        s = x - origin
        value = c[-1]
        for k in range(c.shape[0] - 2, -1, -1):
            value = value * s + c[k]
        return value

    def _piece_at(self, x: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, "degree_plus_one *shape"]]:
        """Returns the origin and the coefficients of the piece at x: of few pieces by choosing one of each two
        neighbours, until one is left, and of many by a binary search.
        """
        breaks, pieces = self.breaks, (self.origins, self.coefficients)
        if breaks.shape[0] > MOST_CHOSEN:
            piece = _count_up_to(breaks, x)
            return row_at(self.origins, piece), row_at(self.coefficients, piece)
        while breaks.shape[0]:
            later = breaks[::2] <= x
            pieces = tuple(_choose_of_pairs(later, rows) for rows in pieces)
            breaks = breaks[1::2]
        origins, coefficients = pieces
        return origins[0], coefficients[0]

    def integral(self) -> "PiecewisePolynomial":
        """Returns the integral of a scalar polynomial whose first two origins are its first break, where the integral
        is 0.
        """
        power = jnp.arange(1, self.coefficients.shape[1] + 1, dtype=self.coefficients.dtype)
        # A power's integral; the constants of the pieces follow below.
        raised = self.coefficients / power[None]
        h = jnp.diff(self.breaks)[:, None]
        # A sum over the intervals, not a loop over them, which takes long to compile where there are many.
        changes = jnp.sum(raised[1:-1] * h ** power[None], axis=1)
        # Both pieces at the first break are measured from there, where the integral is 0.
        start = jnp.concatenate([jnp.zeros((2,), changes.dtype), jnp.cumsum(changes)])
        return PiecewisePolynomial(self.breaks, self.origins, jnp.concatenate([start[:, None], raised], axis=1))


def _choose_of_pairs(later: Bool[Array, " pairs"], rows: Float[Array, "n *shape"]) -> Float[Array, "m *shape"]:
    """Returns of each two neighbouring rows the later one where ``later``, and the last row if it has no neighbour."""
    pairs = later.shape[0]
    mask = later.reshape(later.shape + (1,) * (rows.ndim - 1))
    return jnp.concatenate([jnp.where(mask, rows[1 : 2 * pairs : 2], rows[: 2 * pairs : 2]), rows[2 * pairs :]])


def _count_up_to(breaks: Float[Array, " n"], x: Float[Array, ""]) -> Int[Array, ""]:
    """Counts the increasing ``breaks`` that are x or less, by bisection.

    It is ``jnp.searchsorted(breaks, x, "right")``, but that is a function of its own, to which a compiler may pass a
    copy of all breaks.
    """
    first, last = jnp.zeros((), int), jnp.asarray(breaks.shape[0])
    for _ in range(breaks.shape[0].bit_length()):
        middle = (first + last) // 2
        up_to = (row_at(breaks, jnp.minimum(middle, breaks.shape[0] - 1)) <= x) & (middle < last)
        first, last = jnp.where(up_to, middle + 1, first), jnp.where(up_to, last, middle)
    return first


def row_at(rows: Float[Array, "n *shape"], index: Int[Array, ""]) -> Float[Array, "*shape"]:
    """Returns the row at an index that is known to be within range."""
    return rows.at[index].get(mode="promise_in_bounds")


def periodic_cubic_spline(
    knots: Float[Array, " n_plus_one"], values: Float[Array, "n *shape"]
) -> Float[Array, "n 4 *shape"]:
    """Computes the coefficients of the twice continuously differentiable periodic cubic through ``values``.

    ``knots`` has one entry more than ``values``: its last is where the first value comes again.
    """
    h = jnp.diff(knots)
    step = h.reshape(h.shape + (1,) * (values.ndim - 1))
    chord = (jnp.roll(values, -1, axis=0) - values) / step
    bend = _bends(jnp.roll(h, 1), h, chord - jnp.roll(chord, 1, axis=0))
    return _hermite_pieces(values, chord, bend, jnp.roll(bend, -1, axis=0), step)


def cubic_spline_with_slopes(
    knots: Float[Array, " n"],
    values: Float[Array, "n *shape"],
    end_slopes: Float[Array, "2 *shape"],
) -> Float[Array, "n_minus_one 4 *shape"]:
    """Computes the coefficients of the twice continuously differentiable cubic through ``values`` with given end
    slopes.
    """
    h = jnp.diff(knots)
    step = h.reshape(h.shape + (1,) * (values.ndim - 1))
    chord = jnp.diff(values, axis=0) / step
    zero = jnp.zeros((1,), dtype=h.dtype)
    slopes = jnp.concatenate([end_slopes[:1], chord, end_slopes[1:]])
    bend = _bends(jnp.concatenate([zero, h]), jnp.concatenate([h, zero]), jnp.diff(slopes, axis=0))
    return _hermite_pieces(values[:-1], chord, bend[:-1], bend[1:], step)


def _bends(
    before: Float[Array, " n"], after: Float[Array, " n"], turns: Float[Array, "n *shape"]
) -> Float[Array, "n *shape"]:
    """Computes the second derivatives at knots, the first of which follows the last, by the changes of slope there.

    - ``before``, ``after``: the lengths of the intervals beside each knot; 0 where there is none.
    """
    rows = jnp.arange(len(before))
    matrix = jnp.diag(2 * (before + after))
    # Added, because of two knots each is the neighbour of the other on both sides.
    matrix = matrix.at[rows, rows - 1].add(before).at[rows, (rows + 1) % len(before)].add(after)
    return jnp.linalg.solve(matrix, 6 * turns.reshape(len(before), -1)).reshape(turns.shape)


def not_a_knot_cubic_spline(knots: Float[Array, " n"], values: Float[Array, " n"]) -> Float[Array, "n_minus_one 4"]:
    """Computes the coefficients of the cubic spline through ``values`` whose third derivative does not jump at the
    second and the last but one of its ``knots``, which makes it accurate to the fourth power of their distance up to
    the ends.

    Through three values it is a parabola, and through two a line (de Boor, *A Practical Guide to Splines*, 1978, IV).
    """
    h = jnp.diff(knots)
    chord = jnp.diff(values) / h
    if values.shape[0] < 4:
        turn = jnp.diff(chord) / (h[:-1] + h[1:]) * 2  # empty for two values
        bend = jnp.full_like(values, turn[0]) if turn.size else jnp.zeros_like(values)
        return _hermite_pieces(values[:-1], chord, bend[:-1], bend[1:], h)
    # Rows for the bends at inner knots, from which those at both ends follow.
    left, right = h[0] / h[1], h[-1] / h[-2]
    # Equal third derivatives on both sides of a knot: (b₁ − b₀) / h₀ = (b₂ − b₁) / h₁, from which b₀ is eliminated.
    diagonal = (2 * (h[:-1] + h[1:])).at[0].add(h[0] * (1 + left)).at[-1].add(h[-1] * (1 + right))
    lower = h[:-1].at[0].set(0.0).at[-1].add(-h[-1] * right)
    upper = h[1:].at[-1].set(0.0).at[0].add(-h[0] * left)
    inner = tridiagonal_solution(lower, diagonal, upper, 6 * jnp.diff(chord))
    first = inner[0] + left * (inner[0] - inner[1])
    last = inner[-1] + right * (inner[-1] - inner[-2])
    bend = jnp.concatenate([first[None], inner, last[None]])
    return _hermite_pieces(values[:-1], chord, bend[:-1], bend[1:], h)


def _hermite_pieces(values, chord, bend, next_bend, step):
    slope = chord - step * (2 * bend + next_bend) / 6
    return jnp.stack([values, slope, bend / 2, (next_bend - bend) / (6 * step)], axis=1)


class OfFunction(Printed):
    """A function of arguments that its subclass names, and of ``parameters``."""

    function: Callable[..., Any] = eqx.field(static=True)
    parameters: PyTree = None


class OfKinkedFunction(OfFunction):
    """The same of the time, with the times at which it jumps or has a kink."""

    kink_times: Float[Array, "*group kinks"] = eqx.field(converter=number(TIME), default=())

    def kinks(self) -> Float[Array, " kinks"]:
        return kinks_of_function(self)


class VectorOfTime(OfKinkedFunction):
    """The same with values of shape (3,)."""

    def __check_init__(self):
        require_function("function", self.function, (3,), t=a_number(), parameters=self.parameters)

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "3"]:
        return call_with(self.function, t, parameters=self.parameters)


class OfKinkedFunctionOfState(OfKinkedFunction):
    """The same as a function of the time and of the variables of a solve."""

    def kinks(self) -> Float[Array, " kinks"]:
        return self.kink_times
