"""Maps functions over many rows: side by side, or in batches of a fixed size, for which a program is compiled once.

Charts, studies, designs and solvers map their rows so. A program for batches can be called for any number of rows. The
last batch is padded by repeating the last row, and the results of the padding are cut off.
"""

import functools
import itertools
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from ..interface.arguments import refusal
from . import native


def batches(rows: int, size: int) -> list[Int[np.ndarray, " size"]]:
    """Returns the indices of each batch's rows, padding included."""
    return [np.minimum(np.arange(start, start + size), rows - 1) for start in range(0, rows, size)]


def join_batches(results: Sequence[Any], rows: int) -> Any:
    """Joins the results of all batches one after the other: PyTrees of arrays that have the rows as leading axis."""
    return jax.tree.map(lambda *parts: np.concatenate(parts)[:rows], *results)


def in_batches(function: Callable[[Any], Any], rows: Any, size: int) -> Any:
    """Applies ``function`` to a PyTree of NumPy arrays that have the rows as leading axis, ``size`` of them
    at a time.
    """
    count = len(jax.tree.leaves(rows)[0])
    parts = (jax.tree.map(lambda leaf, batch=batch: leaf[batch], rows) for batch in batches(count, size))
    return join_batches([jax.tree.map(np.asarray, function(part)) for part in parts], count)


def in_threads(
    function: Callable[[Int[np.ndarray, " size"]], Any],
    rows: int,
    size: int,
    threads: int,
    *,
    progress: Callable[[int, int], Any] | None = None,
) -> list[Any]:
    """Applies ``function`` to the indices of each batch, in order and with the padding; ``threads`` batches at a time.

    A compiled program releases the GIL while it runs. Batches go to the devices in turn, the first of them alone, so
    that the function is compiled once. ``progress`` is called with the number of rows done and of all rows.
    """
    jobs = list(zip(batches(rows, size), itertools.cycle(jax.local_devices())))
    alone = len(jobs) if threads == 1 else 1

    def run(job: tuple[Int[np.ndarray, " size"], Any]) -> Any:
        batch, device = job
        with jax.default_device(device):
            return jax.tree.map(np.asarray, function(batch))

    results = []
    with ThreadPoolExecutor(threads) as pool:
        for part, mapped in ((jobs[:alone], map), (jobs[alone:], pool.map)):
            for result in mapped(run, part):
                results.append(result)
                if progress is not None:
                    progress(min(len(results) * size, rows), rows)
    return results


def map_rows(function: Callable[..., Any], *rows: Any) -> Any:
    """Applies ``function`` to each row of PyTrees of arrays that have the rows as leading axis; JAX can trace it.

    On a CPU and in native programs one row after another, which is a loop around one program of small arrays, where all
    rows at once would be a loop for each of its operations: for the observables of a run the native compiler takes a
    third of the time, and its program half. Where XLA compiles for a GPU, all rows at once.
    """
    if native.is_traced_natively() or jax.default_backend() == "cpu":
        return jax.lax.map(lambda row: function(*row), rows)
    return jax.vmap(function)(*rows)


def of_rows(function: Callable[..., Any], *rows: Any) -> Any:
    """Applies ``function`` to each row of PyTrees of arrays that have the rows as leading axis, side by side.

    For long computations, such as runs: JAX traces it, and it is a map where that is the form that compiles well.
    """
    if len(jax.tree.leaves(rows)[0]) == 1:
        return jax.tree.map(lambda leaf: leaf[None], function(*jax.tree.map(lambda leaf: leaf[0], rows)))
    return _side_by_side(function, rows)


def in_lanes(function: Callable[..., Any]) -> Callable[..., Any]:
    """Maps ``function`` over the rows of arrays, like ``jax.vmap(function)``: in vector lanes if ``jaxball.jit``
    compiles it.

    **Arguments:**

    - ``function``: a pure function of PyTrees of arrays, such as ``environment.step``. All arguments of the
      function that is returned have the rows as leading axis.

    Compiled by ``jaxball.jit`` the rows are computed several at a time, each in a lane of the processor's vectors, and
    what all share once. Elsewhere it is ``jax.vmap``.

    **Example:**

    >>> import jax.numpy as jnp
    >>> import jaxball
    >>> from jaxball.control.environments import in_lanes
    >>> jaxball.jit(in_lanes(lambda x, y: x * y))(jnp.arange(3.0), jnp.arange(3.0))
    Array([0., 1., 4.], dtype=float64)
    """
    if isinstance(function, type) or not callable(function):
        raise refusal("function", "a function of PyTrees of arrays", function)

    @functools.wraps(function)
    def of_each(*rows: Any) -> Any:
        return _side_by_side(function, rows)

    return of_each


def _side_by_side(function: Callable[..., Any], rows: tuple[Any, ...]) -> Any:
    if native.is_traced_natively():
        return jax.lax.map(lambda row: function(*row), rows)
    return jax.vmap(function)(*rows)


def fill_vectors(function: Callable[[Any], Any], rows: Any) -> Any:
    """Applies ``function`` to each row of a PyTree of arrays: all at once, natively as many at a time as fill a vector.

    For short computations within a step, such as the tangents of a field in many directions.
    """
    many = len(jax.tree.leaves(rows)[0]) > native.LANES and native.is_traced_natively()
    return map_batches(function, rows, native.LANES) if many else jax.vmap(function)(rows)


def map_batches(function: Callable[[Any], Any], rows: Any, size: int) -> Any:
    """Applies ``function`` to each row of a PyTree of arrays, by ``jax.vmap`` of about ``size`` rows at a time.

    The rows are shared out among batches of equal size; JAX can trace it.
    """
    count = len(jax.tree.leaves(rows)[0])
    parts = -(-count // size)
    size = -(-count // parts)
    if parts == 1:
        return jax.vmap(function)(rows)

    def split(leaf: Array) -> Array:
        padding = [(0, parts * size - count), *((0, 0) for _ in leaf.shape[1:])]
        return jnp.pad(leaf, padding, mode="edge").reshape(parts, size, *leaf.shape[1:])

    results = jax.lax.map(jax.vmap(function), jax.tree.map(split, rows))
    return jax.tree.map(lambda leaf: leaf.reshape(parts * size, *leaf.shape[2:])[:count], results)
