"""The equations of the numbers that move within steps, apart from those that change at events only.

Half of the numbers of a body with a law of contact say in which mode it is. They are constant within a step, and with
them the sums over the stages took half of the time of a step.
"""

from typing import Any

import diffrax
import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float


class _FieldOfMoving(eqx.Module):
    terms: Any
    moving: int = eqx.field(static=True)

    def __call__(self, t: Any, y: Float[Array, " moving"], args: tuple[Any, Array]) -> Float[Array, " moving"]:
        of_all, rest = args
        return self.terms.vf(t, jnp.concatenate([y, rest]), of_all)[: self.moving]


def of_moving(
    terms: Any, y: Float[Array, " size"], args: Any, moving: int | None
) -> tuple[Any, Float[Array, " moving"], Any, Float[Array, " rest"]]:
    """Returns the equations of the first ``moving`` numbers of ``y`` with these and their arguments, and the rest.

    All of them move if ``moving`` is None.
    """
    rest = y[y.size if moving is None else moving :]
    if not rest.size:
        return terms, y, args, rest
    moving = y.size - rest.size
    return diffrax.ODETerm(_FieldOfMoving(terms, moving)), y[:moving], (args, rest), rest


def with_zeros(rates: Float[Array, "*stages moving"], size: int) -> Float[Array, "*stages size"]:
    """Returns rates of all numbers, of which ``rates`` has those that move."""
    still = jnp.zeros((*rates.shape[:-1], size - rates.shape[-1]), rates.dtype)
    return jnp.concatenate([rates, still], axis=-1) if still.size else rates
