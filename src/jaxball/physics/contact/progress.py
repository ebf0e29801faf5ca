"""A transition in progress: what is known of the end of a mode while the next one is found."""

import dataclasses
from typing import TYPE_CHECKING, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ...interface.status import Status
from ...numerics.arrays import select_tree
from ..hybrid import START, WINDOW, Transition
from .guards import FIRST_OF_JOINTS
from .modes import ContactState, Mode, SwitchCause
from .window import Beginning

if TYPE_CHECKING:
    from .body_on_plane import BodyOnPlane


class Progress(NamedTuple):
    """A transition in progress: time, the state at the mode's end, and the current one.

    ``still`` says that it does not slip, ``flies`` that it leaves the ground, ``lands`` that it comes down, ``decides``
    that the mode has ended, and ``begins`` that a slip begins. ``stands`` says that rolling has ended against exact dry
    resistance, and ``turns`` that it begins.
    """

    t: Float[Array, ""]
    before: ContactState
    state: ContactState
    still: Bool[Array, ""]
    flies: Bool[Array, ""]
    lands: Bool[Array, ""]
    decides: Bool[Array, ""]
    begins: Bool[Array, ""]
    stands: Bool[Array, ""]
    turns: Bool[Array, ""]

    @classmethod
    def of(cls, plane: "BodyOnPlane", t: Float[Array, ""], state: ContactState, event: Int[Array, ""]) -> "Progress":
        """Begins a transition."""
        starts, rise, no = event == START, plane.rise(t, state), jnp.asarray(False)
        # What has happened to a joint does not concern a body in flight.
        goes_on = (event >= FIRST_OF_JOINTS) & state.is_in(Mode.FLIGHT)
        decides = starts | (event >= 0)
        return cls(
            t=t,
            before=state,
            state=_without_windows(plane, t, state, decides, starts | goes_on),
            still=(event == int(SwitchCause.GIVES_WAY)) | state.is_in(Mode.ROLLING),
            flies=(event == int(SwitchCause.LIFTS)) | goes_on | starts & ((state.height > 0) | (rise > 0)),
            lands=(event == int(SwitchCause.LANDS)) | starts & (state.height <= 0) & (rise < 0),
            decides=decides,
            begins=no,
            stands=no,
            turns=no,
        )

    def finish(self, cause: Int[Array, ""], slope: Float[Array, ""], pauses: Bool[Array, ""]) -> Transition:
        """Returns the transition for a :class:`SwitchCause`, WINDOW or START.

        ``pauses`` says that the mode has ended in ever shorter steps, which is so where a slip does.
        """
        starts = cause == START
        return Transition(
            t=self.t,
            before=self.before,
            after=self.state,
            # A start is no switch, except for a body that starts with an impact.
            event=jnp.where(starts, int(SwitchCause.LANDS), cause),
            slope=slope,
            switches=jnp.where(starts, self.lands, self.decides & (cause != WINDOW)),
            # Bounces follow each other in ever shorter times, but ``slowest`` of the Contact puts an end to them.
            crowds=cause != int(SwitchCause.LANDS),
            pauses=pauses & self.decides,
            status=jnp.where(cause == int(SwitchCause.JAMS), int(Status.JAMMED), int(Status.SUCCESS)),
        )


def _without_windows(
    plane: "BodyOnPlane",
    t: Float[Array, ""],
    state: ContactState,
    decides: Bool[Array, ""],
    keeps_height: Bool[Array, ""],
) -> ContactState:
    """Returns the state on the ground, or at its height, with the directions that are still known beforehand."""
    # All other events happen on the ground, where a landing is met only up to rounding.
    height, none = jnp.where(keeps_height, state.height, 0.0), Beginning.none(state.height)
    begun, rolling = none, state.rolling
    if rolling is not None:
        # The end of one window leaves the other in force; a new mode leaves neither.
        begun = select_tree(decides | (state.begun.until <= t), none, state.begun)
        if not plane.body.planar:  # the direction of a disk's rolling does not turn
            rolling = select_tree(decides | (rolling.until <= t), none, rolling)
    return dataclasses.replace(state, height=height, begun=begun, rolling=rolling)
