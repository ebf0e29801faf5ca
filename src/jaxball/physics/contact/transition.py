"""Finds the next mode of a body on its ground where a mode ends, and the state with which it begins.

A slip that ends is followed to its end, and a body that lands has an impact. ``holding`` finds the end of rolling, what
is held afterwards, and how the rest begins to move. The directions in which a slip and rolling grow are those of a
``window``; where both begin at the same time, each depends on the other, and they are computed in turn.
"""

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ...numerics.arrays import select_tree
from ...numerics.directions import unit
from ...numerics.vectors import in_three
from ...programs.derivatives.differentiation import without_derivatives
from ..body import AbstractBody
from ..dynamics.dry_friction import TurningMode
from ..dynamics.sticking import directions_of, has_stops, rubs, sticking_slots
from ..hybrid import Accuracy, Transition, at_zero
from . import friction, slip as slips, window as windows
from .guards import Progress, cause_of_event, find_struck, guard_of, with_fixed_speeds
from .holding import TURNS_TAKEN, Rolling, decide, end_rolling
from .impact import impact, slowest_rise
from .modes import ContactState, Mode, SwitchCause
from .over_surface import near_to
from .released import ReleasedState, Response, rates, release, slip_velocity, with_rise
from .slide import slide, slide_size, with_slide
from .slip import along_rolling, follow_rolling
from .stops import strike_stop
from .window import Beginning, Course

if TYPE_CHECKING:
    from .body_on_plane import BodyOnPlane


def start(plane: "BodyOnPlane", t: Float[Array, ""], state: Any) -> ContactState:
    """Returns the state with which a solve starts; its mode is decided by the first transition.

    A rolling state is one without slip. A body that does not slip counts as rolling.
    """
    body, starting, zero = plane.body, ContactState(state), jnp.zeros_like(plane.body.radius)
    if plane.contact is not None:
        rolls = not isinstance(state, ReleasedState)
        released = release(body.prepare(), t, state) if rolls else state
        zero = jnp.zeros_like(released.height)
        # In the mode of flight packing leaves V as it is, also on the ground; in that of rolling it makes the slip
        # exactly zero. With a limit surface a body that spins does not roll, whatever its slip.
        rolls &= plane.pivot is None
        mode, begun = zero + int(Mode.ROLLING if rolls else Mode.FLIGHT), Beginning.none(zero, slide_size(plane))
        near = near_to(body, released.body.z, zero)
        starting = ContactState(released.body, released.V, released.height, zero, zero, mode, begun, near)
    if body.is_held:
        unit = jnp.ones_like(zero)  # nothing is held before the first transition
        starting = dataclasses.replace(starting, rolls=unit, spin=unit, rolling=Beginning.none(unit))
    if not body.sticking:
        return starting
    lost = zero if has_stops(body) else None
    return dataclasses.replace(starting, slips=directions_of(body, starting.body), stop_loss=lost)


class _Slipping(NamedTuple):
    """A body that begins to slip, in the modes of ``begins``."""

    plane: Any
    begins: Any

    @property
    def body(self) -> AbstractBody:
        """What is in motion, in the modes of its joints."""
        return self.plane.moving(self.begins)

    def prepare(self, t: Float[Array, ""], state: ReleasedState) -> tuple[friction.SolvedContact, Float[Array, ""]]:
        response = self.plane.response(t, self.begins.move(state))
        return friction.sliding_contact(response), self.plane.coefficient(slip_velocity(self.plane.body, t, state))

    def pull(
        self, t: Float[Array, ""], state: ReleasedState, prepare: tuple[friction.SolvedContact, Array], sigma: Array
    ) -> tuple[Float[Array, " n"], ReleasedState]:
        """Computes the rate of the slide, and ẋ."""
        contact, mu = prepare
        acting = contact.interaction(mu, sigma)
        return acting.slide_acceleration, rates(self.plane.body, state, contact.response, acting.amounts)


def follow_slip(plane: "BodyOnPlane", done: "Progress", tolerance: Float[Array, ""]) -> tuple[Course, Bool[Array, ""]]:
    """Returns how a slip moves, and whether it goes on although its direction is not known beforehand."""
    t, state = done.t, done.state
    sliding = slide(plane, t, state)
    # At the end of a window σ is still that of the window.
    sigma = done.before.direction(t, sliding)
    course = Course(sigma, jnp.sum(sigma * sliding), done.before.begun.next_span(t))
    slides = state.is_in(Mode.SLIDING) & ~done.begins & plane.slips_end & (state.begun.until <= t)
    return course, slides & course.is_that_of(sliding, plane.speed_of(state), tolerance)


class _Turning(NamedTuple):
    """A ball that begins to roll, in the modes of ``begins``."""

    plane: Any
    begins: Any

    @property
    def body(self) -> AbstractBody:
        """What is in motion, in the modes of its joints."""
        return self.plane.moving(self.begins)

    def prepare(self, t: Float[Array, ""], state: Any) -> Rolling | TurningMode:
        now = self.begins.move(state)
        # The rate at the nodes of the window is along the direction that is being found.
        mode = self.plane.mode(t, now, unit(self.plane.over_ground(t, now)[:2]))
        return mode if self.plane.contact is None else Rolling.of(self.plane, t, now, mode)

    def pull(
        self, t: Float[Array, ""], state: Any, prepare: Rolling | TurningMode, sigma: Float[Array, "2"]
    ) -> tuple[Float[Array, "2"], Any]:
        """Computes the rate of ω_h over the ground, in contact axes, and ẋ."""
        if isinstance(prepare, TurningMode):
            now = self.begins.move(state)
            moved = self.plane.rates_of_rolling(t, now, prepare._replace(sigma=in_three(sigma)))
            return self.plane.rate_over_ground(t, now, moved.Omega)[:2], moved
        assert prepare.contact is not None
        acting = prepare.act(sigma)
        return acting.rate[:2], rates(self.plane.body, state, prepare.contact.response, acting.amounts)


def begin(plane: "BodyOnPlane", done: Progress, tolerance: Float[Array, ""]) -> ContactState:
    """Returns the state with the directions of a slip and of rolling that begin or stay slow, for as long as they are
    computed in advance.
    """
    t = done.t
    state: Any = done.state
    longest = windows.longest_window(t, plane.driving_kinks(), slips.unit_of_time(plane.body))
    if plane.body.planar:
        return _begin_along_line(plane, done, longest)
    slip = None if state.begun is None else _slip_ahead(plane, done, tolerance, longest)
    turn = _turn_ahead(plane, done, tolerance, longest) if plane.turns_aside else None
    if slip is not None and turn is not None:
        start = dataclasses.replace(state, begun=slip.ahead, rolling=turn.ahead)

        def next_windows(start: Any, first: Bool[Array, ""]) -> tuple[Any, None]:
            # One window alone is final after the first pass; only two that depend on each other are computed again.
            needed = first | slip.needed & turn.needed & (start.begun.until > t) & (start.rolling.until > t)
            start = dataclasses.replace(start, begun=slip.window(start, needed, start.begun))
            return dataclasses.replace(start, rolling=turn.window(start, needed, start.rolling)), None

        # The first guess of a direction that is found in turn with the other: the one in which it begins.
        state = jax.lax.scan(next_windows, start, jnp.arange(TURNS_TAKEN) == 0)[0]
    elif slip is not None:
        state = dataclasses.replace(state, begun=slip.window(state, True, slip.before))
    elif turn is not None:
        state = dataclasses.replace(state, rolling=turn.window(state, True, turn.before))
    if slip is not None:
        # Exactly along its direction, without the errors of the solve across it.
        state = select_tree(slip.follows(state.begun), with_slide(plane, t, state, slip.course.slip), state)
    if turn is not None:
        state = select_tree(turn.follows(state.rolling), along_rolling(plane, t, state, turn.course), state)
    return state


class _Ahead(NamedTuple):
    """A direction that is to be known ahead of a time, where it is ``needed``: because something begins, or ``goes_on``
    so slowly that its direction has to be known as if it began.

    ``kind`` is what slips or turns, of a body and a state, and ``before`` the direction that was known so far.
    """

    kind: type
    plane: "BodyOnPlane"
    done: Progress
    course: Course
    needed: Bool[Array, ""]
    goes_on: Bool[Array, ""]
    before: Beginning
    longest: Float[Array, ""]

    @property
    def ahead(self) -> Beginning:
        """The direction that does not turn."""
        return select_tree(self.needed, Beginning.along(self.done.t + self.longest, self.course.sigma), self.before)

    def follows(self, found: Any) -> Bool[Array, ""]:
        """Returns whether what goes on follows the direction that was found."""
        return self.goes_on & (found.until > self.done.t)

    def window(self, start: ContactState, needed: Bool[Array, ""] | bool, otherwise: Beginning) -> Beginning:
        """Computes the direction from the state on, if it is needed."""
        what, now = self.kind(self.plane, start), self.done.state.motion
        return jax.lax.cond(
            needed & self.needed,
            lambda: windows.beginning(what, self.done.t, now, self.course, self.longest),
            lambda: otherwise,
        )


def _slip_ahead(plane: "BodyOnPlane", done: Progress, tolerance: Float[Array, ""], longest: Float[Array, ""]) -> _Ahead:
    course, goes_on = follow_slip(plane, done, tolerance)
    course = select_tree(goes_on, course, Course.of(done.state.begun.sigma))
    before = select_tree(done.decides, Beginning.none(done.t, slide_size(plane)), done.state.begun)
    needed = done.begins & plane.slips_end | goes_on
    return _Ahead(_Slipping, plane, done, course, needed, goes_on, before, longest)


def _turn_ahead(plane: "BodyOnPlane", done: Progress, tolerance: Float[Array, ""], longest: Float[Array, ""]) -> _Ahead:
    course, goes_on = follow_rolling(plane, done.t, done.before, done.state, tolerance)
    goes_on &= ~done.turns
    course = select_tree(goes_on, course, Course.of(done.state.rolling.sigma))
    before = select_tree(done.decides, Beginning.none(done.t), done.state.rolling)
    return _Ahead(_Turning, plane, done, course, done.turns | goes_on, goes_on, before, longest)


def _begin_along_line(plane: "BodyOnPlane", done: Progress, longest: Float[Array, ""]) -> ContactState:
    """Returns the state of a disk, which slips and rolls along a line, so that its directions need no search."""
    t, state = done.t, done.state
    begun, rolling = state.begun, state.rolling
    if begun is not None:
        ahead, none = Beginning.along(t + longest, begun.sigma), Beginning.none(t)
        starts = select_tree(done.begins & plane.slips_end, ahead, none)
        begun = select_tree(done.decides, starts, begun)
    if rolling is not None:
        rolling = Beginning.along(jnp.full_like(t, float(jnp.finfo(t.dtype).max)), rolling.sigma)
    return dataclasses.replace(state, begun=begun, rolling=rolling)


ROUNDING = 64  # of the rate that an impact may give a joint, in units of rounding: what is smaller is none


def transition(
    plane: "BodyOnPlane", t: Float[Array, ""], state: ContactState, event: Int[Array, ""], accuracy: Accuracy
) -> Transition:
    """Finds what follows an event that ends a mode, the end of a window, or the start of a run.

    First, a slip that ends is followed to its end, and so is rolling. Next comes an impact, if the body lands, then the
    mode for the velocities after it, and then the direction in which a slip or rolling begins. A negative event means
    none, and the mode continues, with the direction of its velocity.
    """
    heading = without_derivatives(plane).step_reference(*without_derivatives((t, state, accuracy)))
    reference, which = with_fixed_speeds(plane, heading), guard_of(state, event)
    t, before, slope = at_zero(type(plane).guards_in_step, plane, t, state, which, event >= 0, (reference,))
    done, rolling_ends = Progress.of(plane, t, before, event), event == int(SwitchCause.ROLLING_ENDS)
    # A disk is not followed to its rest, in ever shorter steps.
    slows = (event == int(SwitchCause.STOPS)) | rolling_ends & (not plane.body.planar)
    if state.mode is not None:
        done = _only_if(event == int(SwitchCause.STOPS), end_slip, plane, done, accuracy.tolerance)
    if state.rolls is not None:
        done = _only_if(rolling_ends, end_rolling, plane, done, accuracy.tolerance)
    if state.mode is not None:
        done = _only_if(done.lands, strike, plane, done)
    if state.stop_loss is not None:
        strikes = jnp.any(find_struck(plane, done.state, event) != 0)
        done = _only_if(strikes, strike_stop, plane, done, event)
        # What has become of the joint is in its direction.
        after = jnp.where(strikes & (event >= 0), int(SwitchCause.JOINT_STRIKES), event)
        done = _only_if(done.decides, decide, plane, done, after)
    else:
        done = _only_if(done.decides, decide, plane, done, event)
    done = done._replace(state=begin(plane, done, accuracy.tolerance))
    return done.finish(cause_of_event(plane, state, event), slope, pauses=slows)


def _only_if(happens: Bool[Array, ""], stage: Callable[..., "Progress"], plane: Any, done: "Progress", *others: Any):
    """Applies a stage of a transition, if it happens; compiled on its own, it is traced once."""
    return jax.lax.cond(happens, jax.jit(stage), lambda _, done, *others: done, plane, done, *others)


def end_slip(plane: "BodyOnPlane", done: "Progress", tolerance: Float[Array, ""]) -> "Progress":
    """Moves the state to the end of a slip, if it has one soon, with a response that changes linearly with the time."""
    t, state, body = done.t, done.state, plane.body
    sliding, now = slide(plane, t, state), plane.response_on_ground(t, state)
    about = friction.sliding_contact(now), _coefficients(plane, sliding)
    first = slips.end(slips.pull_of_friction, slips.Around(about), sliding)
    ends = first.comes & (first.time <= slips.longest_pause(tolerance, slips.unit_of_time(body)))
    # Where a slip turns, its acceleration is not that of the response halfway: the velocities there are to be the means
    # until the end, for which early accelerations count more.
    half, (mean, late) = slips.HALFWAY * first.time, first.braking(sliding)
    early, pressed = 2 * mean - late, 2 * first.normal - first.late_normal
    moved = rates(body, state.released, now, _amounts(now, early, pressed))
    halfway = _move(state, half, moved)
    later = plane.response_on_ground(t + half, halfway)
    about_later = friction.sliding_contact(later), about[1]
    end = slips.end(slips.pull_of_friction, slips.Around(about, about_later, half), sliding)
    mean, late = end.braking(sliding)
    stopped = _move(state, end.time, rates(body, halfway.released, later, _amounts(later, late, end.late_normal)))
    # What accelerates it more than that is early, with the response of the start.
    amounts = _amounts(now, early + mean - late, pressed + end.normal - end.late_normal)
    more = rates(body, state.released, now, amounts)
    stopped = _move(stopped, end.time, jax.tree.map(jnp.subtract, more, moved))
    stopped = dataclasses.replace(stopped, friction_loss=stopped.friction_loss + end.friction_loss)
    after = done._replace(t=t + end.time, before=stopped, state=stopped, still=jnp.asarray(True))
    # Where no end is near, the slip has only been slow for a while, and the mode goes on.
    return select_tree(ends, after, done._replace(decides=jnp.asarray(False)))


def _amounts(response: Response, slide_acceleration: Float[Array, " n"], N: Float[Array, ""]) -> Array:
    """Computes the amounts where the rate of a slide along the ground and N are given."""
    if response.pivot is not None:
        response = response.with_pivoting(held=True, rate=slide_acceleration[2] / response.pivot)
    return response.amounts(jnp.append(slide_acceleration[:2], 0.0), N)


def _coefficients(plane: "BodyOnPlane", slip: Float[Array, " n"]) -> Float[Array, "3"]:
    """Computes the coefficient of a slip that slows down as a polynomial in the share of its speed, lowest first."""
    none, half, whole = (plane.coefficient(slip, share) for share in (0.0, slips.HALFWAY, 1.0))
    return jnp.stack([none, 4 * (half - none) - (whole - none), 2 * (whole - none) - 4 * (half - none)])


def _move(state: ContactState, time: Float[Array, ""], moved: ReleasedState) -> ContactState:
    """Returns the state after some time at these rates."""
    return state.move(jax.tree.map(lambda x, rate: x + time * rate, state.released, moved))


def strike(plane: "BodyOnPlane", done: "Progress") -> "Progress":
    """Applies an impact, in which no joint is held. A rebound that is too slow is treated as none."""
    t, state, contact = done.t, done.state, plane.law
    # Any direction says that a joint is not held.
    loose = state if state.slips is None else dataclasses.replace(state, slips=jnp.ones_like(state.slips))
    response, slip = plane.response_on_ground(t, loose), slip_velocity(plane.body, t, state.released)
    rebounds = contact.restitution * -slip[2] > slowest_rise(plane, response)
    e = jnp.where(rebounds, contact.restitution, 0.0)
    after = impact(plane.body, t, state.released, response, plane.coefficient(slip), e)
    # Without a rebound exactly zero: the rounding that is left would make the body fly, or sink.
    rise = jnp.where(rebounds, slip_velocity(plane.body, t, after.state)[2], 0.0)
    V = with_rise(plane.body, t, after.state, rise)
    bounced = state.move(ReleasedState(after.state.body, V, state.height))
    bounced = dataclasses.replace(bounced, impact_loss=state.impact_loss - after.work)
    if state.slips is not None:
        bounced = dataclasses.replace(bounced, slips=_find_struck_joints(plane, t, state, bounced, response))
    flies = done.flies | (rise > 0)
    # With a limit surface a body that still spins slides, even if its slip has ended.
    still = done.still | after.collision.sticks if plane.pivot is None else done.still
    return done._replace(state=bounced, still=still, flies=flies)


def _find_struck_joints(
    plane: "BodyOnPlane", t: Float[Array, ""], before: ContactState, after: ContactState, of_impulse: Response
) -> Float[Array, " sticking"]:
    """Returns the directions of joints after an impact: each slips as it then moves."""
    slots, eps = sticking_slots(plane.body), float(jnp.finfo(after.V.dtype).eps)
    rate, gains = after.body.thetadot[slots], jnp.abs(of_impulse.yielding.thetaddot[:, slots])
    change = slip_velocity(plane.body, t, after.released) - slip_velocity(plane.body, t, before.released)
    least = jnp.sqrt(jnp.sum(change**2)) * jnp.max(gains, axis=0) + jnp.abs(before.body.thetadot[slots])
    # The largest rate that such an impact could give the joint: what is rounding of it did not set it in motion.
    directions = jnp.where(jnp.abs(rate) <= ROUNDING * eps * least, 0.0, jnp.sign(rate))
    if before.stop_loss is not None:
        rests = (directions == 0) & (before.slips == 0)
        directions = jnp.where(rubs(plane.body), directions, jnp.where(rests, 0.0, 1.0))
    return jax.lax.stop_gradient(directions)
