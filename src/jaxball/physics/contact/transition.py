"""Finds the next mode of a body on its ground where a mode ends, and the state with which it begins.

``body_on_plane`` calls it; ``holding`` decides what is held where dry friction may hold more than the contact.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ...interface.status import Status
from ...numerics.arrays import select_tree
from ...programs.derivatives.differentiation import without_derivatives
from ..hybrid import START, WINDOW, Accuracy, Transition, at_zero
from . import friction, slip as slips, window as windows
from .impact import impact
from .modes import ContactState, Mode, SwitchCause
from .released import (
    ReleasedState,
    Response,
    in_space,
    rates,
    rolling_contact,
    slip_velocity,
    with_rise,
    with_slip,
)
from .window import Beginning, Course

if TYPE_CHECKING:
    from .body_on_plane import BodyOnPlane


def transition(
    plane: "BodyOnPlane", t: Float[Array, ""], state: ContactState, event: Int[Array, ""], accuracy: Accuracy
) -> Transition:
    """Finds what follows an event that ends a mode, the end of a window, or the start of a run.

    First, a slip that ends is followed to its end, and so is rolling. Next comes an impact, if the body lands, then the
    mode for the velocities after it, and then the direction in which a slip or rolling begins. A negative event means
    none, and the mode continues, with the direction of its velocity.
    """
    heading = without_derivatives(plane).step_reference(*without_derivatives((t, state, accuracy)))
    guards, which = type(plane).guards_in_step, plane.guard_of(state, event)
    t, before, slope = at_zero(guards, plane, t, state, which, event >= 0, (plane.with_fixed_speeds(heading),))
    done, kind = plane.progress(t, before, event), type(plane)
    done = only_if(event == int(SwitchCause.STOPS), end_slip, plane, done, accuracy.tolerance)
    done = kind.end_rolling(plane, done, event, accuracy.tolerance)
    done = only_if(done.lands, kind.strike, plane, done)
    done = only_if(done.decides, kind.decide, plane, done, event)
    done = done._replace(state=kind.begin(plane, done, accuracy.tolerance))
    return done.finish(plane.cause_of_event(state, event), slope, pauses=plane.slows(event))


def only_if(happens: Bool[Array, ""], stage: Callable[..., "Progress"], plane: Any, done: "Progress", *others: Any):
    """Applies a stage of a transition, if it happens; compiled on its own, it is traced once."""
    return jax.lax.cond(happens, jax.jit(stage), lambda _, done, *others: done, plane, done, *others)


def response_on_plane(plane: "BodyOnPlane", t: Float[Array, ""], state: ContactState) -> Response:
    """Computes the response of a body that touches the ground."""
    # A body that lands still has the mode of flight here; any mode on the ground says that it touches.
    return plane.response(t, eqx.tree_at(lambda x: x.mode, state, jnp.full_like(state.mode, int(Mode.SLIDING))))


def end_slip(plane: "BodyOnPlane", done: "Progress", tolerance: Float[Array, ""]) -> "Progress":
    """Moves the state to the end of a slip, if it has one soon, with a response that changes linearly with the time."""
    t, state, body = done.t, done.state, plane.body
    slip, now = slip_velocity(body, t, state.released), response_on_plane(plane, t, state)
    about = friction.sliding_contact(now), _coefficients(plane, slip)
    first = slips.end(slips.pull_of_friction, slips.Around(about), slip[:2])
    ends = first.comes & (first.time <= slips.longest_pause(tolerance, slips.unit_of_time(body)))
    # Where a slip turns, its acceleration is not that of the response halfway: the velocities there are to be the means
    # until the end, for which early accelerations count more.
    half, (mean, late) = slips.HALFWAY * first.time, first.braking(slip)
    early, pressed = 2 * mean - late, 2 * first.normal - first.late_normal
    moved = rates(body, state.released, now, now.amounts(early, pressed))
    halfway = _move(state, half, moved)
    later = response_on_plane(plane, t + half, halfway)
    about_later = friction.sliding_contact(later), about[1]
    end = slips.end(slips.pull_of_friction, slips.Around(about, about_later, half), slip[:2])
    mean, late = end.braking(slip)
    stopped = _move(state, end.time, rates(body, halfway.released, later, later.amounts(late, end.late_normal)))
    # What accelerates it more than that is early, with the response of the start.
    more = rates(body, state.released, now, now.amounts(early + mean - late, pressed + end.normal - end.late_normal))
    stopped = _move(stopped, end.time, jax.tree.map(jnp.subtract, more, moved))
    stopped = eqx.tree_at(lambda x: x.friction_loss, stopped, stopped.friction_loss + end.friction_loss)
    after = done._replace(t=t + end.time, before=stopped, state=stopped, still=jnp.asarray(True))
    # Where no end is near, the slip has only been slow for a while, and the mode goes on.
    return select_tree(ends, after, done._replace(decides=jnp.asarray(False)))


def _coefficients(plane: "BodyOnPlane", slip: Float[Array, "3"]) -> Float[Array, "3"]:
    """Computes the coefficient of a slip that slows down as a polynomial in the share of its speed, lowest first."""
    none, half, whole = (plane.coefficient(slip, share) for share in (0.0, slips.HALFWAY, 1.0))
    return jnp.stack([none, 4 * (half - none) - (whole - none), 2 * (whole - none) - 4 * (half - none)])


def _move(state: ContactState, time: Float[Array, ""], moved: ReleasedState) -> ContactState:
    """Returns the state after some time at these rates."""
    return state.move(jax.tree.map(lambda x, rate: x + time * rate, state.released, moved))


def strike(plane: "BodyOnPlane", done: "Progress") -> "Progress":
    """Applies an impact. A rebound that is too slow is treated as none."""
    t, state, contact = done.t, done.state, plane.contact
    response, slip = plane.response_to_impulse(t, state), slip_velocity(plane.body, t, state.released)
    rebounds = contact.restitution * -slip[2] > contact.slowest * plane.unit_of_speed(response)
    e = jnp.where(rebounds, contact.restitution, 0.0)
    after = impact(plane.body, t, state.released, response, plane.coefficient(slip), e)
    # Without a rebound exactly zero: the rounding that is left would make the body fly, or sink.
    rise = jnp.where(rebounds, slip_velocity(plane.body, t, after.state)[2], 0.0)
    V = with_rise(plane.body, t, after.state, rise)
    bounced = state.move(ReleasedState(after.state.body, V, state.height))
    bounced = eqx.tree_at(lambda x: x.impact_loss, bounced, state.impact_loss - after.work)
    flies = done.flies | (rise > 0)
    return done._replace(state=bounced, still=done.still | after.collision.sticks, flies=flies)


def decide(plane: "BodyOnPlane", done: "Progress", cause: Int[Array, ""]) -> "Progress":
    """Decides the mode that follows, by the forces that each mode would need."""
    t, state, body, contact = done.t, done.state, plane.body, plane.contact
    response, released_state, flies = response_on_plane(plane, t, state), state.released, done.flies
    slip = slip_velocity(body, t, released_state)
    still = done.still | plane.is_still(slip, state)
    R, slack = friction.rolling(response).R, plane.rounding_of_force(state, response)
    # Without static friction a body never rolls, not even one that would need no friction to.
    holds = (friction.margin(R, contact.static_friction) > -slack) & (R[2] > -slack) & (contact.static_friction > 0)
    # Friction that has just given way is at its limit, so by rounding it may seem to be enough.
    rolls = still & holds & (cause != int(SwitchCause.GIVES_WAY))
    sigma = jax.lax.cond(
        still & ~rolls & ~flies,
        lambda: friction.first_slip(response, plane.coefficient(slip, 0.0)).sigma,
        lambda: friction.slip_direction(slip, jnp.zeros_like(slip[:2])),
    )
    mu = plane.coefficient(jnp.where(still, 0.0, slip))
    flies |= ~rolls & ~(friction.sliding(response, mu, sigma).normal > -slack)
    mode = jnp.where(flies, int(Mode.FLIGHT), jnp.where(rolls, int(Mode.ROLLING), int(Mode.SLIDING)))
    # The rest of a slip that ends is dissipated by friction; one without an end continues.
    stopped = with_slip(body, released_state, response, slip, jnp.zeros_like(slip))
    state = select_tree(still & ~flies & (rolls | plane.slips_end), state.move(stopped), state)
    rise = slip_velocity(body, t, state.released)[2]
    # Where the normal force falls to zero, a body leaves with no speed: what there is of it is rounding.
    V = with_rise(body, t, state.released, jnp.where(flies & (cause != int(SwitchCause.LIFTS)), rise, 0.0))
    begins = (mode == int(Mode.SLIDING)) & still
    # Takes σ to ``begin_slip``, which puts the window in its place, or none.
    begun = Beginning.along(t, sigma)
    after = eqx.tree_at(lambda x: (x.V, x.mode, x.begun), state, (V, mode.astype(V.dtype), begun))
    return done._replace(state=after, begins=begins)


def begin_slip(plane: "BodyOnPlane", done: "Progress", tolerance: Float[Array, ""]) -> ContactState:
    """Returns the state with the direction of a slip that begins or stays slow, for as long as it is computed in
    advance.
    """
    t, state, begins = done.t, done.state, done.begins & plane.slips_end
    longest = windows.longest_window(t, plane.driving_kinks(), slips.unit_of_time(plane.body))
    sigma, none = state.begun.sigma, Beginning.none(t)
    # A disk slips along a line, so its direction needs no search.
    if plane.body.planar:
        return eqx.tree_at(lambda x: x.begun, state, select_tree(begins, Beginning.along(t + longest, sigma), none))
    slipping = windows.OnPlane(plane.moving(state), plane.coefficient)
    course, goes_on = follow_slip(plane, done, tolerance)
    course = select_tree(goes_on, course, Course.of(sigma))
    begun = jax.lax.cond(
        begins | goes_on,
        lambda: windows.beginning(slipping, t, state.released, course, longest),
        lambda: none,
    )
    state = select_tree(goes_on & (begun.until > t), along_course(plane, t, state, course), state)
    return eqx.tree_at(lambda x: x.begun, state, begun)


def follow_slip(plane: "BodyOnPlane", done: "Progress", tolerance: Float[Array, ""]) -> tuple[Course, Bool[Array, ""]]:
    """Returns how a slip moves, and whether it goes on although its direction is not known beforehand."""
    t, state = done.t, done.state
    slip = slip_velocity(plane.body, t, state.released)
    # At the end of a window σ is still that of the window.
    sigma = done.before.direction(t, slip)
    course = Course(sigma, jnp.sum(sigma * slip[:2]), done.before.begun.next_span(t))
    slides = state.is_in(Mode.SLIDING) & ~done.begins & plane.slips_end & (state.begun.until <= t)
    return course, slides & course.is_that_of(slip[:2], plane.speed_of(state), tolerance)


def along_course(plane: "BodyOnPlane", t: Float[Array, ""], state: Any, course: Course) -> Any:
    """Returns the state with a slip exactly along its direction, without the errors of the solve across it."""
    slip = slip_velocity(plane.body, t, state.released).at[:2].set(course.slip)
    rolling, axes = rolling_contact(plane.body, t, state.body)
    return eqx.tree_at(lambda x: x.V, state, rolling + in_space(axes, slip))


class Progress(NamedTuple):
    """A transition in progress: time, the state at the mode's end, and the current one.

    ``still`` says that it does not slip, ``flies`` that it leaves the ground, ``lands`` that it comes down, ``decides``
    that the mode has ended, and ``begins`` that a slip begins. Under exact dry resistance, ``stands`` says that rolling
    has ended, and ``turns`` that it begins.
    """

    t: Float[Array, ""]
    before: ContactState
    state: ContactState
    still: Bool[Array, ""]
    flies: Bool[Array, ""]
    lands: Bool[Array, ""]
    decides: Bool[Array, ""]
    begins: Bool[Array, ""]
    stands: Bool[Array, ""] | None = None
    turns: Bool[Array, ""] | None = None

    @classmethod
    def of(
        cls,
        plane: "BodyOnPlane",
        t: Float[Array, ""],
        state: ContactState,
        cause: Int[Array, ""],
        keeps_flying: Bool[Array, ""] | bool = False,
    ) -> "Progress":
        """Begins the transition. With ``keeps_flying``, what has happened does not concern a body in flight."""
        starts, rise = cause == START, plane.rise(t, state)
        flies = keeps_flying | starts & ((state.height > 0) | (rise > 0))
        # All other events happen on the ground, where a landing is met only up to rounding.
        height = jnp.where(starts | keeps_flying, state.height, 0.0)
        return cls(
            t=t,
            before=state,
            state=eqx.tree_at(lambda x: (x.height, x.begun), state, (height, Beginning.none(state.height))),
            still=(cause == int(SwitchCause.GIVES_WAY)) | state.is_in(Mode.ROLLING),
            flies=(cause == int(SwitchCause.LIFTS)) | flies,
            lands=(cause == int(SwitchCause.LANDS)) | starts & (state.height <= 0) & (rise < 0),
            decides=starts | (cause >= 0),
            begins=jnp.asarray(False),
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
