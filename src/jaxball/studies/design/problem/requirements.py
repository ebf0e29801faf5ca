"""What objectives and constraints are: their contracts, and the positions and curves of the plane that they name."""

import abc
import math
from collections.abc import Callable, Iterable, Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, PyTree

from .... import programs
from ....interface.arguments import require_callable_with
from ....interface.printing import Printed
from ....numerics.arrays import Numbers, require_shape, to_array
from ....numerics.declare import LENGTH, POSITIVE, number
from ....numerics.functions import PiecewisePolynomial, cubic_spline_with_slopes
from ....numerics.quadrature import integrate_samples
from ....physics.body import System
from .run import Run
from .space import DesignError


class Requirement(Printed):
    """A requirement on a motion: an objective or a constraint."""

    def unreachable_by_disk(self) -> str:
        """Names what a requirement asks that a disk, which rolls along e1 and turns about e2, cannot do; empty if
        nothing.
        """
        return ""

    def impossible_in(self, radius: float) -> str:
        """Says what it requires, as a clause, that no body of this radius can fulfil; empty if nothing."""
        return ""


class OfFunction(Requirement):
    """A requirement by a user's function of (run, parameters)."""

    function: Callable[[Run, PyTree], Float[Array, "..."]] = eqx.field(static=True)
    parameters: PyTree = None

    def __check_init__(self):
        require_callable_with("function", self.function, self.parameters, "run")


class AbstractObjective(Requirement):
    """A dimensionless number that a design minimises: lengths in radii r, forces in weights M g, times in √(r/g).

    **Arguments:**

    - ``weight``: its weight in the sum of objectives, dimensionless. It can change without compiling again.
    """

    weight: Float[Array, ""] = eqx.field(converter=number(), default=1.0, kw_only=True)

    @abc.abstractmethod
    def __call__(self, run: Run) -> Float[Array, ""]:
        """Computes the value of the objective, without the weight."""

    def in_units(self, value: float, length: float, time: float) -> str:
        """Formats a value as the length, the angle or the time that it stands for; empty if it is none of them.

        ``length`` and ``time`` are r and √(r/g) in units of the scenario.
        """
        return ""


class AbstractRunningObjective(AbstractObjective):
    """The mean over the run of a function of the time and of the state and the actuation at that time.

    Optimal control can use only such objectives.
    """

    @abc.abstractmethod
    def integrand(self, run: Run) -> Float[Array, " t"]:
        """Evaluates the integrand at the times of the run."""

    def __call__(self, run: Run):
        return mean_in_time(run, self.integrand(run)[:, None])[0]


def mean_in_time(run: Run, values: Float[Array, "t k"]) -> Float[Array, " k"]:
    """Computes the means of k functions over the run by their values at its times, as ``integrate_samples`` does."""
    return integrate_samples(run.times, values, run.system.kinks()) / (run.times[-1] - run.times[0])


def evaluate_objectives(objectives: Iterable[AbstractObjective], run: Run) -> list[Float[Array, ""]]:
    """Evaluates objectives; those that are means over the run together, whose rule is the same."""
    objectives = list(objectives)
    means = [type(item).__call__ is AbstractRunningObjective.__call__ for item in objectives]
    values = [
        item.integrand(run)
        for item, is_mean in zip(objectives, means, strict=True)
        if is_mean and isinstance(item, AbstractRunningObjective)
    ]
    of_means = iter(mean_in_time(run, jnp.stack(values, axis=1)) if values else ())
    return [next(of_means) if is_mean else item(run) for item, is_mean in zip(objectives, means, strict=True)]


class AbstractConstraint(Requirement):
    """Signed violations, dimensionless: positive where violated, and at most 0 in a design that fulfils it.

    Lengths are in radii r, forces in weights M g, times in √(r/g).
    """

    @abc.abstractmethod
    def __call__(self, run: Run) -> Float[Array, "..."]:
        """Computes the violation at each point or time at which it is evaluated."""


class AbstractRunningConstraint(AbstractConstraint):
    """A constraint on the state and the actuation at each time, the only kind that optimal control can use."""

    def margins(self, run: Run) -> Float[Array, "t ..."]:
        """Evaluates a function that is nonnegative where the constraint holds, with second derivatives everywhere.

        Near the boundary it is minus the violation, to first order; by default, everywhere.
        """
        return -self(run)


def require_possible(radius: float, requirements: Mapping[str, Requirement]) -> None:
    """Refuses objectives and constraints that no body of a radius can meet, whatever the search finds.

    **Raises:** :class:`DesignError`, with the name of the first one.
    """
    for name, requirement in requirements.items():
        beyond = requirement.impossible_in(radius)
        if beyond:
            raise DesignError(
                f"`{name}` must be possible in a body of radius {radius:g}, but {beyond}; give a smaller one."
            )


def require_reachable(system: System, requirements: Mapping[str, Requirement]) -> None:
    """Refuses objectives and constraints that no disk can meet.

    **Raises:** :class:`DesignError`, with the name of the first one, where the system is a disk.
    """
    for name, requirement in requirements.items() if system.planar else ():
        beyond = requirement.unreachable_by_disk()
        if beyond:
            raise DesignError(
                f"`{name}` must be within reach of a disk, which rolls along e1 and turns about e2, but it requires "
                f"{beyond}; give positions as single numbers, or use a ball."
            )


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


class OfDiscs(Requirement):
    """A requirement on the distance of the geometric centre from discs in the plane."""

    centres: Float[Array, "k 2"] = eqx.field(converter=places("centres"))
    radii: Float[Array, " k"] = eqx.field(converter=number(LENGTH, POSITIVE))

    def unreachable_by_disk(self):
        return off_e1(self.centres)


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


class OfCurve(Requirement):
    """A requirement on the distance of the geometric centre from a curve."""

    curve: AbstractCurve

    def unreachable_by_disk(self):
        return off_e1(self.curve.spanning_vectors())


class Sigmoid(AbstractCurve):
    """From ``origin`` over ``length`` along e1, and over ``height`` along e2 by a logistic function, half way at s = ½.

    c = origin + (length s, height (σ(k (s − ½)) − σ(−k/2)) / (σ(k/2) − σ(−k/2))) with σ(x) = 1 / (1 + exp(−x)) and
    k = ``steepness``.

    **Arguments:**

    - ``length``: the extent along e1, length.
    - ``height``: the extent along e2, 0 for a disk, length.
    - ``steepness``: k in the logistic function of k (s − ½), dimensionless.
    - ``origin``: c(0), a single number for a disk, length, shape (2,).

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.studies.design import Sigmoid
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

    - ``length``: the extent along e1, length.
    - ``height``: the extent along e2, 0 for a disk, length.
    - ``origin``: c(0), a single number for a disk, length, shape (2,).

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.studies.design import FigureEight
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

    - ``through``: the points, two or more, single numbers for a disk, length, shape (n, 2).

    **Raises:** ``ValueError`` for another shape, and :class:`DesignError` for fewer than two points.

    **Example:**

    >>> from jaxball.studies.design import Through
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
