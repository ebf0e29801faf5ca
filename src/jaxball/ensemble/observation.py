"""What is observed in the runs of an ensemble: the states at saved times, and what reductions need."""

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import diffrax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..numerics.batches import map_batches
from ..physics.packing import Packing
from ..solvers.dense.continuous import ContinuousMethod, continuous
from .extremes import Extremes
from .observers import AbstractObserver, Integrals, Saves
from .parameters import Prepared
from .quantities import values as values_of
from .reductions import AbstractReduction, Observed, Quantity
from .runge_kutta import Between, Step, exact, interpolation, step, tableau_of

SAVES, EXTREMES, INTEGRALS = "saves", "extremes", "integrals"


class Observation(NamedTuple):
    """Observers by what they find, what each of them is given, and the reductions that are made of it.

    ``between`` interpolates steps. States ``within`` them that are as exact as those at their ends need more slopes;
    None where no observer asks for such states.
    """

    observers: dict[str, AbstractObserver]
    given: dict[str, Any]
    reductions: tuple[tuple[str, AbstractReduction], ...]
    quantities: tuple[Quantity, ...]
    values: Prepared | None
    between: Between
    within: ContinuousMethod | None = None

    @classmethod
    def of(
        cls,
        solver: diffrax.AbstractERK,
        reductions: tuple[tuple[str, AbstractReduction], ...],
        prepared: Callable[[Callable[..., Any]], Prepared],
        state: Any,
        field: Prepared,
        times: Float[Array, "rows times"],
        x: Float[Array, "rows size"],
    ) -> "Observation":
        """For runs that start at ``x``, with states in the form of ``state``.

        ``prepared`` takes a function of (system, t, vector) to its program for all runs.
        """
        size = x.shape[1]
        between, between_exactly = interpolation(solver, size, x.dtype), exact(solver, size, x.dtype)
        observers: dict[str, AbstractObserver] = {}
        given: dict[str, Any] = {}
        if times.shape[1] > 2:
            observers[SAVES], given[SAVES] = Saves(between_exactly, size), times[:, 1:-1].T
        quantities = tuple(dict.fromkeys(item.quantity for _, item in reductions))
        if not quantities:
            return cls(observers, given, reductions, quantities, None, between, _asked_for(solver, observers))
        values = prepared(functools.partial(_values, quantities, state))
        searches = [(quantities.index(item.quantity), sign) for _, item in reductions for sign in item.signs]
        if searches:
            which, signs = zip(*searches, strict=True)
            recompute = functools.partial(_recomputed, solver, field)
            found = Extremes(values, between, between_exactly, which, signs, recompute, size)
            observers[EXTREMES], given[EXTREMES] = found, values.own
        if any(item.is_integral for _, item in reductions):
            observers[INTEGRALS], given[INTEGRALS] = Integrals(values, between_exactly, len(quantities)), values.own
        return cls(observers, given, reductions, quantities, values, between, _asked_for(solver, observers))

    def saved(self, observed: dict[str, Any], x: Float[Array, "rows size"]) -> Float[Array, "rows between size"]:
        """The vectors at the times between the first, at which they are ``x``, and the last."""
        return jnp.moveaxis(observed[SAVES].states, -1, 0) if SAVES in observed else x[:, None][:, :0]

    def reduced(
        self,
        observed: dict[str, Any],
        of_field: Float[Array, "numbers rows"],
        t0: Float[Array, " rows"],
        x: Float[Array, "size rows"],
        lanes: int,
    ) -> dict[str, Float[Array, " rows"]]:
        """What the reductions report, by name; searches are made for ``lanes`` runs at a time."""
        if self.values is None:
            return {}
        nothing = jnp.full((len(self.quantities), t0.size), jnp.nan, t0.dtype)
        needs_start = any(item.needs_start for _, item in self.reductions)
        start = self.values(self.values.own, t0, x) if needs_start else nothing
        integrals = observed.get(INTEGRALS, nothing)
        best = iter(self._extremes(observed, of_field, lanes))
        reports = {}
        for name, item in self.reductions:
            k = self.quantities.index(item.quantity)
            own = [next(best) for _ in item.signs]
            report = item.result(Observed(start[k], tuple(v for v, _ in own), tuple(t for _, t in own), integrals[k]))
            reports |= {name + end: value for end, value in report.items()}
        return reports

    def _extremes(
        self, observed: dict[str, Any], of_field: Float[Array, "numbers rows"], lanes: int
    ) -> list[tuple[Float[Array, " rows"], Float[Array, " rows"]]]:
        """The value and the time of each search."""
        observer = self.observers.get(EXTREMES)
        if not isinstance(observer, Extremes):
            return []
        rows = (observed[EXTREMES], self.given[EXTREMES], of_field)
        values, times = map_batches(lambda part: observer.refined(*part), rows, lanes)
        return [(sign * value, time) for sign, value, time in zip(observer.signs, values, times, strict=True)]


def _asked_for(solver: diffrax.AbstractERK, observers: dict[str, AbstractObserver]) -> ContinuousMethod | None:
    """What steps need for observers that ask for states within them while they are taken."""
    return continuous(solver) if SAVES in observers or INTEGRALS in observers else None


def _recomputed(solver: diffrax.AbstractERK, field: Prepared, own: Any, start: Array, end: Array, x: Array) -> Step:
    fresh = jnp.ones(start.shape, bool)
    of_row = functools.partial(field, own)
    return step(tableau_of(solver), of_row, start, end, x, jnp.zeros_like(x), fresh, continuous(solver), True)


def _values(
    quantities: Sequence[Quantity], like: Any, system: Any, t: Float[Array, ""], x: Float[Array, " size"]
) -> Float[Array, " k"]:
    """The quantities of one run, of its vector."""
    prepared = system.prepare()
    return values_of(quantities, prepared, t, Packing.of(prepared, like).unpack(t, x))
