"""Finds the next mode where a mode of ``resting`` ends, and the state with which it begins, as ``transition`` does.

Everything that does not move is held, as far as friction and dry resistance can do it: the most overloaded of them lets
go first. A slip and rolling that begin at the same time each depend on the direction of the other, and their windows
are computed in turn.
"""

from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ...numerics.arrays import select_tree
from ...numerics.directions import diverging, unit
from ...programs.derivatives.differentiation import without_derivatives
from ..body import AbstractBody
from ..dynamics.load import in_three
from ..dynamics.rest import candidates, resist
from ..forces.resistance import TurningMode
from ..hybrid import START, Accuracy, Transition, at_zero
from . import friction, slip as slips, window as windows
from .modes import CAUSES, Mode, SwitchCause
from .released import ReleasedState, Response, rates, slip_velocity, with_rise, with_slip
from .resisted import Resisting
from .slip import Heading
from .transition import Progress, along_course, end_slip, follow_slip, only_if, strike
from .window import Beginning, Course

if TYPE_CHECKING:
    from .resting import RestingOnPlane, RestingState


class Headings(NamedTuple):
    """The headings of a slip and of rolling as a step begins."""

    slip: Heading
    rolling: Heading


RELEASES = 3  # at most: against slip, rolling and spinning
TURNS_TAKEN = 6  # by the windows of a slip and of rolling that begin together


def transition(
    plane: "RestingOnPlane", t: Float[Array, ""], state: "RestingState", cause: Int[Array, ""], accuracy: Accuracy
) -> Transition:
    """Finds what follows a :class:`SwitchCause` for which a mode ends, the end of a window, or the start of a run."""
    slip, rolling = without_derivatives(plane).step_reference(*without_derivatives((t, state, accuracy)))
    # A ball's rolling is given to ``_end_rolling`` while it still has this speed, which counts as fixed. That of a disk
    # does not turn, and is followed to exactly zero.
    least = jnp.zeros_like(rolling.speed) if plane.body.planar else rolling.speed
    heading = Headings(slip._replace(least=slip.speed), rolling._replace(least=least))
    turns, spins = (_is_one_of(cause, *causes) for causes in (_ROLLING, _SPINNING))
    of_contact = jnp.argmax(jnp.asarray(CAUSES)[state.mode.astype(int)] == cause)
    which = jnp.where(turns, len(CAUSES), jnp.where(spins, len(CAUSES) + 1, of_contact))
    guards = type(plane).guards_in_step
    t, before, slope = at_zero(guards, plane, t, state, which, cause >= 0, (heading,))
    done = _next_mode(plane, t, before, cause, accuracy.tolerance)
    slows = _is_one_of(cause, SwitchCause.STOPS) | _is_one_of(cause, SwitchCause.ROLLING_ENDS) & (not plane.body.planar)
    return done.finish(cause, slope, pauses=slows)


_ROLLING = SwitchCause.ROLLING_ENDS, SwitchCause.BREAKS_LOOSE
_SPINNING = SwitchCause.SPINNING_ENDS, SwitchCause.BEGINS_TO_SPIN


def _is_one_of(cause: Int[Array, ""], *causes: SwitchCause) -> Bool[Array, ""]:
    return jnp.any(jnp.stack([cause == int(each) for each in causes]))


def _next_mode(
    plane: "RestingOnPlane",
    t: Float[Array, ""],
    state: "RestingState",
    cause: Int[Array, ""],
    tolerance: Float[Array, ""],
) -> Progress:
    """Finds the state that follows the end of a mode: after the end of a slip or of rolling, or an impact."""
    done, no = Progress.of(plane, t, state, cause), jnp.asarray(False)
    # The end of one window leaves the other in force; a new mode leaves neither.
    none = Beginning.none(state.height)
    begun, rolling = (select_tree(done.decides | (x.until <= t), none, x) for x in (state.begun, state.rolling))
    if plane.body.planar:
        rolling = state.rolling  # that of a disk does not turn
    now = eqx.tree_at(lambda x: (x.begun, x.rolling), done.state, (begun, rolling))
    done = done._replace(state=now, stands=no, turns=no)
    done = only_if(cause == int(SwitchCause.STOPS), end_slip, plane, done, tolerance)
    done = only_if(cause == int(SwitchCause.ROLLING_ENDS), _end_rolling, plane, done, tolerance)
    done = only_if(done.lands, strike, plane, done)
    done = only_if(done.decides, _decide, plane, done, cause)
    return done._replace(state=_begin(plane, done, tolerance))


# The end of rolling.


class _Rolling(NamedTuple):
    """A body that rolls: before its mode of turning is known, that mode, and the mode of its contact."""

    resisting: Resisting
    mode: TurningMode
    slides: Bool[Array, ""]
    mu: Float[Array, ""]
    sigma: Float[Array, "2"]

    @classmethod
    def of(cls, plane: "RestingOnPlane", t: Float[Array, ""], state: "RestingState") -> "_Rolling":
        """Describes the rolling of a body at a state."""
        slip = slip_velocity(plane.body, t, state.released)
        mu, sigma = plane.coefficient(slip), state.direction(t, slip)
        mode = plane.mode(t, state)
        return cls(plane.resisting(t, state), mode, state.is_in(Mode.SLIDING), mu, sigma)

    def pull(self, sigma: Float[Array, "2"], _: Float[Array, ""]) -> slips.Pull:
        """Computes how ω_h changes in a direction of rolling."""
        turning = self.resisting.turning(self.slides, self.mu, self.sigma)
        acting = resist(self.resisting.resistance, turning, self.mode._replace(sigma=in_three(sigma)))
        return slips.Pull(acting.rate[:2], -jnp.sum(sigma * acting.torque[:2]), acting.normal)

    def rates(self, body: Any, state: "RestingState", mode: TurningMode) -> ReleasedState:
        """Computes ẋ in a mode of turning."""
        response = self.resisting.resist_turning(self.resisting.torque(mode))
        acting = self.interaction(response)
        return rates(body, state.released, response, acting.slip_acceleration, acting.normal)

    def interaction(self, response: Response) -> friction.Interaction:
        """Computes the reaction of the plane."""
        return select_tree(self.slides, friction.sliding(response, self.mu, self.sigma), friction.rolling(response))


def _end_rolling(plane: "RestingOnPlane", done: Progress, tolerance: Float[Array, ""]) -> Progress:
    """Moves the state to the end of rolling, if it has one soon, with what acts halfway."""
    state: Any = done.state
    if plane.body.planar:
        return done._replace(stands=jnp.asarray(True))
    t, omega = done.t, plane.over_ground(done.t, state)[:2]

    def end(about: _Rolling) -> slips.End:
        about = about._replace(mode=plane.mode(t, state, unit(omega)))
        return slips.end(_Rolling.pull, slips.Around(about), omega)

    def brake(about: _Rolling, time: Float[Array, ""], share: float, where: Any) -> Any:
        rate = -omega / jnp.where(time > 0, time, 1.0)
        # The mean rate until the end, so that ω_h is then zero; the torque is whatever this needs.
        held = about.mode._replace(rests=jnp.asarray(True), braking=in_three(rate))
        moved = about.rates(plane.body, where, held)
        return state.move(jax.tree.map(lambda x, rate: x + share * time * rate, state.released, moved))

    about = _Rolling.of(plane, t, state)
    first = end(about)
    halfway = brake(about, first.time, slips.HALFWAY, state)
    about = _Rolling.of(plane, t + slips.HALFWAY * first.time, halfway)
    second = end(about)
    ends = plane.comes_to_rest(first, second, omega, tolerance)
    stopped = brake(about, second.time, 1.0, halfway).projected()
    axes = plane.contact_axes(t + second.time, stopped)
    spin = axes.over_ground(stopped.body.Omega)[2]
    at_rest = stopped.body.with_Omega(axes.in_body(jnp.stack([0 * spin, 0 * spin, spin])))
    stopped = eqx.tree_at(lambda x: x.body, stopped, at_rest)
    after = done._replace(t=t + second.time, before=stopped, state=stopped, stands=jnp.asarray(True))
    return select_tree(ends, after, done._replace(decides=jnp.asarray(False)))


# The next mode.


class _Choice(NamedTuple):
    """Whether the contact and, in ``mode``, rolling and spinning are held, and their directions where they are not."""

    sticks: Bool[Array, ""]
    sigma: Float[Array, "2"]
    mode: TurningMode


class _Deciding(NamedTuple):
    """A body of which it is decided what is held.

    ``still`` says that it does not slip, ``mu`` is the coefficient of sliding friction.
    """

    resisting: Resisting
    still: Bool[Array, ""]
    mu: Float[Array, ""]
    static: Float[Array, ""]
    slack: Float[Array, ""]

    def response(self, choice: _Choice) -> Response:
        """Computes the response where some things are held."""
        return self.resisting.resist_turning(self.resisting.torque(choice.mode))

    def first_slip(self, choice: _Choice) -> Float[Array, "2"]:
        """Finds the direction in which a slip begins."""
        return friction.first_slip(self.response(choice), self.mu).sigma

    def first_rolling(self, choice: _Choice) -> Float[Array, "3"]:
        """Finds the direction in which rolling begins."""
        sigma = diverging(_pull, (self, choice), jax.lax.stop_gradient(choice.mode.sigma[:2])).sigma
        return in_three(sigma)

    def with_one_less(self, choice: _Choice, at_once: Bool[Array, "3"]) -> _Choice:
        """Returns the choice in which the most overloaded of the contact, rolling and spinning has let go; or those
        that let go ``at_once``, if any do.
        """
        sigma = jax.lax.cond(self.still & ~choice.sticks, lambda: self.first_slip(choice), lambda: choice.sigma)
        torque = self.resisting.torque(choice.mode)
        response = self.resisting.resist_turning(torque)
        acting = select_tree(choice.sticks, friction.rolling(response), friction.sliding(response, self.mu, sigma))
        T, need = torque(acting.slip_acceleration, acting.normal), self.resisting.spare(torque, acting)
        N = acting.R[2]
        spare = friction.margin(acting.R, self.static) + self.slack
        # A square of a share, as the loads of resistance are; the least divisor keeps it within the range of numbers.
        load = jnp.sum(acting.R[:2] ** 2) / jnp.maximum(self.static * N, float(jnp.finfo(N.dtype).tiny) ** 0.25) ** 2
        held = jnp.stack([choice.sticks, choice.mode.rests, choice.mode.still])
        fails = held & ~(jnp.stack([jnp.minimum(spare, N + self.slack), need.rolling, need.spinning]) > 0)
        loads = jnp.where(fails, jnp.concatenate([load[None], need.loads]), -jnp.inf)
        most = fails & (loads == jnp.max(loads))
        # Of several that are equally overloaded the first alone lets go: that may relieve the others.
        most &= jnp.cumsum(most) == 1
        off = jnp.where(jnp.any(at_once), at_once & held, most)
        against, spin = -unit(T[:2]), -jnp.sign(T[2])
        # A disk only rolls about e2.
        if self.resisting.axle is not None:
            against = against.at[0].set(0.0)
        mode = choice.mode._replace(
            sigma=jnp.where(off[1], in_three(against), choice.mode.sigma),
            spin=jnp.where(off[2], spin, choice.mode.spin),
            rests=choice.mode.rests & ~off[1],
            still=choice.mode.still & ~off[2],
        )
        return _Choice(choice.sticks & ~off[0], sigma, mode)


def _pull(about: tuple[_Deciding, _Choice], sigma: Float[Array, "2"]) -> tuple[Float[Array, "2"], Float[Array, ""]]:
    deciding, choice = about
    turning = deciding.resisting.turning(~choice.sticks, deciding.mu, choice.sigma)
    acting = resist(deciding.resisting.resistance, turning, choice.mode._replace(sigma=in_three(sigma)))
    return acting.rate[:2], acting.normal


def _decide(plane: "RestingOnPlane", done: Progress, cause: Int[Array, ""]) -> Progress:
    """Decides the mode that follows: everything is held as far as friction and dry resistance can do it."""
    t, body, contact = done.t, plane.body, plane.contact
    assert done.stands is not None
    before, omega = _clean(plane, done, cause)
    # A body that lands still has the mode of flight here; any mode on the ground says that it touches.
    touching: Any = eqx.tree_at(lambda x: x.mode, before, jnp.full_like(before.mode, int(Mode.SLIDING)))
    slip, resisting = slip_velocity(body, t, before.released), plane.resisting(t, touching)
    still = done.still | plane.is_still(slip, before)
    mu = plane.coefficient(jnp.where(still, 0.0, slip))
    slack = plane.rounding_of_force(before, resisting.response)
    deciding = _Deciding(resisting, still, mu, contact.static_friction, slack)
    moving = candidates(resisting.resistance, resisting.bare, omega)
    # A body that rolls comes to rest by an event that says so, and not because its rate is rounding, as just after it
    # broke loose.
    may_rest = (cause == START) | done.stands | done.lands | (before.rolls == 0)
    moving = moving._replace(rests=moving.rests & may_rest)
    gives_way = cause == int(SwitchCause.GIVES_WAY)
    sticks = still & (contact.static_friction > 0) & ~gives_way
    sigma = friction.slip_direction(slip, jnp.zeros_like(slip[:2]))
    at_once = jnp.stack(
        [jnp.asarray(False), cause == int(SwitchCause.BREAKS_LOOSE), cause == int(SwitchCause.BEGINS_TO_SPIN)]
    )
    choice = _choose(deciding, _Choice(sticks, sigma, moving), at_once)
    slips_now, turns = still & ~choice.sticks, moving.rests & ~choice.mode.rests
    choice = _direct(deciding, choice, slips_now, turns, plane.body.planar)
    response = deciding.response(choice)
    # A contact that sticks has been found to press, or it would have let go.
    flies = done.flies | ~choice.sticks & ~(friction.sliding(response, mu, choice.sigma).normal > -slack)
    # The rest of a slip that ends is dissipated by friction; one without an end continues.
    stopped = with_slip(body, before.released, response, slip, jnp.zeros_like(slip))
    state: Any = select_tree(still & ~flies & (choice.sticks | plane.slips_end), before.move(stopped), before)
    rise = slip_velocity(body, t, state.released)[2]
    V = with_rise(body, t, state.released, jnp.where(flies & (cause != int(SwitchCause.LIFTS)), rise, 0.0))
    mode = jnp.where(flies, int(Mode.FLIGHT), jnp.where(choice.sticks, int(Mode.ROLLING), int(Mode.SLIDING)))
    # In flight the ground holds nothing, and 0 would say that it does.
    rolls = jnp.where(choice.mode.rests & ~flies, 0.0, 1.0).astype(V.dtype)
    spin = choice.mode.spin if plane.resists_spinning else jnp.zeros_like(choice.mode.spin)
    spin = jnp.where(flies & (spin == 0), 1.0, spin).astype(V.dtype)
    begun, rolling = Beginning.along(t, choice.sigma), Beginning.along(t, choice.mode.sigma[:2])
    after = eqx.tree_at(
        lambda x: (x.V, x.mode, x.begun, x.rolls, x.spin, x.rolling),
        state,
        (V, mode.astype(V.dtype), begun, rolls, spin, rolling),
    )
    return done._replace(state=after, begins=slips_now & ~flies, turns=turns & ~flies)


def _clean(plane: "RestingOnPlane", done: Progress, cause: Int[Array, ""]) -> tuple[Any, Float[Array, "3"]]:
    """Returns the state, and ω over the ground, with exactly 0 for what has stopped or is held."""
    state: Any = eqx.tree_at(lambda x: x.mode, done.state, jnp.full_like(done.state.mode, int(Mode.SLIDING)))
    assert done.stands is not None
    axes, state = plane.contact_axes(done.t, state), done.state
    omega = plane.unless_held(state, axes.over_ground(state.body.Omega))
    spin_ends = cause == int(SwitchCause.SPINNING_ENDS)
    omega = jnp.where(jnp.stack([done.stands, done.stands, spin_ends]), 0.0, omega)
    body = state.body.with_Omega(axes.in_body(omega))
    return eqx.tree_at(lambda x: x.body, state, body), omega


def _choose(deciding: _Deciding, choice: _Choice, at_once: Bool[Array, "3"]) -> _Choice:
    """Finds the choice when nothing is overloaded; it has no derivatives but those from the given one."""
    still, held, now = without_derivatives((deciding, choice, at_once))
    # What the event has loosened lets go first; then what is overloaded, one after the other.
    held = still.with_one_less(held, now)
    none = jnp.zeros_like(at_once)
    last = jax.lax.fori_loop(0, RELEASES, lambda _, held: still.with_one_less(held, none), held)
    slides, turned = choice.sticks & ~last.sticks, choice.mode.rests & ~last.mode.rests
    # What slipped and rolled before does so on, in its own direction, with its derivatives.
    mode = last.mode._replace(sigma=jnp.where(turned, last.mode.sigma, choice.mode.sigma))
    return _Choice(last.sticks, jnp.where(slides | deciding.still, last.sigma, choice.sigma), mode)


def _direct(
    deciding: _Deciding, choice: _Choice, slips_now: Bool[Array, ""], turns: Bool[Array, ""], planar: bool
) -> _Choice:
    """Returns the choice with the directions in which a slip and rolling that begin grow."""

    def next_choice(choice: _Choice, _: None) -> tuple[_Choice, None]:
        # The direction of each depends on that of the other, so they are found in turn until neither changes.
        sigma = jax.lax.cond(slips_now, lambda: deciding.first_slip(choice), lambda: choice.sigma)
        choice = choice._replace(sigma=sigma)
        if planar:
            return choice, None
        rolling = jax.lax.cond(turns, lambda: deciding.first_rolling(choice), lambda: choice.mode.sigma)
        return choice._replace(mode=choice.mode._replace(sigma=rolling)), None

    return jax.lax.scan(next_choice, choice, None, length=TURNS_TAKEN)[0]


# The windows in which directions are known beforehand.


class _Slipping(NamedTuple):
    """A body that begins to slip, in the modes of ``begins``."""

    plane: Any
    begins: Any

    @property
    def body(self) -> AbstractBody:
        """What is in motion."""
        return self.plane.body

    def prepare(self, t: Float[Array, ""], state: ReleasedState) -> tuple[Response, Float[Array, ""]]:
        now = self.begins.move(state)
        return self.plane.response(t, now), self.plane.coefficient(slip_velocity(self.plane.body, t, state))

    def pull(
        self, t: Float[Array, ""], state: ReleasedState, prepare: tuple[Response, Float[Array, ""]], sigma: Array
    ) -> tuple[Float[Array, "2"], ReleasedState]:
        """Computes the slip acceleration along the plane, and ẋ."""
        response, mu = prepare
        acting = friction.sliding(response, mu, sigma)
        moved = rates(self.plane.body, state, response, acting.slip_acceleration, acting.normal)
        return acting.slip_acceleration[:2], moved


class _Turning(NamedTuple):
    """A ball that begins to roll, in the modes of ``begins``."""

    plane: Any
    begins: Any

    @property
    def body(self) -> AbstractBody:
        """What is in motion."""
        return self.plane.body

    def prepare(self, t: Float[Array, ""], state: ReleasedState) -> _Rolling:
        return _Rolling.of(self.plane, t, self.begins.move(state))

    def pull(
        self, t: Float[Array, ""], state: ReleasedState, prepare: _Rolling, sigma: Float[Array, "2"]
    ) -> tuple[Float[Array, "2"], ReleasedState]:
        """Computes the rate of ω_h over the ground, in contact axes, and ẋ."""
        now = self.begins.move(state)
        moved = prepare.rates(self.plane.body, now, self.plane.mode(t, now, sigma))
        return self.plane.rate_over_ground(t, now, moved.body.Omega)[:2], moved


def _begin(plane: "RestingOnPlane", done: Progress, tolerance: Float[Array, ""]) -> "RestingState":
    """Returns the state with the directions of a slip and of rolling that begin or stay slow, for as long as they are
    computed in advance.
    """
    t, state = done.t, done.state
    assert done.turns is not None
    longest = windows.longest_window(t, plane.driving_kinks(), slips.unit_of_time(plane.body))
    begins, turns, none = done.begins & plane.slips_end, done.turns, Beginning.none(t)
    start: Any = state
    sigma, rolling = start.begun.sigma, start.rolling.sigma
    if plane.body.planar:
        begun = select_tree(done.decides, select_tree(begins, Beginning.along(t + longest, sigma), none), start.begun)
        ever = Beginning.along(jnp.full_like(t, float(jnp.finfo(t.dtype).max)), rolling)
        return eqx.tree_at(lambda x: (x.begun, x.rolling), state, (begun, ever))
    # What goes on, but so slowly that its direction has to be known beforehand as if it began.
    slip, slips_on = follow_slip(plane, done, tolerance)
    turn, turns_on = plane.follow_rolling(t, done.before, state, tolerance)
    turns_on &= ~turns
    slip, begins = select_tree(slips_on, slip, Course.of(sigma)), begins | slips_on
    turn, turns = select_tree(turns_on, turn, Course.of(rolling)), turns | turns_on

    def next_windows(start: Any, first: Bool[Array, ""]) -> tuple[Any, None]:
        # One window alone is final after the first pass; only two that depend on each other are computed again.
        needed = first | begins & turns & (start.begun.until > t) & (start.rolling.until > t)
        begun = jax.lax.cond(
            needed & begins,
            lambda: windows.beginning(_Slipping(plane, start), t, state.released, slip, longest),
            lambda: start.begun,
        )
        start = eqx.tree_at(lambda x: x.begun, start, begun)
        turning = jax.lax.cond(
            needed & turns,
            lambda: windows.beginning(_Turning(plane, start), t, state.released, turn, longest),
            lambda: start.rolling,
        )
        return eqx.tree_at(lambda x: x.rolling, start, turning), None

    # The first guess of a direction that is found in turn with the other: the one in which it begins.
    ahead = Beginning.along(t + longest, slip.sigma), Beginning.along(t + longest, turn.sigma)
    previous = select_tree(done.decides, none, start.begun), select_tree(done.decides, none, start.rolling)
    first = select_tree(begins, ahead[0], previous[0]), select_tree(turns, ahead[1], previous[1])
    start = eqx.tree_at(lambda x: (x.begun, x.rolling), start, first)
    start = jax.lax.scan(next_windows, start, jnp.arange(TURNS_TAKEN) == 0)[0]
    start = select_tree(slips_on & (start.begun.until > t), along_course(plane, t, start, slip), start)
    return select_tree(turns_on & (start.rolling.until > t), plane.along_course(t, start, turn), start)
