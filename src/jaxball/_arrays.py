"""How parameters become array leaves."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float


def to_array(x: Any) -> Float[Array, "..."]:
    """``x`` as an array of the default floating type (float64 where x64 is enabled)."""
    return jnp.asarray(x, dtype=jnp.result_type(float))


def array_field(default: ArrayLike | tuple | None = None) -> Any:
    """A field of an Equinox module that holds an array, converted on construction."""
    if default is None:
        return eqx.field(converter=to_array)
    return eqx.field(converter=to_array, default=default)
