"""Functions of many rows, side by side."""

import functools
from collections.abc import Callable
from typing import Any

import jax

from .. import native
from ..interface.arguments import refusal


def in_lanes(function: Callable[..., Any]) -> Callable[..., Any]:
    """``function`` of each row of arrays, like ``jax.vmap(function)``: in vector lanes if ``jaxball.jit`` compiles it.

    **Arguments:**

    - ``function``: a pure function of PyTrees of arrays, such as ``environment.step``. All arguments of what is
      returned have the rows as leading axis.

    Compiled by ``jaxball.jit`` the rows are computed several at a time, each in a lane of the processor's vectors, and
    what all share once. Elsewhere it is ``jax.vmap``.

    **Example:**

    >>> import jax.numpy as jnp
    >>> import jaxball
    >>> from jaxball.environments import in_lanes
    >>> jaxball.jit(in_lanes(lambda x, y: x * y))(jnp.arange(3.0), jnp.arange(3.0))
    Array([0., 1., 4.], dtype=float64)
    """
    if isinstance(function, type) or not callable(function):
        raise refusal("function", "a function of PyTrees of arrays", function)

    @functools.wraps(function)
    def of_rows(*rows: Any) -> Any:
        if native.traced_natively():
            return jax.lax.map(lambda row: function(*row), rows)
        return jax.vmap(function)(*rows)

    return of_rows
