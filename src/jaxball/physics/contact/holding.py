"""Finds the end of rolling, and decides what dry friction holds where a mode of a body on its ground ends.

Everything that does not move is held, as far as friction can do it: the most overloaded of the contact, of rolling, of
spinning and of the joints lets go first, and as it goes, the loads of all others jump. ``transition`` finds
how the rest begins to move.
"""

import dataclasses
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ...numerics.arrays import select_tree
from ...numerics.directions import diverging, unit
from ...numerics.vectors import apply, in_three
from ...programs.derivatives.differentiation import without_derivatives
from ..dynamics.dry_friction import Turning, TurningMode, candidates, let_go, needs, release
from ..dynamics.sticking import change_joint, loosen, overloads, with_directions
from ..hybrid import START
from . import friction, slip as slips
from .guards import FIRST_OF_JOINTS, Progress, rounding_of_force
from .modes import ContactState, Mode, SwitchCause
from .released import (
    Response,
    rates,
    response,
    slip_velocity,
    with_rise,
    with_slip,
)
from .slide import slide
from .slip import comes_to_rest
from .window import Beginning

if TYPE_CHECKING:
    from .body_on_plane import BodyOnPlane

TURNS_TAKEN = 6  # by the windows of a slip and of rolling that begin together


# The end of rolling.


class Rolling(NamedTuple):
    """A body that rolls: what acts on it depends on a mode of turning.

    With a law of contact its ``contact``, else the ``rows`` of its turning.
    """

    plane: "BodyOnPlane"
    t: Float[Array, ""]
    at: Any
    mode: TurningMode
    rows: Turning | None
    contact: friction.SolvedContact | None
    mu: Float[Array, ""] | None
    sigma: Float[Array, " n"] | None

    @classmethod
    def of(cls, plane: "BodyOnPlane", t: Float[Array, ""], state: ContactState, mode: TurningMode) -> "Rolling":
        """Describes the rolling of a body at a state, in a mode of turning."""
        if plane.contact is None:
            return cls(plane, t, state, mode, plane.turning(t, state), None, None, None)
        sliding, response = slide(plane, t, state), plane.response(t, state, mode)
        contact = friction.SolvedContact.of(response, state.is_in(Mode.SLIDING), jnp.asarray(False))
        return cls(plane, t, state, mode, None, contact, plane.coefficient(sliding), state.direction(t, sliding))

    def act(self, sigma: Float[Array, "2"]) -> friction.Interaction:
        """Computes what acts where it rolls in a direction."""
        mode = self.mode._replace(sigma=in_three(sigma))
        if self.rows is not None:
            return friction.resist_rolling(self.rows, mode)
        assert self.contact is not None
        law = self.plane.law_of_turning(self.at, mode)
        return self.contact.with_turning(law).interaction(self.mu, self.sigma)

    def pull(self, sigma: Float[Array, "2"], _: Float[Array, ""]) -> slips.Pull:
        """Computes how ω_h changes in a direction of rolling."""
        acting = self.act(sigma)
        return slips.Pull(acting.rate[:2], -jnp.sum(sigma * acting.torque[:2]), acting.normal)

    def rates(self, sigma: Float[Array, "2"]) -> Any:
        """Computes ẋ where it rolls in a direction, or is braked."""
        if self.contact is None:
            return self.plane.rates_of_rolling(self.t, self.at, self.mode._replace(sigma=in_three(sigma)))
        return rates(self.plane.body, self.at.released, self.contact.response, self.act(sigma).amounts)


def end_rolling(plane: "BodyOnPlane", done: Progress, tolerance: Float[Array, ""]) -> Progress:
    """Moves the state to the end of rolling, if it has one soon, with what acts halfway."""
    state: Any = done.state
    if plane.body.planar:
        return done._replace(stands=jnp.asarray(True))
    t, omega = done.t, plane.over_ground(done.t, state)[:2]

    def rolling(t: Float[Array, ""], where: Any) -> TurningMode:
        return plane.mode(t, where, unit(omega))

    def end(t: Float[Array, ""], where: Any) -> slips.End:
        return slips.end(Rolling.pull, slips.Around(Rolling.of(plane, t, where, rolling(t, where))), omega)

    def brake(t: Float[Array, ""], where: Any, time: Float[Array, ""], share: float) -> Any:
        rate = -omega / jnp.where(time > 0, time, 1.0)
        # The mean rate until the end, so that ω_h is then zero; the torque is whatever this needs.
        held = rolling(t, where)._replace(rests=jnp.asarray(True), braking=in_three(rate))
        moved = Rolling.of(plane, t, where, held).rates(held.sigma[:2])
        return state.move(jax.tree.map(lambda x, rate: x + share * time * rate, state.motion, moved))

    first = end(t, state)
    halfway = brake(t, state, first.time, slips.HALFWAY)
    middle = t + slips.HALFWAY * first.time
    second = end(middle, halfway)
    ends = comes_to_rest(plane, first, second, omega, tolerance)
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
    sigma: Float[Array, " n"]
    mode: TurningMode | None
    slips: Float[Array, " sticking"] | None


class Deciding(NamedTuple):
    """A body of which it is decided what is held.

    ``at`` is its state, ``rows`` the ones of its turning without a law of contact; with such a law, ``response`` is its
    response, both where all joints are as they are there. ``still`` says that it does not slip, ``mu`` is the
    coefficient of sliding friction.
    """

    plane: Any
    t: Float[Array, ""]
    at: ContactState
    rows: Turning | None
    response: Response | None
    still: Bool[Array, ""]
    mu: Float[Array, ""]

    def respond(self, choice: Choice) -> Response:
        """Computes the response where some things are held."""
        responds = self.response
        assert responds is not None
        if choice.slips is not None:
            # Joints that stick are in the matrix of the equations.
            body = with_directions(self.plane.body, choice.slips)
            turned, touching = responds.turned, ~choice.flies
            pivots = self.plane.pivot is not None
            responds = response(body, self.t, self.at.released, touching=touching, pivots=pivots)
            responds = responds._replace(turned=turned)
        if choice.mode is None:
            return responds
        return responds.with_turning(self.plane.law_of_turning(self.at, choice.mode))

    def first_slip(self, choice: Choice, responds: Response) -> Float[Array, " n"]:
        """Finds the direction in which a slip begins, if one does."""
        begins = self.still & ~choice.sticks & ~choice.flies
        sigma = jax.lax.cond(begins, lambda: friction.first_slip(responds, self.mu).sigma, lambda: choice.sigma)
        # That of a disk is ±1 along e1, without the rounding of an angle.
        return sigma.at[1].set(0.0) if self.plane.body.planar else sigma

    def rolling(self, choice: Choice) -> Rolling:
        """Describes the rolling of the body where some things are held."""
        assert choice.mode is not None
        described = Rolling(self.plane, self.t, self.at, choice.mode, None, None, self.mu, choice.sigma)
        if self.response is not None:
            slides = ~choice.sticks & ~choice.flies
            return described._replace(contact=friction.SolvedContact.of(self.respond(choice), slides, choice.flies))
        # Joints that stick are in the matrix of the equations.
        now = dataclasses.replace(self.at, slips=choice.slips)
        return described._replace(rows=self.rows if choice.slips is None else self.plane.turning(self.t, now))

    def first_rolling(self, choice: Choice) -> Float[Array, "3"]:
        """Finds the direction in which rolling begins."""
        assert choice.mode is not None
        first = jax.lax.stop_gradient(choice.mode.sigma[:2])
        if self.plane.body.planar:
            # What let go after it, such as the contact, may have turned its rate round. At the brink that is 0 up to
            # rounding, and grows in neither direction.
            ahead, back = (_pull(self.rolling(choice), sign * first)[0] for sign in (1.0, -1.0))
            turned = (jnp.sum(ahead * first) <= 0) & (jnp.sum(back * first) < 0)
            return in_three(jnp.where(turned, -first, first))
        return in_three(diverging(_pull, self.rolling(choice), first).sigma)

    def weigh(self, choice: Choice) -> tuple[Float[Array, " loads"], tuple[Choice, Any, Any]]:
        """Computes the loads of all that may be held, with the choice, and the torque and friction that hold it."""
        plane, of_contact, torque, holding = self.plane, jnp.full_like(self.t, -jnp.inf), None, None
        acting = responds = None
        if self.response is not None:
            responds = self.respond(choice)
            choice = choice._replace(sigma=self.first_slip(choice, responds))
            slides, slack = ~choice.sticks & ~choice.flies, rounding_of_force(plane, self.at, responds)
            acting = friction.SolvedContact.of(responds, slides, choice.flies).interaction(self.mu, choice.sigma)
            of_friction = friction.overload(acting.grip, plane.law.static_friction, slack, choice.sticks)
            # A body that nothing presses on its ground leaves it before anything else lets go.
            of_contact = jnp.where(slides & ~(-slack < acting.R[2]), jnp.inf, of_friction)
        elif choice.mode is not None:
            acting = self.rolling(choice).act(choice.mode.sigma[:2])
        loads = [of_contact[None]]
        if choice.mode is not None and acting is not None:
            torque, height = acting.torque, plane.body.height_of_centre(self.at.body.Gamma)
            loads.append(needs(plane.static_levels, height, torque, acting.normal).overloads(choice.mode))
        if choice.slips is not None:
            now = dataclasses.replace(self.at, slips=choice.slips)
            if responds is None or acting is None:
                holding = plane.holding_in_rolling(self.t, now, choice.mode)
            else:
                holding = responds.part("holding", acting.amounts)
            loads.append(overloads(plane.body, self.t, self.at.body, choice.slips, holding))
        return jnp.concatenate(loads), (choice, torque, holding)

    def let_go(self, _: Choice, acting: tuple[Choice, Any, Any], off: Bool[Array, " loads"]) -> Choice:
        """Returns the choice after some things have let go; in flight the ground holds nothing."""
        choice, torque, holding = acting
        leaves, mode, slips = off[0] & ~choice.sticks, choice.mode, choice.slips
        if mode is not None:
            mode = let_go(mode, torque, off[1:3])
            mode = mode._replace(rests=mode.rests & ~leaves, still=mode.still & ~leaves)
        if slips is not None:
            slips = loosen(self.plane.body, slips, holding, off[-slips.size :])
        return Choice(choice.sticks & ~off[0], choice.flies | leaves, choice.sigma, mode, slips)

    def choose(self, choice: Choice, at_once: Bool[Array, " loads"]) -> Choice:
        """Finds the choice when nothing is overloaded; it has no derivatives but those from the given one."""
        still, held = without_derivatives((self, choice))
        last = release(held, still.weigh, still.let_go, at_once)
        # What slipped and rolled before does so on, in its own direction, with its derivatives.
        last = last._replace(sigma=jnp.where(self.still, last.sigma, choice.sigma))
        if choice.mode is None or last.mode is None:
            return last
        sigma = jnp.where(choice.mode.rests & ~last.mode.rests, last.mode.sigma, choice.mode.sigma)
        return last._replace(mode=last.mode._replace(sigma=sigma, levels=choice.mode.levels))

    def direct(self, choice: Choice, turns: Bool[Array, ""]) -> Choice:
        """Returns the choice with the directions in which a slip and rolling that begin grow."""

        def next_choice(choice: Choice, _: None) -> tuple[Choice, None]:
            # The direction of each depends on that of the other, so they are found in turn until neither changes.
            if self.response is not None:
                choice = choice._replace(sigma=self.first_slip(choice, self.respond(choice)))
            if choice.mode is None or not self.plane.resists_rolling:
                return choice, None
            sigma = choice.mode.sigma
            rolling = jax.lax.cond(turns, lambda: self.first_rolling(choice), lambda: sigma)
            return choice._replace(mode=choice.mode._replace(sigma=rolling)), None

        if choice.mode is None or self.response is None:
            return next_choice(choice, None)[0]
        return jax.lax.scan(next_choice, choice, None, length=TURNS_TAKEN)[0]


def _pull(rolling: Rolling, sigma: Float[Array, "2"]) -> tuple[Float[Array, "2"], Float[Array, ""]]:
    acting = rolling.act(sigma)
    return acting.rate[:2], acting.normal


def decide(plane: "BodyOnPlane", done: Progress, event: Int[Array, ""]) -> Progress:
    """Decides the mode that follows: everything is held as far as friction can do it."""
    t = done.t
    before, moving, loose = _all_held(plane, done, event)
    if plane.contact is None:
        # Nothing slips or flies; what these fields hold is not used.
        choice = Choice(~done.flies, done.flies, jnp.zeros((2,), t.dtype), moving, before.slips)
        rows = plane.turning(t, before) if moving is not None and before.slips is None else None
        deciding = Deciding(plane, t, before, rows, None, ~done.flies, jnp.zeros_like(t))
    else:
        choice, deciding = _all_sticking(plane, done, event, before, moving)
    choice, turns = deciding.choose(choice, loose), done.turns
    if moving is not None and choice.mode is not None:
        turns = moving.rests & ~choice.mode.rests & ~choice.flies
    choice = deciding.direct(choice, turns)
    state = dataclasses.replace(before, slips=choice.slips)
    if plane.turns_aside and choice.mode is not None:
        # What begins to roll forgets at once how it was turned aside, which is 0, but may have a derivative.
        axes, sigma = plane.contact_axes(t, plane.on_ground(state)), choice.mode.sigma[:2]
        omega = axes.over_ground(state.body.Omega)[:2]
        aside = jnp.where(turns, omega - sigma * jnp.sum(sigma * omega), 0.0)
        Omega = state.body.Omega - apply(axes.rows.T, jnp.append(aside, 0.0))
        state = dataclasses.replace(state, body=state.body.with_Omega(Omega))
    if plane.contact is not None:
        state = _slipping_as_chosen(deciding, state, choice, event)
    begins = deciding.still & ~choice.sticks & ~choice.flies
    return done._replace(state=_turning_as_chosen(plane, t, state, choice), begins=begins, turns=turns)


def _all_sticking(
    plane: "BodyOnPlane", done: Progress, event: Int[Array, ""], before: ContactState, moving: TurningMode | None
) -> tuple[Choice, Deciding]:
    """Returns the choice in which all that stands is held, the contact among it."""
    sliding, responds = slide(plane, done.t, before), plane.response_on_ground(done.t, before)
    still = done.still | plane.is_still(sliding, before)
    mu = plane.coefficient(jnp.where(still, 0.0, sliding))
    # Without static friction a body never rolls, not even one that would need no friction to. Friction that has just
    # given way is at its limit, so by rounding it may seem to be enough.
    sticks = still & (plane.law.static_friction > 0) & (event != int(SwitchCause.GIVES_WAY)) & ~done.flies
    sigma = friction.slip_direction(sliding, jnp.zeros_like(sliding))
    choice = Choice(sticks, done.flies, sigma, moving, before.slips)
    return choice, Deciding(plane, done.t, before, None, responds, still, mu)


def _slipping_as_chosen(deciding: Deciding, state: ContactState, choice: Choice, event: Int[Array, ""]) -> ContactState:
    """Returns the state in the mode of contact of a choice."""
    plane, t = deciding.plane, deciding.t
    # The rest of a slip that ends is dissipated by friction; one without an end continues.
    slip, responds = slip_velocity(plane.body, t, state.released), deciding.respond(choice)
    if responds.pivot is not None:
        responds = responds.with_pivoting(held=True, rate=-plane.over_ground(t, plane.on_ground(state))[2])
    # Of one that begins at once, which is 0 but may have a derivative, what goes along its direction continues.
    onward = jnp.where(choice.sticks, 0.0, choice.sigma[:2] * jnp.sum(choice.sigma[:2] * slip[:2]))
    onward = jnp.append(onward, 0.0)
    stopped = with_slip(plane.body, state.released, responds, slip, onward)
    stops = deciding.still & ~choice.flies & (choice.sticks | plane.slips_end)
    state = select_tree(stops, state.move(stopped), state)
    # Where the normal force falls to zero, a body leaves with no speed: what there is of it is rounding.
    rise = slip_velocity(plane.body, t, state.released)[2]
    rise = jnp.where(choice.flies & (event != int(SwitchCause.LIFTS)), rise, 0.0)
    V = with_rise(plane.body, t, state.released, rise)
    mode = jnp.where(choice.flies, int(Mode.FLIGHT), jnp.where(choice.sticks, int(Mode.ROLLING), int(Mode.SLIDING)))
    # Takes σ to ``begin``, which puts the window in its place, or none.
    return dataclasses.replace(state, V=V, mode=mode.astype(V.dtype), begun=Beginning.along(t, choice.sigma))


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
        axes = plane.contact_axes(done.t, plane.on_ground(state))
        omega = plane.unless_held(state, axes.over_ground(state.body.Omega))
        # At the end of its rolling or spinning, the rate is 0, not nearly.
        spin_ends = event == int(SwitchCause.SPINNING_ENDS)
        omega = jnp.where(jnp.stack([done.stands, done.stands, spin_ends]), 0.0, omega)
        moving = candidates(plane.resistance, omega, plane.body.planar)
        # A body that rolls comes to rest by an event that says so, and not because its rate is rounding, as just after
        # it broke loose. In flight the ground holds nothing.
        may_rest = (event == START) | done.stands | done.lands | (state.rolls == 0)
        if state.stop_loss is not None:
            may_rest |= event == int(SwitchCause.JOINT_STRIKES)
        moving = moving._replace(rests=moving.rests & may_rest & ~done.flies, still=moving.still & ~done.flies)
        breaks, spins = event == int(SwitchCause.BREAKS_LOOSE), event == int(SwitchCause.BEGINS_TO_SPIN)
        loose.append(jnp.stack([moving.rests & breaks, moving.still & spins]))
        state = dataclasses.replace(state, body=state.body.with_Omega(axes.in_body(omega)))
    if state.slips is not None:
        loose.append(jnp.zeros(state.slips.size, bool))
    return state, moving, jnp.concatenate(loose)


def _turning_as_chosen(plane: "BodyOnPlane", t: Float[Array, ""], state: ContactState, choice: Choice) -> ContactState:
    """Returns the state in the mode of turning of a choice."""
    mode, dtype = choice.mode, t.dtype
    if mode is None:
        return state
    spin = mode.spin if plane.resists_spinning else jnp.zeros_like(mode.spin)
    # In flight the ground holds nothing, and 0 would say that it does.
    spin = jnp.where(choice.flies & (spin == 0), 1.0, spin).astype(dtype)
    rolls, rolling = jnp.where(mode.rests, 0.0, 1.0).astype(dtype), Beginning.along(t, mode.sigma[:2])
    return dataclasses.replace(state, rolls=rolls, spin=spin, rolling=rolling)
