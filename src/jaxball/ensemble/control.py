"""Step-size control by diffrax, lane by lane."""

from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

# From kinks and tolerances of one lane to its controller.
Controller = Callable[
    [Float[Array, " kinks"], Float[Array, ""], Float[Array, ""]], diffrax.AbstractAdaptiveStepSizeController
]
FIRST_STEP = 0.01  # as in diffrax


class Limits(NamedTuple):
    """The limits from which a lane's controller is made."""

    kinks: Float[Array, "kinks lanes"]
    rtol: Float[Array, " lanes"]
    atol: Float[Array, " lanes"]


class Verdict(NamedTuple):
    """The verdict on a step: whether it is accepted, where the next begins and ends, and whether there is one.

    ``jumped`` says whether the next begins past a kink, where the field may have jumped.
    """

    kept: Bool[Array, " lanes"]
    start: Float[Array, " lanes"]
    end: Float[Array, " lanes"]
    jumped: Bool[Array, " lanes"]
    memory: Any
    fine: Bool[Array, " lanes"]


def begin(controller: Controller, limits: Limits, t0: Float[Array, " lanes"], order: Any) -> Any:
    """Where the first step ends, and what the controller remembers."""

    def one(limits, t0):
        first = jnp.asarray(FIRST_STEP, t0.dtype)
        return controller(*limits).init(None, t0, t0 + first, t0, first, None, None, order)  # pyright: ignore

    return jax.vmap(one, in_axes=-1, out_axes=-1)(limits, t0)


def judge(controller: Controller, limits: Limits, step: Any, memory: Any, order: Any) -> Verdict:
    """Accepts or rejects a step, and chooses the next."""

    def one(limits, start, end, x, y, error, memory):
        kept, start, end, jumped, memory, result = controller(*limits).adapt_step_size(
            start, end, x, y, None, error, order, memory
        )
        fine = result == diffrax.RESULTS.successful
        kept, jumped = jnp.asarray(kept), jnp.asarray(jumped)
        return Verdict(kept, jnp.asarray(start), jnp.asarray(end), jumped, memory, fine)

    return jax.vmap(one, in_axes=-1, out_axes=-1)(limits, step.start, step.end, step.x, step.y, step.error, memory)
