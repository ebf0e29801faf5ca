"""Many runs as one program that maps a single run over them, for a compiler that has lanes of its own.

The native compiler computes the turns of a ``jax.lax.map`` side by side, in the lanes of vectors. So the runs are those
of :func:`jaxball.simulate`, with all its features; XLA would compute one after the other.
"""

import functools
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..interface.status import Status
from ..native import FEWEST, LANES
from ..numerics import programs
from ..physics.body_on_plane import BodyOnPlane
from ..simulation.history import slips
from ..simulation.observers import Found, Observation
from ..simulation.simulate import Method, solve
from .program import Settings
from .quantities import values
from .reductions import AbstractReduction, Observed, Quantity

# How many runs a program takes at a time by default.
BLOCK = 512


def filled(block: int) -> int:
    """A number of runs that fills vectors: with fewer, the compiler would use none, and results differ by rounding."""
    return max(FEWEST, -(-block // LANES)) * LANES


@functools.cache
def compiled(settings: Settings) -> programs.Program:
    """The program, which takes and gives what that of :mod:`.program` does; ``lanes`` of the settings do not matter."""
    return programs.jit(functools.partial(_solve, settings))


def _solve(settings: Settings, parameters: Any, times: Array, rtol: Array, atol: Array) -> Any:
    leaves, structure = jax.tree.flatten(parameters)
    own = [leaf for leaf, shared in zip(leaves, settings.shared, strict=True) if not shared]
    method = Method(
        solver=settings.solver,
        adjoint=diffrax.ForwardMode(),
        progress=diffrax.NoProgressMeter(),
        max_steps=settings.max_steps,
        inside=settings.inside,
        observation=_observation(settings.reductions),
    )

    def run(row: Any) -> Any:
        own, times, rtol, atol = row
        following = iter(own)
        whole = [leaf if shared else next(following) for leaf, shared in zip(leaves, settings.shared, strict=True)]
        system, state = structure.unflatten(whole)
        saved, reached, status, steps, rejected, _, course, found = solve(method, system, times, state, rtol, atol, {})
        contact = None
        if isinstance(system, BodyOnPlane):
            contact = *slips(system.prepare(), times, saved), *course
        reported = _reports(settings.reductions, found)
        reported = {name: jnp.where(status == Status.IMPOSSIBLE, jnp.nan, value) for name, value in reported.items()}
        return saved, reached, status, steps, rejected, contact, reported

    *results, reported = jax.lax.map(run, (own, times, rtol, atol))
    return *results, reported, _executed(results[3])


def _executed(steps: Array) -> Array:
    """The steps of all lanes: those that go on together end with the last of them."""
    groups = jnp.pad(steps, (0, -steps.size % LANES)).reshape(-1, LANES)
    return LANES * jnp.sum(jnp.max(groups, axis=1))


def _observation(reductions: tuple[tuple[str, AbstractReduction], ...]) -> Observation | None:
    if not reductions:
        return None
    quantities = _quantities(reductions)
    searches = [(quantities.index(item.quantity), sign) for _, item in reductions for sign in item.signs]
    return Observation(values, quantities, tuple(searches), any(item.is_integral for _, item in reductions))


def _quantities(reductions: tuple[tuple[str, AbstractReduction], ...]) -> tuple[Quantity, ...]:
    return tuple(dict.fromkeys(item.quantity for _, item in reductions))


def _reports(reductions: tuple[tuple[str, AbstractReduction], ...], found: Found | None) -> dict[str, Array]:
    """What the reductions report of one run, by name."""
    if found is None:
        return {}
    quantities, reports = _quantities(reductions), {}
    extremes = iter(zip(found.extremes, found.times, strict=True))
    for name, item in reductions:
        k = quantities.index(item.quantity)
        own = [next(extremes) for _ in item.signs]
        observed = Observed(found.start[k], tuple(v for v, _ in own), tuple(t for _, t in own), found.integrals[k])
        reports |= {name + end: value for end, value in item.result(observed).items()}
    return reports
