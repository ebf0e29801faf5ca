"""What a run under feedback records besides its states: the motion that it holds, its inputs and estimates.

Files and the page that shows a run read it; ``results.loading`` makes it again from a file.
"""

import dataclasses
from typing import Any, ClassVar

import equinox as eqx
import jax
from jaxtyping import Array, Float

from ..physics.hybrid import AbstractHistory
from ..physics.state import PlacedState


class FeedbackHistory(AbstractHistory):
    """The history of a run under feedback, at its saved times, which are the samples.

    - ``modes``: the history of the body itself: its modes with a law of contact, exact dry resistance, or joints that
      stick or have stops.
    - ``nominal``: the states of the motion that is held.
    - ``u``: the inputs from each time on; NaN at the end, after which there are none, shape (T, m).
    - ``estimate``: the :class:`~jaxball.control.estimation.estimate.LoopEstimate` of a feedback from sensors; else
      None.
    - ``inputs``: the names of the inputs.
    """

    described: ClassVar[str] = "feedback, between whose samples it is not known"
    restarts: ClassVar[bool] = False  # the inputs follow from the states of the run, which have errors

    modes: AbstractHistory
    nominal: PlacedState
    u: Float[Array, "T m"]
    estimate: Any
    inputs: tuple[str, ...] = eqx.field(static=True)

    @property
    def switches(self) -> Any:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Those of the body."""
        return self.modes.switches

    @property
    def always_rolls(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.modes.always_rolls

    @property
    def of_body(self) -> AbstractHistory:
        return self.modes

    @property
    def over_time(self) -> dict[str, Array]:
        return self.modes.over_time

    @property
    def coefficients(self) -> dict[str, Array]:
        return self.modes.coefficients

    @property
    def advice(self) -> str:
        return self.modes.advice

    @property
    def directions(self) -> tuple[str, ...]:
        """The names of the local coordinates."""
        return jax.tree.map(lambda leaf: leaf[0], self.nominal).directions

    def deviations(self, states: PlacedState) -> Float[Array, "T n"]:
        """Computes ξ: the local coordinates of the ``states`` of the run around the states of the motion."""
        return jax.vmap(lambda nominal, state: nominal.difference(state))(self.nominal, states)

    @property
    def lines(self) -> list[str]:
        sees = "of its state" if self.estimate is None else "of its sensors' readings"
        return [f"under feedback {sees}, by {', '.join(self.inputs)}", *self.modes.lines]

    def at_rows(self, rows: slice) -> "FeedbackHistory":
        # The estimate has names besides arrays, which have no rows.
        arrays, names = eqx.partition((self.nominal, self.u, self.estimate), eqx.is_array)
        nominal, u, estimate = eqx.combine(jax.tree.map(lambda leaf: leaf[rows], arrays), names)
        return dataclasses.replace(self, modes=self.modes.at_rows(rows), nominal=nominal, u=u, estimate=estimate)
