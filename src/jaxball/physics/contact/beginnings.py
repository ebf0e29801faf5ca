"""How a slip and rolling begin: the directions in which they grow, for as long as they are computed in advance.

``window`` computes one of them. Those of a slip and of rolling that begin at the same time each depend on the other,
and are computed in turn.
"""

import dataclasses
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...numerics.arrays import select_tree
from ...numerics.vectors import in_three
from ..body import AbstractBody
from ..dynamics.rest import TurningMode
from . import friction, slip as slips, window as windows
from .holding import TURNS_TAKEN, Rolling
from .modes import ContactState, Mode
from .progress import Progress
from .released import ReleasedState, rates, slip_velocity
from .slide import slide, slide_size, with_slide
from .turning import along_rolling, follow_rolling
from .window import Beginning, Course

if TYPE_CHECKING:
    from .body_on_plane import BodyOnPlane


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
        mode = self.plane.mode(t, now)
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
