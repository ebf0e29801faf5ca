"""The steps of a solve in its dense output."""

from collections.abc import Callable
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from .sampling import last_within

Values = Callable[[Float[Array, ""], Float[Array, " size"]], Float[Array, " k"]]
Field = Callable[[Float[Array, ""], Float[Array, " size"]], Float[Array, " size"]]


class Steps(eqx.Module):
    """Steps, of which the first ``count`` were taken, and the data of their dense output.

    ``start`` and ``end`` are their times without derivatives; ``end`` lies a little before the end of a step, so
    that a kink there is seen from before. ``times`` and ``until``, where the last one is cut off, have derivatives.
    """

    start: Float[Array, " steps"]
    end: Float[Array, " steps"]
    until: Float[Array, ""]
    count: Int[Array, ""]
    times: Float[Array, " steps_and_one"]
    infos: PyTree[Float[Array, "steps ..."]]
    interpolation: Callable[..., diffrax.AbstractLocalInterpolation] = eqx.field(static=True)

    @classmethod
    def of(cls, solution: Any, until: Float[Array, ""], room: int | None = None) -> "Steps":
        """The steps of a solution with dense output, or the first ``room`` of them, cut off at ``until``."""
        dense = solution.interpolation
        room = int(dense.ts.size) - 1 if room is None else room
        times = dense.ts[: room + 1]
        fixed, last = jax.lax.stop_gradient((times, until))
        start, end = fixed[:-1], jnp.minimum(fixed[1:], last)
        end = last_within(start, end)
        count = jnp.sum((start < last) & (jnp.arange(start.size) < dense.ts_size - 1))
        return cls(
            start,
            end,
            until,
            count,
            times,
            jax.tree.map(lambda leaf: leaf[:room], dense.infos),
            dense.interpolation_cls,
        )

    @property
    def taken(self) -> Bool[Array, " steps"]:
        """Which of them were taken."""
        return jnp.arange(self.start.size) < self.count

    def ends(self, index: Int[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """The start and the end of a step, with derivatives."""
        start, end = self.times[index], self.times[index + 1]
        return start, jnp.where(end < self.until, end, self.until)

    def step(self, index: Int[Array, ""]) -> diffrax.AbstractLocalInterpolation:
        """The dense output of one step."""
        info = jax.tree.map(lambda leaf: leaf[index], self.infos)
        return self.interpolation(t0=self.times[index], t1=self.times[index + 1], **info)

    def state(self, index: Int[Array, ""], t: Float[Array, ""]) -> Float[Array, " size"]:
        """The vector of the state at a time within a step."""
        return self.step(index).evaluate(t)

    @property
    def like(self) -> tuple[Float[Array, ""], Float[Array, " size"]]:
        """A time and a vector, for their shapes."""
        return self.start[0], self.state(jnp.asarray(0), self.start[0])

    def states(self, index: Int[Array, " n"], times: Float[Array, "n m"]) -> Float[Array, "n m size"]:
        """The vectors of the state at m times in each of n steps."""
        return jax.vmap(lambda i, times: jax.vmap(self.step(i).evaluate)(times))(index, times)
