"""How parameters become array leaves."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float

Numbers = ArrayLike | Sequence[Any]  # a number, an array, or nested sequences of numbers


def default_dtype() -> np.dtype:
    """float64 where x64 is enabled, else float32."""
    return jax.dtypes.canonicalize_dtype(np.float64)


def to_array(x: Numbers) -> Float[Array, "..."]:
    """``x`` as an array of the default floating type."""
    return jnp.asarray(x, dtype=default_dtype())


def is_traced(x: Array) -> bool:
    """Whether the value of ``x`` is not known, as within jit, vmap and grad."""
    return isinstance(x, Tracer)


def require_shape(name: str, value: Array, shape: tuple[int, ...]) -> None:
    """Raises a ``ValueError`` unless the argument ``name`` has the shape () or (n,) that it must have."""
    if value.shape != shape:
        wanted = "a single number" if shape == () else f"{shape[0]} numbers"
        raise ValueError(f"Argument `{name}` must be {wanted}, but its shape is {value.shape}.")
