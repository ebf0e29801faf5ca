"""Many runs in blocks, so that a program is compiled for one number of runs, and threads share the work."""

from typing import Any

import jax
import numpy as np

from .. import native
from ..cpu import cores
from ..numerics.batches import even_size, in_threads, unpadded
from ..simulation.simulate import FEW_STEPS, Method
from .program import Settings, solved

# How many runs a program takes at a time by default.
NATIVE_BLOCK = 512
XLA_BLOCK = 4096

# The compiled programs, by everything that they are compiled for.
_warm: set[Any] = set()


def solved_in_blocks(
    settings: Settings, parameters: Any, *others: Any, events: Any, block: int | None, threads: int | None
) -> tuple[Any, ...]:
    """The results of the program for all runs; ``others`` are times and tolerances, each with the runs as leading axis.

    - ``block``, ``threads``: as in :func:`~jaxball.ensemble.simulate_ensemble`.
    """
    leaves, structure = jax.tree.flatten(parameters)
    times, *tolerances = map(np.asarray, others)
    runs = len(times)
    natively = native.chosen() == "native" and native.usable([*leaves, *others])
    on_cpu = jax.default_backend() == "cpu"
    threads = threads or (cores() if on_cpu else jax.local_device_count())
    most = (NATIVE_BLOCK if natively else XLA_BLOCK) if on_cpu else runs
    block = block or min(runs, even_size(runs, most, threads))
    if natively:
        block = _filling_vectors(block)
    settings = settings._replace(lanes=min(settings.lanes or block, block))
    own = list(zip(map(np.asarray, leaves), settings.shared, strict=True))

    def call(places: np.ndarray) -> Any:
        parts = [leaf if shared else leaf[places] for leaf, shared in own]
        spans = times[places]
        # A run that only pads a block ends as it begins.
        spans[np.append(False, places[1:] == places[:-1])] = spans[-1, :1]
        given = structure.unflatten(parts), spans, *(x[places] for x in tolerances), events
        for room in _few_steps(settings.method):
            results = solved(settings._replace(method=settings.method._replace(max_steps=room)), *given)
            if np.max(results[0].steps) < room:
                return results
        return solved(settings, *given)

    shapes = tuple(leaf.shape if shared else leaf.shape[1:] for leaf, shared in own)
    key = settings, structure, shapes, block, times.shape[1]
    blocks = in_threads(call, runs, block, threads, compiled=_is_warm(key))
    executed = sum(int(one[-1]) for one in blocks)
    # Not jnp.asarray, for which XLA compiles a program for every shape.
    return jax.device_put((*unpadded([one[:-1] for one in blocks], runs), np.asarray(executed)))


def _is_warm(key: Any) -> bool:
    """Whether there is a program for this already; there will be one now."""
    try:
        known = key in _warm
    except TypeError:  # a solver that carries arrays has no hash
        return False
    _warm.add(key)
    return known


def _few_steps(method: Method) -> list[int]:
    """The numbers of steps to try first with dense output, because unused room costs time as well."""
    return [room for room in FEW_STEPS if room < method.max_steps] if method.dense else []


def _filling_vectors(block: int) -> int:
    """A number of runs that fills vectors: with fewer, the compiler would use none, and results differ by rounding."""
    return max(native.FEWEST, -(-block // native.LANES)) * native.LANES
