"""A step-size controller that ends steps at the kinks of a vector field; the loop of a solve wraps its own in it."""

from collections.abc import Sequence
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float

from ..numerics.kinks import after, before, before_kink
from .wrapping import AbstractWrappingController


class StepToKinks(AbstractWrappingController):
    """Ends a step just before each kink and begins the next just after it, so that no step crosses one.

    Like ``diffrax.ClipStepSizeController(controller, jump_ts=kinks)``, for the few kinks of a driven ball: they are
    neither sorted nor searched, which took more than a quarter of a solve, and the step after a kink is as long as the
    step that the kink cut short would have been.

    **Arguments:**

    - ``controller``: the step-size controller that chooses the steps in between.
    - ``kinks``: times, in any order, inside the run or outside.

    Derivatives with respect to the times of kinks are right if each jump of the vector field belongs to a single kink.
    """

    controller: diffrax.AbstractAdaptiveStepSizeController  # pyright: ignore[reportIncompatibleVariableOverride]
    kinks: Float[Array, " kinks"]

    def __init__(
        self,
        controller: diffrax.AbstractAdaptiveStepSizeController,
        kinks: Float[ArrayLike, " kinks"] | Sequence[float],
    ):
        self.controller = controller
        self.kinks = jnp.asarray(kinks)

    def wrap(self, direction):
        controller = self.controller.wrap(direction)
        return eqx.tree_at(lambda s: (s.controller, s.kinks), self, (controller, self.kinks * direction))

    def init(self, terms, t0: Any, t1: Any, y0, dt0, args, func, error_order):
        t1, state = self.controller.init(terms, t0, t1, y0, dt0, args, func, error_order)
        return self._clip(t0, t1), (t1 - t0, state)

    def adapt_step_size(self, t0, t1, y0, y1_candidate, args, y_error, error_order, controller_state):
        target_length, state = controller_state
        keep, next_t0, next_t1, made_jump, state, result = self.controller.adapt_step_size(
            t0, t1, y0, y1_candidate, args, y_error, error_order, state
        )
        # Only the start of a step and kinks carry derivatives. A step length with a derivative would amplify it after a
        # kink, as the steps grow.
        length, target_length = jax.lax.stop_gradient((next_t1 - next_t0, target_length))
        # A step that was cut short says nothing about longer ones.
        length = jnp.where(keep & (t1 - t0 < 0.99 * target_length), jnp.maximum(length, target_length), length)
        past, jumped = self._past(jnp.asarray(next_t0))
        return keep, past, self._clip(past, past + length), made_jump | jumped, (length, state), result

    def _clip(self, t0: Float[Array, ""], t1: Float[Array, ""]) -> Float[Array, ""]:
        return before_kink(self.kinks.astype(t0.dtype), t0, t1)

    def _past(self, t: Float[Array, ""]) -> tuple[Float[Array, ""], Bool[Array, ""]]:
        """Returns the first time after the kink where ``t`` is the last one before it, and whether it is."""
        kinks = self.kinks.astype(t.dtype)
        here = (t == before(kinks)) | (t == kinks)
        beyond = jnp.min(jnp.where(here, after(kinks), jnp.inf))
        jumped = jnp.any(here)
        return jnp.where(jumped, beyond, t), jumped
