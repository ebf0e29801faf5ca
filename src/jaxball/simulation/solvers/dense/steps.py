"""The steps of a solve in its dense output, and functions of time within them, by polynomials through a few values.

There may be pauses, where a step begins later than the one before it has ended. A body that slips or rolls ever more
slowly is followed to its end by one formula, not by ever shorter steps. That takes a short time, the pause, in which
the state moves along a straight line as nearly as the tolerance asks.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PyTree

LOBATTO_NODES = 5
FINENESS = 32
# The half width of the next window, relative to this one: a few times the error of a quartic.
NARROWER = 1 / 12
# Of windows in which a maximum is sought, relative to all of its piece; the last one has the tangent of the motion.
WINDOW_SIZES = (1.0, NARROWER, NARROWER**2, NARROWER**3, NARROWER**4, NARROWER**2)
CURVATURE_ROUND, ROUNDINGS_OF_PEAK = 2, 8


class Pause(NamedTuple):
    """What came between a step and the one before it.

    - ``before``: the vector with which the step before ended, at the time ``t0`` of a :class:`StepAfterPause`.
    - ``until``: the vector at the end of the pause, still in the mode of the step before.
    - ``start``: the time at which the pause ends and the step begins.
    """

    before: Float[Array, "*steps size"]
    until: Float[Array, "*steps size"]
    start: Float[Array, "*steps"]

    @classmethod
    def empty(cls, like: Float[Array, " size"], steps: int) -> "Pause":
        """Makes room for the pauses before ``steps`` steps."""
        vectors = jnp.zeros((steps, *like.shape), like.dtype)
        return cls(vectors, vectors, jnp.full(steps, -jnp.inf, like.dtype))


class StepAfterPause(diffrax.AbstractLocalInterpolation):
    """The dense output of a step with that of the pause before it, which begins at ``t0``."""

    t0: Any
    t1: Any
    pause: Pause
    step: diffrax.AbstractLocalInterpolation

    def evaluate(self, t0, t1=None, left=True):
        if t1 is not None:
            return self.evaluate(t1, left=left) - self.evaluate(t0, left=left)
        before, until, start = self.pause
        pauses = t0 < start
        # A step after a kink begins one number behind it, and a time that is asked for may be that of the kink itself.
        length = jnp.where(start > self.t0, start - self.t0, 1.0)
        on_line = before + ((t0 - self.t0) / length) * (until - before)
        return jnp.where(pauses, on_line, self.step.evaluate(jnp.where(pauses, start, t0), left=left))


class AfterPauses(NamedTuple):
    """Makes the dense output of a step after a pause, like an interpolation class."""

    interpolation: Callable[..., diffrax.AbstractLocalInterpolation]

    def __call__(self, *, t0: Array, t1: Array, pause: Pause, info: Any) -> StepAfterPause:
        return StepAfterPause(t0, t1, pause, self.interpolation(t0=pause.start, t1=t1, **info))


class Steps(eqx.Module):
    """Steps, of which the first ``count`` were taken, and the data of their dense output.

    ``start`` and ``end`` are their times without derivatives; ``end`` lies a little before the end of a step, so
    that a kink there is seen from before. ``times`` and ``until``, where the last one is cut off, have derivatives.
    """

    start: Float[Array, " steps"]
    end: Float[Array, " steps"]
    until: Float[Array, ""]
    count: Int[Array, ""]
    times: Float[Array, " steps_and_one"]
    infos: PyTree[Float[Array, "steps ..."]]
    interpolation: Callable[..., diffrax.AbstractLocalInterpolation] = eqx.field(static=True)

    @classmethod
    def of(cls, solution: Any, until: Float[Array, ""], room: int | None = None) -> "Steps":
        """Returns the steps of a solution with dense output, or the first ``room`` of them, cut off at ``until``."""
        dense = solution.interpolation
        room = int(dense.ts.size) - 1 if room is None else room
        times = dense.ts[: room + 1]
        fixed, last = jax.lax.stop_gradient((times, until))
        start, end = fixed[:-1], jnp.minimum(fixed[1:], last)
        end = last_within(start, end)
        count = jnp.sum((start < last) & (jnp.arange(start.size) < dense.ts_size - 1))
        return cls(
            start,
            end,
            until,
            count,
            times,
            jax.tree.map(lambda leaf: leaf[:room], dense.infos),
            dense.interpolation_cls,
        )

    @property
    def taken(self) -> Bool[Array, " steps"]:
        """Which of them were taken."""
        return jnp.arange(self.start.size) < self.count

    @property
    def resumed(self) -> Float[Array, " steps"] | None:
        """The times, without derivatives, at which the pauses before steps end; None where there can be no pause."""
        if isinstance(self.interpolation, AfterPauses):
            return jnp.clip(jax.lax.stop_gradient(self.infos["pause"].start), self.start, self.end)
        return None

    def ends(self, index: Int[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Returns the start and the end of a step, with derivatives; the start is the end of a pause before it."""
        begins, end = self.times[:-1], self.times[index + 1]
        if isinstance(self.interpolation, AfterPauses):
            begins = self.infos["pause"].start
            # Where a mode ends, the next step begins at the time of the event, which has its derivatives.
            follows = begins[jnp.minimum(index + 1, begins.size - 1)]
            event = jnp.where(index + 1 < self.count, follows, end)
            end += event - jax.lax.stop_gradient(event)
        return begins[index], jnp.where(end < self.until, end, self.until)

    def step(self, index: Int[Array, ""]) -> diffrax.AbstractLocalInterpolation:
        """Returns the dense output of one step."""
        info = jax.tree.map(lambda leaf: leaf[index], self.infos)
        return self.interpolation(t0=self.times[index], t1=self.times[index + 1], **info)

    def state(self, index: Int[Array, ""], t: Float[Array, ""]) -> Float[Array, " size"]:
        """Returns the vector of the state at a time within a step."""
        return self.step(index).evaluate(t)


class Sampling(NamedTuple):
    """Where in a step a function is evaluated: the Gauss–Lobatto fractions of it, which include both ends.

    ``matrix`` takes the values at these nodes to those of the polynomial through them at the ``fractions``, among
    which the nodes are; ``powers`` takes them to its coefficients, the lowest first, with the step as unit of time.
    """

    nodes: np.ndarray
    fractions: np.ndarray
    matrix: np.ndarray
    powers: np.ndarray

    def polynomials(self, samples: Float[Array, "*steps nodes"]) -> Float[Array, "*steps fractions"]:
        """Computes the values of the polynomials at the fractions; exact at the nodes."""
        return jnp.einsum("...n,fn->...f", samples, jnp.asarray(self.matrix, samples.dtype))

    def rates(
        self, samples: Float[Array, "*steps nodes"], fraction: Float[Array, "*steps"]
    ) -> tuple[Float[Array, "*steps"], Float[Array, "*steps"]]:
        """Computes the first and the second derivative of the polynomials at any fraction."""
        _, a1, a2, a3, a4 = jnp.einsum("...n,mn->m...", samples, jnp.asarray(self.powers, samples.dtype))
        u = fraction
        return a1 + u * (2 * a2 + u * (3 * a3 + u * 4 * a4)), 2 * a2 + u * (6 * a3 + u * 12 * a4)


@cache
def sampling() -> Sampling:
    """Returns the nodes of Gauss–Lobatto, the zeros of (1 − x²) P′, and 32 equal parts of a step."""
    inner = np.real(np.polynomial.legendre.Legendre.basis(LOBATTO_NODES - 1).deriv().roots())
    nodes = np.concatenate([[0.0], 0.5 + 0.5 * inner, [1.0]])
    fractions = np.union1d(nodes, np.linspace(0.0, 1.0, FINENESS + 1))
    matrix = np.array([[_lagrange(nodes, k, x) for k in range(LOBATTO_NODES)] for x in fractions])
    return Sampling(nodes, fractions, matrix, np.linalg.inv(np.vander(nodes, increasing=True)))


def last_within(start: Float[Array, "*steps"], end: Float[Array, "*steps"]) -> Float[Array, "*steps"]:
    """Returns the last time of a step: a little before its end, so that a kink there is seen from before."""
    return jnp.maximum(start, end - 4 * float(np.finfo(end.dtype).eps) * jnp.abs(end))


def place_of_largest(
    value: Callable[[Float[Array, ""], Float[Array, " size"]], Float[Array, ""]],
    states: Callable[[Float[Array, ""]], Float[Array, " size"]],
    field: Callable[[Float[Array, ""], Float[Array, " size"]], Float[Array, " size"]],
    first: Float[Array, ""],
    last: Float[Array, ""],
) -> Float[Array, ""]:
    """Finds where a function of time and vector is largest between ``first`` and ``last``, in ever narrower windows.

    In each window by the quartic through five values, or, where one of them is not finite, at the largest of them.
    Finally the rate along the motion is solved for its zero: the place of a maximum is accurate to half the digits,
    that of a zero to all.

    - ``states``: the vectors at times, without derivatives; ``field``: their rates.
    """
    grid = sampling()
    nodes, fractions, matrix, shares = (
        jnp.asarray(x, first.dtype) for x in (grid.nodes, grid.fractions, grid.matrix, WINDOW_SIZES)
    )

    def narrower(r: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        (t, curvature), whole = carry, last - first
        low, high = jnp.maximum(t - shares[r] * whole, first), jnp.minimum(t + shares[r] * whole, last)
        width = jnp.where(high > low, high - low, 1.0)
        is_line, here = r == len(WINDOW_SIZES) - 1, states(t)
        rates = field(t, here)

        def sample(node: Array) -> Array:
            time = low + node * (high - low)
            # In the last round along the tangent of the motion: the slope of the dense output is less accurate than its
            # values, and the zero of a rate would be off by as much.
            return value(time, jnp.where(is_line, here + (time - t) * rates, states(time)))

        samples = jax.lax.map(sample, nodes)
        fine = jnp.sum(matrix * samples[None], axis=1)
        # The first of those that are the largest but for rounding, so that one at the start of a run is not next to it.
        most = jnp.max(fine)
        rounding = ROUNDINGS_OF_PEAK * float(jnp.finfo(fine.dtype).eps) * jnp.abs(most)
        best = jnp.min(jnp.where(fine >= most - rounding, fractions, jnp.inf))
        # A value that is not a number must not be passed over in silence: it counts as the largest.
        sizes = jnp.where(jnp.isnan(samples), jnp.inf, samples)
        largest = jnp.min(jnp.where(sizes == jnp.max(sizes), nodes, jnp.inf))
        finite = jnp.all(jnp.isfinite(samples))
        slope, bend = grid.rates(samples, jnp.where(is_line, (t - low) / width, best))
        shift = -slope / (width * jnp.where(curvature < 0, curvature, 1.0))
        moves = finite & (curvature < 0) & (jnp.abs(shift) <= NARROWER**3 * whole) & (t > first) & (t < last)
        zero = jnp.clip(jnp.where(moves, t + shift, t), first, last)
        seen = jnp.where(r == CURVATURE_ROUND, jnp.where(finite & (bend < 0), bend / width**2, 0.0), curvature)
        return jnp.where(is_line, zero, low + (high - low) * jnp.where(finite, best, largest)), seen

    return jax.lax.fori_loop(0, len(WINDOW_SIZES), narrower, (first, jnp.zeros_like(first)))[0]


def _lagrange(nodes: np.ndarray, k: int, x: float) -> float:
    others = np.delete(nodes, k)
    return float(np.prod((x - others) / (nodes[k] - others)))
