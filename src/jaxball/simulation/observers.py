"""Finds extreme values and integrals in the steps of a run while it is computed, so that only a few numbers are kept.

The loop of a solve passes each step on to it; the reductions of an ensemble are made from its results.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..numerics.arrays import entry
from ..numerics.calculus import move_to_peak, with_second_derivatives
from ..physics.packing import Packing
from ..programs.batches import fill_vectors
from .solvers.dense.integrals import Accuracy, Running, integrate
from .solvers.dense.peaks import Peaks, search
from .solvers.dense.steps import last_within, place_of_largest

# Times the power 2/3 of the tolerance: the error of states within a step by the solver's own interpolation, relative to
# values. What these vary by less is no peak that could be seen.
NEGLIGIBLE_SHARE = 5.0
ASIDE = 1 / 16  # of a piece, by which the search for its peak goes beyond it
# From a time and a vector to the vector of the state, and to quantities.
Between = Callable[[Float[Array, ""]], Float[Array, " size"]]
Quantities = Callable[[Float[Array, ""], Float[Array, " size"]], Float[Array, " k"]]
Field = Callable[[Float[Array, ""], Float[Array, " size"]], Float[Array, " size"]]
Run = tuple[Float[Array, ""], Float[Array, ""]]  # the times between which it is


def visible(rtol: Float[Array, ""]) -> Float[Array, ""]:
    """Returns what quantities must vary by, relative to their values, to be seen in states by a solver's own
    interpolation.
    """
    return NEGLIGIBLE_SHARE * jnp.cbrt(rtol) ** 2


class Observation(NamedTuple):
    """The results to find for a run; a program is compiled for them.

    - ``quantities``: functions, of which ``evaluate(quantities, system, t, state)`` gives the values.
    - ``searches``: the quantities, by index, whose largest values are sought, and their factors.
    - ``integrals``: the quantities, by index, that are integrated.
    """

    evaluate: Callable[..., Float[Array, " k"]]
    quantities: tuple[Callable[..., Any], ...]
    searches: tuple[tuple[int, float], ...] = ()
    integrals: tuple[int, ...] = ()


def _evaluate(
    observation: Observation, packing: Packing[Any, Any], t: Float[Array, ""], x: Float[Array, " size"]
) -> Float[Array, " k"]:
    """Evaluates the quantities for a vector."""
    return observation.evaluate(observation.quantities, packing.system, t, packing.unpack(t, x))


class Step(NamedTuple):
    """A step: its start, with the vector there, its end, and the vectors within it.

    ``between`` costs nothing; ``exact`` is nearly as accurate as the step, at some cost. That goes back to the time
    ``begin``, earlier than the start where a pause came before the step, and None where there can be none.
    """

    start: Float[Array, ""]
    end: Float[Array, ""]
    x: Float[Array, " size"]
    between: Between
    exact: Between
    begin: Float[Array, ""] | None = None

    def times(self, places: Float[Array, " n"]) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """Returns the times at places, 0 to 1 in the pause before the step and 1 to 2 in the step, and their rates."""
        length = self.end - self.start
        times, rates = self.start + (places - 1) * length, jnp.broadcast_to(length, places.shape)
        if self.begin is None:
            return times, rates
        pause = self.start - self.begin
        pauses = places < 1
        return jnp.where(pauses, self.begin + places * pause, times), jnp.where(pauses, pause, rates)


class Seen(NamedTuple):
    """The pieces of steps in which quantities are largest, and their integrals; None for what is not requested."""

    best: Peaks | None
    integrals: Running | None


class Found(NamedTuple):
    """The results of a run: values at the start, the largest values and when they occur, integrals."""

    start: Float[Array, " k"]
    extremes: tuple[Float[Array, ""], ...]
    times: tuple[Float[Array, ""], ...]
    integrals: Float[Array, " k"]


class Observers:
    """Observe each step of one run for an :class:`Observation`, by vectors of a ``packing``.

    Integrals are as exact as the tolerances ``rtol`` and ``atol`` of the run. What quantities vary by less than
    ``negligible``, relative to their values, is no peak that could be seen.
    """

    def __init__(
        self,
        observation: Observation,
        packing: Packing[Any, Any],
        rtol: Float[Array, ""],
        atol: Float[Array, ""],
        negligible: Float[Array, ""],
    ) -> None:
        # Compiled on its own, it is traced once.
        quantities = jax.tree_util.Partial(jax.jit(functools.partial(_evaluate, observation)), packing)
        field, self._kinks = packing.field, packing.system.kinks()
        self.needs_exact, self._integrated = bool(observation.integrals), observation.integrals
        self._rtol, self._atol, self._negligible = rtol, atol, negligible
        self._which = tuple(which for which, _ in observation.searches)
        self._signs = tuple(sign for _, sign in observation.searches)
        self._quantities, self._field, self._count = quantities, field, len(observation.quantities)

    def begin(self, x: Float[Array, " size"]) -> Seen:
        """Returns the observations before the first step, from ``x``."""
        best, integrals = None, None
        if self._which:
            best = Peaks.none(len(self._which), x)
        if self.needs_exact:
            integrals = Running.none(len(self._integrated), x)
        return Seen(best, integrals)

    def observe(self, seen: Seen, step: Step, run: Run, kept: Bool[Array, ""], *, reverse: bool) -> Seen:
        """Returns the observations after a step, if that was ``kept``.

        - ``run``: the times between which the run is.
        - ``reverse``: whether derivatives are those of reverse mode, or else those of forward mode.
        """
        best, integrals = seen
        if best is not None:
            best = self._search(best, step, run, kept)
        if integrals is not None:
            integrals = self._integrate(integrals, step, run, kept, reverse=reverse)
        return Seen(best, integrals)

    def results(
        self,
        seen: Seen,
        start: Float[Array, ""],
        x: Float[Array, " size"],
        again: Callable[[Array, Array, Array], Step],
    ) -> Found:
        """Computes the results of a run from ``start``, where it is at ``x``. ``again`` recomputes a step.

        Of a run without a step, extremes are NaN.
        """
        unknown = jnp.full(self._count, jnp.nan, x.dtype)
        values, times = self.extremes(seen.best, again) if seen.best is not None else ((), ())
        integrals = unknown
        if seen.integrals is not None:
            integrals = unknown.at[jnp.asarray(self._integrated)].set(seen.integrals.total)
        return Found(self._quantities(start, x), tuple(values), tuple(times), integrals)

    def _search(self, peaks: Peaks, step: Step, run: Run, kept: Bool[Array, ""]) -> Peaks:
        """Finds the peaks after a step, if that was ``kept``."""
        last = last_within(step.start, step.end)

        def sample(fraction: Float[Array, ""]) -> Float[Array, " k"]:
            t = jnp.minimum(step.start + fraction * (step.end - step.start), last)
            return self._sign(t, step.between(t))

        def functions(fractions: Float[Array, " n"]) -> Float[Array, "n k"]:
            # They only decide which pieces are looked at again when the run has ended, with derivatives.
            return jax.lax.stop_gradient(jax.lax.map(sample, fractions))

        of_step = step.start, step.end, step.x
        return search(functions, peaks, of_step, run[1] - run[0], jax.lax.stop_gradient(self._negligible), kept)

    def _integrate(self, running: Running, step: Step, run: Run, kept: Bool[Array, ""], *, reverse: bool) -> Running:
        """Adds the integrals over a step, and over the pause before it, if that was ``kept``."""
        dtype = step.x.dtype
        begin = step.start if step.begin is None else step.begin
        pause = step.start - begin
        # Where there was none, a step may begin one number behind the one before.
        paused = pause > 4 * float(jnp.finfo(dtype).eps) * jnp.abs(step.start)
        start = jnp.where(kept, jnp.where(paused, 0.0, 1.0), 2.0).astype(dtype)
        lengths = jnp.stack([pause, step.end - step.start])
        accuracy = Accuracy(self._rtol, self._atol, lengths, begin - run[0], run[1] - run[0])

        def values(t: Float[Array, ""]) -> Float[Array, " k"]:
            quantities = self._quantities(t, step.exact(t))
            return jnp.stack([quantities[k] for k in self._integrated])

        def functions(places: Float[Array, " n"]) -> Float[Array, "n k"]:
            times, rates = step.times(places)
            return rates[:, None] * fill_vectors(values, times)

        return integrate(functions, start, running, accuracy, reverse=reverse)

    def _sign(
        self, t: Float[Array, ""], x: Float[Array, " size"], quantities: Quantities | None = None
    ) -> Float[Array, " k"]:
        values = (self._quantities if quantities is None else quantities)(t, x)
        return jnp.stack([sign * values[k] for k, sign in zip(self._which, self._signs, strict=True)])

    def _at_peak(
        self,
        quantities: Quantities,
        field: Field,
        k: Array,
        step: Step,
        t: Float[Array, ""],
        length: Float[Array, ""],
    ) -> Float[Array, ""]:
        """Computes the largest value at a time in a step of some ``length``, with its second derivatives."""

        def value(t: Float[Array, ""], x: Float[Array, " size"]) -> Float[Array, ""]:
            return entry(k, self._sign(t, x, quantities))

        return value(*move_to_peak(field, value, t, step.exact(t), length))

    def _moves_with(
        self, step: Step, t: Float[Array, ""], at_start: Bool[Array, ""], at_end: Bool[Array, ""]
    ) -> Float[Array, ""]:
        """Returns 0, with the derivatives of the time in a step at which a quantity is largest.

        Within a step it has none. At an end of the step, where the quantity may be largest because it jumps or because
        the run ends, they are those of the kink there, or else of that end.
        """
        kinks, fixed = self._kinks.astype(t.dtype), jax.lax.stop_gradient
        near = 16 * float(jnp.finfo(t.dtype).eps) * jnp.maximum(jnp.abs(t), 1.0)
        at_kink = (jnp.abs(fixed(kinks) - t) <= near) & (at_start | at_end)
        kink = jnp.sum(jnp.where(at_kink & (jnp.cumsum(at_kink) == 1), kinks - fixed(kinks), 0.0))
        end = jnp.where(at_end, step.end, jnp.where(at_start, step.start, 0.0))
        return jnp.where(jnp.any(at_kink), kink, end - fixed(end))

    def extremes(self, best: Peaks, again: Callable[[Array, Array, Array], Step]) -> tuple[Array, Array]:
        """Computes the largest values, and when they occur, from the pieces of steps in which they are."""
        count = len(self._which)

        # A loop, because the quantities are a long program that is to be compiled few times.
        def search(place: Array) -> tuple[Array, Array]:
            rank, k = place // count, place % count
            step = again(best.start[rank, k], best.end[rank, k], best.x[rank, k])

            def at(t: Float[Array, ""]) -> Float[Array, ""]:
                return self._sign(t, step.exact(t))[k]

            # A maximum does not change to first order as its place does.
            first, last = jax.lax.stop_gradient((step.start, last_within(step.start, step.end)))
            low, high = best.low[rank, k], best.high[rank, k]
            aside, length = ASIDE * (high - low), last - first
            low, high = (first + jnp.clip(place, 0.0, 1.0) * length for place in (low - aside, high + aside))
            fixed = jax.lax.stop_gradient
            t = place_of_largest(
                lambda t, x: fixed(self._sign(t, x)[k]),
                lambda t: fixed(step.exact(t)),
                lambda t, x: fixed(self._field(t, x)),
                low,
                high,
            )
            t += self._moves_with(step, t, t <= first, t >= last)
            operands = self._quantities, self._field, k, step, t, length
            return with_second_derivatives(at(t), "largest and smallest values of a run", self._at_peak, *operands), t

        values, times = (x.reshape(2, count) for x in jax.lax.map(search, jnp.arange(2 * count)))
        unseen = jnp.where(jnp.isnan(best.value), jnp.nan, -jnp.inf)
        values = jnp.where(best.value > -jnp.inf, values, unseen)
        second = values[1] > values[0]
        value, time = jnp.where(second, values[1], values[0]), jnp.where(second, times[1], times[0])
        seen, signs = value > -jnp.inf, jnp.asarray(self._signs, value.dtype)
        return jnp.where(seen, signs * value, jnp.nan), jnp.where(seen, time, jnp.nan)
