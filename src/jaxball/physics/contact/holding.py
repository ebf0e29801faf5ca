"""Decides what dry friction holds where a mode of a body on its ground ends, and finds how the rest begins to move.

Everything that
does not move is held, as far as friction can do it: the most overloaded of the contact, of rolling, of spinning and of
the joints lets go first. A slip and rolling that begin at the same time each depend on the direction of the other, and
their windows are computed in turn.
"""

import dataclasses
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ...numerics.arrays import select_tree
from ...numerics.directions import diverging, unit
from ...programs.derivatives.differentiation import without_derivatives
from ..body import AbstractBody
from ..dynamics.footing import in_three
from ..dynamics.law import release
from ..dynamics.rest import candidates, let_go, needs
from ..dynamics.sticking import change_joint, loosen, overloads, with_directions
from ..forces.resistance import TurningMode
from ..hybrid import START
from . import friction, slip as slips, window as windows
from .guards import FIRST_OF_JOINTS, rounding_of_force
from .modes import ContactState, Mode, SwitchCause
from .progress import Progress
from .released import (
    ReleasedState,
    Response,
    in_space,
    rates,
    response,
    rolling_contact,
    slip_velocity,
    with_rise,
    with_slip,
)
from .window import Beginning, Course

if TYPE_CHECKING:
    from .body_on_plane import BodyOnPlane

TURNS_TAKEN = 6  # by the windows of a slip and of rolling that begin together


# The end of rolling.


class _Rolling(NamedTuple):
    """A body that rolls: how it is ``pulled`` and its response depend on a mode of turning."""

    plane: "BodyOnPlane"
    at: Any
    mode: TurningMode
    contact: friction.SolvedContact
    mu: Float[Array, ""]
    sigma: Float[Array, "2"]

    @classmethod
    def of(cls, plane: "BodyOnPlane", t: Float[Array, ""], state: ContactState, mode: TurningMode) -> "_Rolling":
        """Describes the rolling of a body at a state, in a mode of turning."""
        slip, response = slip_velocity(plane.body, t, state.released), plane.response(t, state, mode)
        contact = friction.SolvedContact.of(response, state.is_in(Mode.SLIDING), jnp.asarray(False))
        return cls(plane, state, mode, contact, plane.coefficient(slip), state.direction(t, slip))

    def act(self, sigma: Float[Array, "2"]) -> friction.Interaction:
        """Computes what acts where it rolls in a direction."""
        law = self.plane.law_of_turning(self.at, self.mode._replace(sigma=in_three(sigma)))
        return self.contact.with_turning(law).interaction(self.mu, self.sigma)

    def pull(self, sigma: Float[Array, "2"], _: Float[Array, ""]) -> slips.Pull:
        """Computes how ω_h changes in a direction of rolling."""
        acting = self.act(sigma)
        return slips.Pull(acting.rate[:2], -jnp.sum(sigma * acting.torque[:2]), acting.normal)

    def rates(self, state: ContactState, sigma: Float[Array, "2"]) -> ReleasedState:
        """Computes ẋ where it rolls in a direction, or is braked."""
        return rates(self.plane.body, state.released, self.contact.response, self.act(sigma).amounts)


def end_rolling(plane: "BodyOnPlane", done: Progress, tolerance: Float[Array, ""]) -> Progress:
    """Moves the state to the end of rolling, if it has one soon, with what acts halfway."""
    state: Any = done.state
    if plane.body.planar:
        return done._replace(stands=jnp.asarray(True))
    t, omega = done.t, plane.over_ground(done.t, state)[:2]
    rolling = plane.mode(t, state, unit(omega))

    def end(t: Float[Array, ""], where: Any) -> slips.End:
        return slips.end(_Rolling.pull, slips.Around(_Rolling.of(plane, t, where, rolling)), omega)

    def brake(t: Float[Array, ""], where: Any, time: Float[Array, ""], share: float) -> Any:
        rate = -omega / jnp.where(time > 0, time, 1.0)
        # The mean rate until the end, so that ω_h is then zero; the torque is whatever this needs.
        held = rolling._replace(rests=jnp.asarray(True), braking=in_three(rate))
        moved = _Rolling.of(plane, t, where, held).rates(where, held.sigma[:2])
        return state.move(jax.tree.map(lambda x, rate: x + share * time * rate, state.released, moved))

    first = end(t, state)
    halfway = brake(t, state, first.time, slips.HALFWAY)
    middle = t + slips.HALFWAY * first.time
    second = end(middle, halfway)
    ends = plane.comes_to_rest(first, second, omega, tolerance)
    stopped = brake(middle, halfway, second.time, 1.0).projected()
    axes = plane.contact_axes(t + second.time, stopped)
    spin = axes.over_ground(stopped.body.Omega)[2]
    at_rest = stopped.body.with_Omega(axes.in_body(jnp.stack([0 * spin, 0 * spin, spin])))
    stopped = dataclasses.replace(stopped, body=at_rest)
    after = done._replace(t=t + second.time, before=stopped, state=stopped, stands=jnp.asarray(True))
    return select_tree(ends, after, done._replace(decides=jnp.asarray(False)))


# The next mode.


class Choice(NamedTuple):
    """What is held: whether the contact ``sticks``, or the body ``flies``, with the direction of a slip.

    ``mode`` says it of rolling and spinning, and the directions ``slips`` of joints, 0 where they stick; each is None
    where nothing of the kind may be held.
    """

    sticks: Bool[Array, ""]
    flies: Bool[Array, ""]
    sigma: Float[Array, "2"]
    mode: TurningMode | None
    slips: Float[Array, " sticking"] | None


class Deciding(NamedTuple):
    """A body of which it is decided what is held.

    ``at`` is its state, ``response`` its response where all joints are as they are there. ``still`` says that it does
    not slip, ``mu`` is the coefficient of sliding friction.
    """

    plane: Any
    t: Float[Array, ""]
    at: ReleasedState
    response: Response
    still: Bool[Array, ""]
    mu: Float[Array, ""]

    def respond(self, choice: Choice) -> Response:
        """Computes the response where some things are held."""
        responds = self.response
        if choice.slips is not None:
            # Joints that stick are in the matrix of the equations.
            body = with_directions(self.plane.body, choice.slips)
            responds = response(body, self.t, self.at, touching=~choice.flies)
            responds = responds._replace(turned=self.response.turned)
        return (
            responds if choice.mode is None else responds.with_turning(self.plane.law_of_turning(self.at, choice.mode))
        )

    def first_slip(self, choice: Choice, responds: Response) -> Float[Array, "2"]:
        """Finds the direction in which a slip begins, if one does."""
        begins = self.still & ~choice.sticks & ~choice.flies
        return jax.lax.cond(begins, lambda: friction.first_slip(responds, self.mu).sigma, lambda: choice.sigma)

    def first_rolling(self, choice: Choice) -> Float[Array, "3"]:
        """Finds the direction in which rolling begins."""
        assert choice.mode is not None
        contact = friction.SolvedContact.of(self.respond(choice), ~choice.sticks & ~choice.flies, choice.flies)
        rolling = _Rolling(self.plane, self.at, choice.mode, contact, self.mu, choice.sigma)
        return in_three(diverging(_pull, rolling, jax.lax.stop_gradient(choice.mode.sigma[:2])).sigma)

    def weigh(self, choice: Choice) -> tuple[Float[Array, " loads"], tuple[Choice, Any, Any]]:
        """Computes the loads of all that may be held, with the choice, and the torque and friction that hold it."""
        responds = self.respond(choice)
        choice = choice._replace(sigma=self.first_slip(choice, responds))
        slides, slack = ~choice.sticks & ~choice.flies, rounding_of_force(self.plane, self.at, responds)
        acting = friction.SolvedContact.of(responds, slides, choice.flies).interaction(self.mu, choice.sigma)
        of_friction = friction.overload(acting.R, self.plane.contact.static_friction, slack, choice.sticks)
        # A body that nothing presses on its ground leaves it before anything else lets go.
        loads = [jnp.where(slides & ~(-slack < acting.R[2]), jnp.inf, of_friction)[None]]
        torque = holding = None
        if choice.mode is not None:
            torque = acting.torque
            need = needs(
                self.plane.resistance, self.plane.body.height_of_centre(self.at.body.Gamma), torque, acting.normal
            )
            loads.append(need.overloads(choice.mode))
        if choice.slips is not None:
            holding = responds.part("holding", acting.amounts)
            loads.append(overloads(self.plane.body, choice.slips, holding))
        return jnp.concatenate(loads), (choice, torque, holding)

    def let_go(self, _: Choice, acting: tuple[Choice, Any, Any], off: Bool[Array, " loads"]) -> Choice:
        """Returns the choice after some things have let go; in flight the ground holds nothing."""
        choice, torque, holding = acting
        leaves, mode, slips = off[0] & ~choice.sticks, choice.mode, choice.slips
        if mode is not None:
            mode = let_go(mode, torque, off[1:3])
            mode = mode._replace(rests=mode.rests & ~leaves, still=mode.still & ~leaves)
        if slips is not None:
            slips = loosen(slips, holding, off[-slips.size :])
        return Choice(choice.sticks & ~off[0], choice.flies | leaves, choice.sigma, mode, slips)

    def choose(self, choice: Choice, at_once: Bool[Array, " loads"]) -> Choice:
        """Finds the choice when nothing is overloaded; it has no derivatives but those from the given one."""
        still, held = without_derivatives((self, choice))
        last = release(held, still.weigh, still.let_go, at_once)
        # What slipped and rolled before does so on, in its own direction, with its derivatives.
        last = last._replace(sigma=jnp.where(self.still, last.sigma, choice.sigma))
        if choice.mode is None or last.mode is None:
            return last
        turned = choice.mode.rests & ~last.mode.rests
        return last._replace(mode=last.mode._replace(sigma=jnp.where(turned, last.mode.sigma, choice.mode.sigma)))

    def direct(self, choice: Choice, turns: Bool[Array, ""]) -> Choice:
        """Returns the choice with the directions in which a slip and rolling that begin grow."""

        def next_choice(choice: Choice, _: None) -> tuple[Choice, None]:
            # The direction of each depends on that of the other, so they are found in turn until neither changes.
            choice = choice._replace(sigma=self.first_slip(choice, self.respond(choice)))
            if choice.mode is None or self.plane.body.planar:
                return choice, None
            sigma = choice.mode.sigma
            rolling = jax.lax.cond(turns, lambda: self.first_rolling(choice), lambda: sigma)
            return choice._replace(mode=choice.mode._replace(sigma=rolling)), None

        if choice.mode is None:
            return next_choice(choice, None)[0]
        return jax.lax.scan(next_choice, choice, None, length=TURNS_TAKEN)[0]


def _pull(rolling: _Rolling, sigma: Float[Array, "2"]) -> tuple[Float[Array, "2"], Float[Array, ""]]:
    acting = rolling.act(sigma)
    return acting.rate[:2], acting.normal


def decide(plane: "BodyOnPlane", done: Progress, event: Int[Array, ""]) -> Progress:
    """Decides the mode that follows: everything is held as far as friction can do it."""
    t, body = done.t, plane.body
    before, moving, loose = _all_held(plane, done, event)
    slip, responds = slip_velocity(body, t, before.released), plane.response_on_ground(t, before)
    still = done.still | plane.is_still(slip, before)
    deciding = Deciding(plane, t, before.released, responds, still, plane.coefficient(jnp.where(still, 0.0, slip)))
    # Without static friction a body never rolls, not even one that would need no friction to. Friction that has just
    # given way is at its limit, so by rounding it may seem to be enough.
    sticks = still & (plane.contact.static_friction > 0) & (event != int(SwitchCause.GIVES_WAY)) & ~done.flies
    sigma = friction.slip_direction(slip, jnp.zeros_like(slip[:2]))
    choice = deciding.choose(Choice(sticks, done.flies, sigma, moving, before.slips), loose)
    turns = done.turns
    if moving is not None and choice.mode is not None:
        turns = moving.rests & ~choice.mode.rests & ~choice.flies
    choice = deciding.direct(choice, turns)
    # The rest of a slip that ends is dissipated by friction; one without an end continues.
    stopped = with_slip(body, before.released, deciding.respond(choice), slip, jnp.zeros_like(slip))
    state: Any = select_tree(still & ~choice.flies & (choice.sticks | plane.slips_end), before.move(stopped), before)
    # Where the normal force falls to zero, a body leaves with no speed: what there is of it is rounding.
    rise = slip_velocity(body, t, state.released)[2]
    rise = jnp.where(choice.flies & (event != int(SwitchCause.LIFTS)), rise, 0.0)
    V = with_rise(body, t, state.released, rise)
    mode = jnp.where(choice.flies, int(Mode.FLIGHT), jnp.where(choice.sticks, int(Mode.ROLLING), int(Mode.SLIDING)))
    # Takes σ to ``begin``, which puts the window in its place, or none.
    begun = Beginning.along(t, choice.sigma)
    after = dataclasses.replace(state, V=V, mode=mode.astype(V.dtype), begun=begun, slips=choice.slips)
    begins = still & ~choice.sticks & ~choice.flies
    return done._replace(state=_turning_as_chosen(plane, t, after, choice), begins=begins, turns=turns)


def _all_held(
    plane: "BodyOnPlane", done: Progress, event: Int[Array, ""]
) -> tuple[Any, TurningMode | None, Bool[Array, " loads"]]:
    """Returns the state and the mode of turning where all is held that stands, and which loads the event has loosened:
    of the contact, of rolling and spinning, and of joints.
    """
    state, moving, loose = done.state, None, [jnp.zeros(1, bool)]
    if state.slips is not None:
        slips, thetadot = change_joint(plane.body, state.slips, state.body.thetadot, event - FIRST_OF_JOINTS)
        state = eqx.tree_at(lambda x: (x.body.thetadot, x.slips), state, (thetadot, slips))
    if state.rolls is not None:
        # A body that lands still has the mode of flight here; any mode on the ground says that it touches.
        axes = plane.contact_axes(done.t, dataclasses.replace(state, mode=jnp.full_like(state.mode, int(Mode.SLIDING))))
        omega = plane.unless_held(state, axes.over_ground(state.body.Omega))
        # At the end of its rolling or spinning, the rate is 0, not nearly.
        spin_ends = event == int(SwitchCause.SPINNING_ENDS)
        omega = jnp.where(jnp.stack([done.stands, done.stands, spin_ends]), 0.0, omega)
        moving = candidates(plane.resistance, omega, plane.body.planar)
        # A body that rolls comes to rest by an event that says so, and not because its rate is rounding, as just after
        # it broke loose. In flight the ground holds nothing.
        may_rest = (event == START) | done.stands | done.lands | (state.rolls == 0)
        moving = moving._replace(rests=moving.rests & may_rest & ~done.flies, still=moving.still & ~done.flies)
        breaks, spins = event == int(SwitchCause.BREAKS_LOOSE), event == int(SwitchCause.BEGINS_TO_SPIN)
        loose.append(jnp.stack([moving.rests & breaks, moving.still & spins]))
        state = dataclasses.replace(state, body=state.body.with_Omega(axes.in_body(omega)))
    if state.slips is not None:
        loose.append(jnp.zeros(state.slips.size, bool))
    return state, moving, jnp.concatenate(loose)


def _turning_as_chosen(plane: "BodyOnPlane", t: Float[Array, ""], state: ContactState, choice: Choice) -> ContactState:
    """Returns the state in the mode of turning of a choice."""
    mode, dtype = choice.mode, state.V.dtype
    if mode is None:
        return state
    spin = mode.spin if plane.resists_spinning else jnp.zeros_like(mode.spin)
    # In flight the ground holds nothing, and 0 would say that it does.
    spin = jnp.where(choice.flies & (spin == 0), 1.0, spin).astype(dtype)
    rolls, rolling = jnp.where(mode.rests, 0.0, 1.0).astype(dtype), Beginning.along(t, mode.sigma[:2])
    return dataclasses.replace(state, rolls=rolls, spin=spin, rolling=rolling)


# The windows in which directions are known beforehand.


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
    ) -> tuple[Float[Array, "2"], ReleasedState]:
        """Computes the slip acceleration along the plane, and ẋ."""
        contact, mu = prepare
        acting = contact.interaction(mu, sigma)
        return acting.slip_acceleration[:2], rates(self.plane.body, state, contact.response, acting.amounts)


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


class _Turning(NamedTuple):
    """A ball that begins to roll, in the modes of ``begins``."""

    plane: Any
    begins: Any

    @property
    def body(self) -> AbstractBody:
        """What is in motion, in the modes of its joints."""
        return self.plane.moving(self.begins)

    def prepare(self, t: Float[Array, ""], state: ReleasedState) -> _Rolling:
        now = self.begins.move(state)
        return _Rolling.of(self.plane, t, now, self.plane.mode(t, now))

    def pull(
        self, t: Float[Array, ""], state: ReleasedState, prepare: _Rolling, sigma: Float[Array, "2"]
    ) -> tuple[Float[Array, "2"], ReleasedState]:
        """Computes the rate of ω_h over the ground, in contact axes, and ẋ."""
        acting = prepare.act(sigma)
        return acting.rate[:2], rates(self.plane.body, state, prepare.contact.response, acting.amounts)


def begin(plane: "BodyOnPlane", done: Progress, tolerance: Float[Array, ""]) -> ContactState:
    """Returns the state with the directions of a slip and of rolling that begin or stay slow, for as long as they are
    computed in advance.
    """
    t, state, begins = done.t, done.state, done.begins & plane.slips_end
    longest = windows.longest_window(t, plane.driving_kinks(), slips.unit_of_time(plane.body))
    sigma, none = state.begun.sigma, Beginning.none(t)
    # A disk slips, and rolls, along a line, so its directions need no search.
    if plane.body.planar:
        begun = select_tree(begins, Beginning.along(t + longest, sigma), none)
        begun, rolling = select_tree(done.decides, begun, state.begun), state.rolling
        if rolling is not None:
            rolling = Beginning.along(jnp.full_like(t, float(jnp.finfo(t.dtype).max)), rolling.sigma)
        return dataclasses.replace(state, begun=begun, rolling=rolling)
    # What goes on, but so slowly that its direction has to be known beforehand as if it began.
    course, slips_on = follow_slip(plane, done, tolerance)
    course, begins = select_tree(slips_on, course, Course.of(sigma)), begins | slips_on

    def window(state: ContactState, needed: Bool[Array, ""], otherwise: Beginning) -> Beginning:
        return jax.lax.cond(
            needed,
            lambda: windows.beginning(_Slipping(plane, state), t, done.state.released, course, longest),
            lambda: otherwise,
        )

    if state.rolling is None:
        begun = window(state, begins, none)
        state = select_tree(slips_on & (begun.until > t), along_course(plane, t, state, course), state)
        return dataclasses.replace(state, begun=begun)
    turn, turns_on = plane.follow_rolling(t, done.before, state, tolerance)
    turns_on &= ~done.turns
    turn, turns = select_tree(turns_on, turn, Course.of(state.rolling.sigma)), done.turns | turns_on

    def next_windows(start: Any, first: Bool[Array, ""]) -> tuple[Any, None]:
        # One window alone is final after the first pass; only two that depend on each other are computed again.
        needed = first | begins & turns & (start.begun.until > t) & (start.rolling.until > t)
        start = dataclasses.replace(start, begun=window(start, needed & begins, start.begun))
        turning = jax.lax.cond(
            needed & turns,
            lambda: windows.beginning(_Turning(plane, start), t, state.released, turn, longest),
            lambda: start.rolling,
        )
        return dataclasses.replace(start, rolling=turning), None

    # The first guess of a direction that is found in turn with the other: the one in which it begins.
    ahead = Beginning.along(t + longest, course.sigma), Beginning.along(t + longest, turn.sigma)
    previous = select_tree(done.decides, none, state.begun), select_tree(done.decides, none, state.rolling)
    begun, rolling = select_tree(begins, ahead[0], previous[0]), select_tree(turns, ahead[1], previous[1])
    start: Any = dataclasses.replace(state, begun=begun, rolling=rolling)
    start = jax.lax.scan(next_windows, start, jnp.arange(TURNS_TAKEN) == 0)[0]
    start = select_tree(slips_on & (start.begun.until > t), along_course(plane, t, start, course), start)
    return select_tree(turns_on & (start.rolling.until > t), plane.along_course(t, start, turn), start)
