"""Dense output of a solve with pauses, where a step begins later than the one before it has ended.

A body that slips or rolls ever more slowly is followed to its end by one formula, not by ever shorter steps. That takes
a short time, the pause, in which the state moves along a straight line as nearly as the tolerance asks.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import jax.numpy as jnp
from jaxtyping import Array, Float


class Pause(NamedTuple):
    """What came between a step and the one before it.

    - ``before``: the vector with which the step before ended, at the time ``t0`` of a :class:`StepAfterPause`.
    - ``until``: the vector at the end of the pause, still in the mode of the step before.
    - ``start``: the time at which the pause ends and the step begins.
    """

    before: Float[Array, "*steps size"]
    until: Float[Array, "*steps size"]
    start: Float[Array, "*steps"]

    @classmethod
    def empty(cls, like: Float[Array, " size"], steps: int) -> "Pause":
        """Makes room for the pauses before ``steps`` steps."""
        vectors = jnp.zeros((steps, *like.shape), like.dtype)
        return cls(vectors, vectors, jnp.full(steps, -jnp.inf, like.dtype))


class StepAfterPause(diffrax.AbstractLocalInterpolation):
    """The dense output of a step with that of the pause before it, which begins at ``t0``."""

    t0: Any
    t1: Any
    pause: Pause
    step: diffrax.AbstractLocalInterpolation

    def evaluate(self, t0, t1=None, left=True):
        if t1 is not None:
            return self.evaluate(t1, left=left) - self.evaluate(t0, left=left)
        before, until, start = self.pause
        pauses = t0 < start
        # A step after a kink begins one number behind it, and a time that is asked for may be that of the kink itself.
        length = jnp.where(start > self.t0, start - self.t0, 1.0)
        on_line = before + ((t0 - self.t0) / length) * (until - before)
        return jnp.where(pauses, on_line, self.step.evaluate(jnp.where(pauses, start, t0), left=left))


class AfterPauses(NamedTuple):
    """Makes the dense output of a step after a pause, like an interpolation class."""

    interpolation: Callable[..., diffrax.AbstractLocalInterpolation]

    def __call__(self, *, t0: Array, t1: Array, pause: Pause, info: Any) -> StepAfterPause:
        return StepAfterPause(t0, t1, pause, self.interpolation(t0=pause.start, t1=t1, **info))
