"""A body that rolls, slides or flies, which exact dry resistance may hold, with joints that dry friction may hold.

``simulate`` solves it in place of a body with both that is given a law of contact. It has the modes of ``resting``, and
in each of them each joint sticks or slips, as in ``sticking``.
"""

from typing import Any, ClassVar

from ..body import AbstractBody
from .resting import RestingHistory, RestingOnPlane, RestingState
from .sticking import StickingHistory, StickingOnPlane, StickingState


class HeldState(StickingState, RestingState):
    """The variables of such a body, which a solve advances."""


class HeldHistory(StickingHistory, RestingHistory):
    """The modes of a run with a law of contact, exact dry resistance and joints that stick, at its saved times."""

    described: ClassVar[str] = "a law of contact, exact dry resistance and joints that stick"

    def as_solved(self, system: AbstractBody, states: Any) -> "tuple[HeldOnPlane, HeldState]":
        plane, state = RestingHistory.as_solved(self, system, states)
        return HeldOnPlane(system, plane.contact), HeldState(**vars(state), slips=self.directions)


class HeldOnPlane(StickingOnPlane, RestingOnPlane):
    """A ball or a disk with a law of contact, exact dry resistance, and joints that dry friction may hold."""

    title: ClassVar[str] = "body with a law of contact, exact dry resistance and joints that stick"
    state_type: ClassVar[Any] = HeldState
    history_type: ClassVar[Any] = HeldHistory
    of_body: ClassVar[int] = 5
