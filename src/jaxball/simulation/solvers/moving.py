"""The equations of those numbers alone that move within steps, while others change at events only."""

from typing import Any

import diffrax
import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float


class FieldOfMoving(eqx.Module):
    """The rates of the first numbers of a vector, whose rest is constant and comes with the arguments: (args, rest)."""

    terms: Any
    moving: int = eqx.field(static=True)

    @classmethod
    def term(cls, terms: Any, moving: int) -> diffrax.ODETerm:
        """Returns the equations of the first ``moving`` numbers of those of ``terms``."""
        return diffrax.ODETerm(cls(terms, moving))

    def __call__(
        self, t: Float[Array, ""], y: Float[Array, " moving"], args: tuple[Any, Float[Array, " rest"]]
    ) -> Float[Array, " moving"]:
        of_field, rest = args
        return self.terms.vf(t, jnp.concatenate([y, rest]), of_field)[: self.moving]
