"""Functions of many nodes, a few nodes at a time."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

# So many nodes are looked at by one call of the compiled program, which is the same for each mesh.
CHUNK = 32


def in_chunks(function: Callable[..., Any], *rows: np.ndarray) -> Any:
    """A function of many rows, called with ``CHUNK`` of them at a time; the last ones are repeated to fill a chunk."""
    found = []
    for at in range(0, len(rows[0]), CHUNK):
        few = [row[at : at + CHUNK] for row in rows]
        count = len(few[0])
        filled = [np.concatenate([row, np.repeat(row[-1:], CHUNK - count, axis=0)]) for row in few]
        found.append(jax.tree.map(lambda x, count=count: np.asarray(x)[:count], function(*map(jnp.asarray, filled))))
    return jax.tree.map(lambda *parts: np.concatenate(parts), *found)
