"""Positions and curves in the plane: two numbers for a position, and one for a disk, which rolls along e1.

Objectives and constraints have their places and paths in these forms.
"""

import abc
import math
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ... import programs
from ...interface.printing import Printed
from ...numerics.arrays import Numbers, require_shape, to_array
from ...numerics.declare import LENGTH, POSITIVE, number
from ...numerics.functions import PiecewisePolynomial, cubic_spline_with_slopes
from .space import DesignError

SAMPLES = 200


# A deviation from e1 smaller than this fraction of the extent is rounding.
ROUNDING = 1e-9


Converter = Callable[[Numbers], Float[Array, "..."]]


def place(name: str) -> Converter:
    """Returns the converter of a field ``name`` to a position in the plane; a single number z is (z, 0)."""
    return _converter(name, lambda z: z if z.ndim else jnp.stack([z, jnp.zeros_like(z)]), (2,))


def places(name: str) -> Converter:
    """Returns the converter of a field ``name`` to positions in the plane, a row each; single numbers z are (z, 0)."""
    return _converter(name, lambda z: jnp.stack([z, jnp.zeros_like(z)], axis=1) if z.ndim == 1 else z, ("n", 2))


def corner(name: str) -> Converter:
    """Returns the converter of a field ``name`` to a bound of positions: two numbers, or one for a disk."""
    return _converter(name, jnp.atleast_1d, (2,), (1,))


def _converter(name: str, changed: Callable[[Array], Array], *shapes: tuple[int | str, ...]) -> Converter:
    """Makes a converter to one of the ``shapes``, of which errors name the first."""

    def convert(x: Numbers) -> Float[Array, "..."]:
        z = changed(to_array(x, name))
        require_shape(name, z, z.shape if z.shape in shapes else shapes[0])
        return z

    return convert


def off_e1(points: Float[ArrayLike, "n 2"]) -> str:
    """Reports positions off e1, for :meth:`Requirement.unreachable_by_disk`."""
    # Relative to the extent, because users' units may be of any size.
    points = np.abs(np.asarray(points))
    most = np.max(points[:, 1], initial=0.0)
    return f"a position {most:.6g} off e1" if most > ROUNDING * np.max(points, initial=0.0) else ""


class AbstractCurve(Printed):
    """A curve c(s) in the plane, 0 ≤ s ≤ 1; for a disk it lies on e1, and its points are single numbers."""

    @abc.abstractmethod
    def __call__(self, s: Float[Array, ""]) -> Float[Array, "2"]:
        """Returns the point c(s)."""

    def points(self, count: int) -> Float[Array, "count 2"]:
        """Returns points at equal steps of s, including both ends."""
        return along(self, jnp.asarray(np.linspace(0.0, 1.0, count), dtype=to_array(0.0).dtype))

    def spanning_vectors(self) -> Float[Array, "k 2"]:
        """Returns vectors of which each of its points is a linear combination; by default points of it."""
        return self.points(SAMPLES)


@programs.filter_jit
def along(curve: AbstractCurve, s: Float[Array, " n"]) -> Float[Array, "n 2"]:
    """Returns points of a curve."""
    return jax.vmap(curve)(s)


class Sigmoid(AbstractCurve):
    """From ``origin`` over ``length`` along e1, and over ``height`` along e2 by a logistic function, half way at s = ½.

    c = origin + (length s, height (σ(k (s − ½)) − σ(−k/2)) / (σ(k/2) − σ(−k/2))) with σ(x) = 1 / (1 + exp(−x)) and
    k = ``steepness``.

    **Arguments:**

    - ``length``, ``height``: length.
    - ``steepness``: dimensionless.
    - ``origin``: length, shape (2,).

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.design import Sigmoid
    >>> print(Sigmoid(length=4.0, height=2.0)(jnp.array(0.5)).round(6))
    [2. 1.]
    """

    length: Float[Array, ""] = eqx.field(converter=number(LENGTH))
    height: Float[Array, ""] = eqx.field(converter=number())
    steepness: Float[Array, ""] = eqx.field(converter=number(rule=POSITIVE), default=10.0)
    origin: Float[Array, "2"] = eqx.field(converter=place("origin"), default=(0.0, 0.0))

    def __call__(self, s):
        half = jax.nn.sigmoid(self.steepness / 2)
        # The logistic function is shifted by its value at the start and divided by its rise, so that c(0) = origin
        # and c(1) is at the full height.
        rise = (jax.nn.sigmoid(self.steepness * (s - 0.5)) - (1 - half)) / (2 * half - 1)
        return self.origin + jnp.stack([self.length * s, self.height * rise])

    def spanning_vectors(self):
        return jnp.stack([self.origin, jnp.stack([self.length, self.height])])


class FigureEight(AbstractCurve):
    """Once around the figure eight of Gerono, from its crossing at ``origin``, with ``length`` along e1 and ``height``.

    c = origin + (length/2 sin 2πs, height/2 sin 4πs).

    **Arguments:**

    - ``length``, ``height``: length.
    - ``origin``: length, shape (2,).

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.design import FigureEight
    >>> print(FigureEight(length=4.0, height=2.0)(jnp.array(0.125)).round(6))
    [1.414214 1.      ]
    """

    length: Float[Array, ""] = eqx.field(converter=number(LENGTH))
    height: Float[Array, ""] = eqx.field(converter=number())
    origin: Float[Array, "2"] = eqx.field(converter=place("origin"), default=(0.0, 0.0))

    def __call__(self, s):
        turn = 2 * math.pi * s
        return self.origin + jnp.stack([self.length * jnp.sin(turn), self.height * jnp.sin(2 * turn)]) / 2

    def spanning_vectors(self):
        return jnp.stack([self.origin, jnp.stack([self.length, self.height])])


class Through(AbstractCurve):
    """The cubic spline through points at equal steps of s; a straight line through two.

    Its slopes at the ends are those of the parabolas through the first and the last three points, where other splines
    have no curvature (natural) or no jump of the third derivative (not-a-knot).

    **Arguments:**

    - ``through``: the points, length, shape (n, 2).

    **Raises:** ``ValueError`` for another shape, and :class:`DesignError` for fewer than two points.

    **Example:**

    >>> from jaxball.design import Through
    >>> print(Through([(0.0, 0.0), (2.0, 1.0)]).points(3))
    [[0.  0. ]
     [1.  0.5]
     [2.  1. ]]
    """

    through: Float[Array, "n 2"] = eqx.field(converter=places("through"))

    def __check_init__(self):
        if self.through.shape[0] < 2:
            raise DesignError(
                "Argument `through` must be two points or more, each of two numbers, but its shape is "
                f"{self.through.shape}."
            )

    def spanning_vectors(self):
        return self.through

    def __call__(self, s):
        n = self.through.shape[0]
        knots = jnp.asarray(np.linspace(0.0, 1.0, n), dtype=self.through.dtype)
        # The knots are at equal steps 1 / (n − 1).
        steps = jnp.diff(self.through, axis=0) * (n - 1)
        # Slopes at the ends by the parabola through three points.
        ends = (1.5 * steps[0] - 0.5 * steps[1], 1.5 * steps[-1] - 0.5 * steps[-2]) if n > 2 else (steps[0], steps[0])
        pieces = cubic_spline_with_slopes(knots, self.through, jnp.stack(ends))
        return PiecewisePolynomial(knots[1:-1], knots[:-1], pieces)(s)
