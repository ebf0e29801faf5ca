"""What is looked at in the runs of an ensemble: the states at saved times, and what reductions need."""

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import diffrax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..lanes import LaneProgram
from ..packing import Packing
from .extremes import Extremes
from .integrals import Integrals
from .interpolation import interpolation
from .numbers import Prepared
from .observers import AbstractObserver
from .parts import in_parts
from .reductions import AbstractReduction, Found, Quantity
from .runge_kutta import step, tableau_of
from .saves import Saves


class Watched(NamedTuple):
    """Observers by what they find, what each of them is given, and the reductions that are made of it."""

    observers: tuple[AbstractObserver, ...]
    given: tuple[Any, ...]
    reductions: tuple[tuple[str, AbstractReduction], ...]
    quantities: tuple[Quantity, ...]
    values: Prepared | None
    empty: Float[Array, "rows 0 size"]

    @classmethod
    def of(
        cls,
        solver: diffrax.AbstractERK,
        reductions: tuple[tuple[str, AbstractReduction], ...],
        like: Any,
        system: Any,
        shared: Sequence[bool],
        field: Prepared,
        times: Float[Array, "rows times"],
        x: Float[Array, "rows size"],
    ) -> "Watched":
        """For runs of systems ``like`` the one given, which start at ``x``."""
        rows, size = x.shape
        between = interpolation(solver, size, x.dtype)
        observers: list[AbstractObserver] = []
        given: list[Any] = []
        if times.shape[1] > 2:
            observers.append(Saves(between, size))
            given.append(times[:, 1:-1].T)
        quantities = tuple(dict.fromkeys(item.quantity for _, item in reductions))
        values = _values(quantities, like, system, shared, x) if quantities else None
        searches = [(quantities.index(item.quantity), sign) for _, item in reductions for sign in item.signs]
        if searches:
            assert values is not None
            which, signs = zip(*searches, strict=True)

            def again(moving, start, end, x):
                slope = functools.partial(field, moving)
                return step(tableau_of(solver), slope, start, end, x, slope(start, x))

            observers.append(Extremes(values, between, which, signs, again, size))
            given.append(values.moving)
        if any(item.is_integral for _, item in reductions):
            assert values is not None
            observers.append(Integrals(values, between, len(quantities)))
            given.append(values.moving)
        return cls(tuple(observers), tuple(given), reductions, quantities, values, jnp.zeros((rows, 0, size), x.dtype))

    def saved(self, observed: tuple[Any, ...]) -> Float[Array, "rows between size"]:
        """The vectors at the times between the first and the last."""
        for observer, seen in zip(self.observers, observed, strict=True):
            if isinstance(observer, Saves):
                return jnp.moveaxis(seen.states, -1, 0)
        return self.empty

    def reduced(
        self,
        observed: tuple[Any, ...],
        of_field: Float[Array, "numbers rows"],
        t0: Float[Array, " rows"],
        x: Float[Array, "size rows"],
        lanes: int,
    ) -> dict[str, Float[Array, " rows"]]:
        """What the reductions report, by name; searches are made for ``lanes`` runs at a time."""
        if self.values is None:
            return {}
        start = integrals = jnp.full((len(self.quantities), t0.size), jnp.nan, t0.dtype)
        if any(item.needs_start for _, item in self.reductions):
            start = self.values(self.values.moving, t0, x)
        best = iter(())
        for observer, seen, given in zip(self.observers, observed, self.given, strict=True):
            if isinstance(observer, Extremes):
                found, times = in_parts(lambda part, of=observer: of.refined(*part), (seen, given, of_field), lanes)
                signs = np.asarray(observer.signs)[:, None].astype(found.dtype)
                best = zip(found * signs, times, strict=True)
            if isinstance(observer, Integrals):
                integrals = seen
        reports = {}
        for name, item in self.reductions:
            k = self.quantities.index(item.quantity)
            own = [next(best) for _ in item.signs]
            report = item.result(Found(start[k], tuple(v for v, _ in own), tuple(t for _, t in own), integrals[k]))
            reports |= {name + end: value for end, value in report.items()}
        return reports


def _values(
    quantities: Sequence[Quantity], like: Any, system: Any, shared: Sequence[bool], x: Float[Array, "rows size"]
) -> Prepared:
    """The program of all quantities, with what they need of each run's numbers."""

    def of_one(system, t, x):
        prepared = system.prepare()
        state = Packing.of(prepared, like[1]).unpack(t, x)
        return jnp.stack([quantity(prepared, t, state) for quantity in quantities])

    number, vector = np.zeros((), x.dtype), np.zeros(x.shape[1:], x.dtype)
    return Prepared.of(LaneProgram(of_one, like[0], number, vector), system, shared, x.shape[0])
