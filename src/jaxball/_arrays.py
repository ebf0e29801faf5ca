"""How parameters become array leaves."""

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

Numbers = ArrayLike | Sequence[Any]  # a number, an array, or nested sequences of numbers


def to_array(x: Numbers) -> Float[Array, "..."]:
    """``x`` as an array of the default floating type (float64 where x64 is enabled)."""
    return jnp.asarray(x, dtype=jnp.result_type(float))
