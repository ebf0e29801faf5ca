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
from .over_surface import has_surface
from .released import slip_velocity
from .slide import slide_size
from .window import Beginning

if TYPE_CHECKING:
    from .body_on_plane import BodyOnPlane


class Progress(NamedTuple):
    """A transition in progress: time, the state at the mode's end, and the current one.

    ``still`` says that it does not slip, ``flies`` that it leaves the ground, ``lands`` that it comes down, ``decides``
    that the mode has ended, and ``begins`` that a slip begins. ``stands`` says that rolling has ended against exact dry
    resistance, and ``turns`` that it begins. ``strikes`` says that a joint has struck its stop; None without stops.
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
    strikes: Bool[Array, ""] | None

    @classmethod
    def of(cls, plane: "BodyOnPlane", t: Float[Array, ""], state: ContactState, event: Int[Array, ""]) -> "Progress":
        """Begins a transition."""
        starts, no = event == START, jnp.asarray(False)
        strikes = None if state.stop_loss is None else no
        decides = starts | (event >= 0)
        if state.mode is None:
            state_in_mode = _without_windows(plane, t, state, decides, no)
            return cls(t, state, state_in_mode, no, no, no, decides, no, no, no, strikes)
        rise = _rise(plane, t, state)
        # What has happened to a joint does not concern a body in flight.
        goes_on = (event >= FIRST_OF_JOINTS) & state.is_in(Mode.FLIGHT)
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
            strikes=strikes,
        )

    def finish(self, cause: Int[Array, ""], slope: Float[Array, ""], pauses: Bool[Array, ""]) -> Transition:
        """Returns the transition for a :class:`SwitchCause`, WINDOW or START.

        ``pauses`` says that the mode has ended in ever shorter steps, which is so where a slip does.
        """
        starts = cause == START
        # A start is no switch, except for a body that starts with an impact.
        first, begins, crowds = int(SwitchCause.LANDS), self.lands, cause != int(SwitchCause.LANDS)
        if self.strikes is not None:
            first, begins = jnp.where(self.lands, first, int(SwitchCause.JOINT_STRIKES)), begins | self.strikes
            crowds &= cause != int(SwitchCause.JOINT_STRIKES)
        return Transition(
            t=self.t,
            before=self.before,
            after=self.state,
            event=jnp.where(starts, first, cause),
            slope=slope,
            switches=jnp.where(starts, begins, self.decides & (cause != WINDOW)),
            # Bounces follow each other in ever shorter times, but ``slowest`` of the law puts an end to them.
            crowds=crowds,
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
    height, begun, rolling, none = state.height, state.begun, state.rolling, Beginning.none(t)
    ended = Beginning.none(t, slide_size(plane))
    if height is not None:
        height = jnp.where(keeps_height, height, 0.0)
    # The end of one window leaves the other in force; a new mode leaves neither.
    if begun is not None:
        begun = ended if rolling is None else select_tree(decides | (begun.until <= t), ended, begun)
    if rolling is not None and not plane.body.planar:  # the direction of a disk's rolling does not turn
        rolling = select_tree(decides | (rolling.until <= t), none, rolling)
    return dataclasses.replace(state, height=height, begun=begun, rolling=rolling)


def _rise(plane: "BodyOnPlane", t: Float[Array, ""], state: ContactState) -> Float[Array, ""]:
    """Computes the rate at which a body leaves its ground; 0 if it is rounding, but not for a ball on a plane."""
    rate = slip_velocity(plane.body, t, state.released)[2]
    if not has_surface(plane.body) and plane.body.shape is None:
        return rate
    return jnp.where(jnp.abs(rate) > plane.rounding_of_velocity(state), rate, 0.0)
