"""A body that rolls, slides or flies, with joints that dry friction may hold.

``simulate`` solves it in place of a body with such joints that is given a law of contact. In each of its modes each
joint sticks or slips, as in ``stick_slip``.

Joints that stick are held in the matrix of the equations, so that the response of the body to the ground is that of one
in which they are locked, and so is the friction that holds them: linear in the slip acceleration. What ends a mode are
the three guards of a contact, and two for each joint.

In an impact no joint is held. The friction that holds a joint is finite, and gives no impulse, as no other finite force
does. So joints take their part of an impact freely, and those that it has set in motion slip afterwards.

As a mode ends, everything that does not move is held, as far as friction can do it: the contact, if it does not slip,
and the joints at rest. The most overloaded of them lets go first, because the loads of all others jump as one does.
"""

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...numerics.arrays import select_tree
from ...programs.derivatives.differentiation import without_derivatives
from ..body import AbstractBody
from ..dynamics.sticking import (
    JointHistory,
    JointSwitches,
    largest_frictions,
    sticking_guards,
    sticking_slots,
    with_directions,
)
from ..hybrid import NONE, Accuracy, Assessment, GuardedStep, Transition, at_zero
from ..state import PlacedState
from . import friction
from .body_on_plane import BodyOnPlane, ContactHistory
from .modes import CAUSES, ContactState, ContactSwitches, Mode, SwitchCause
from .released import ReleasedState, Response, response, slip_velocity, with_rise, with_slip
from .slip import Heading
from .transition import Progress, begin_slip, end_slip, only_if, strike
from .window import Beginning

OF_CONTACT = 3  # guards of the contact, before those of the joints
FIRST_OF_JOINTS = 16  # among the events of a step: that of the first guard of the joints, more than any cause
ROUNDING_OF_STRIKE = 64  # of the rate that an impact may give a joint, in units of rounding: what is smaller is none


class StickingState(ContactState):
    """The variables of a body that may slip and fly, with joints that may stick, which a solve advances.

    - ``slips``: for each joint with dry friction, 1 or −1 where it slips in that direction, 0 where it sticks.
    """

    slips: Float[Array, "*batch sticking"]


class StickingSwitches(JointSwitches, ContactSwitches):
    """The switches of such a body: of the mode of its contact, and of its joints."""

    def words(self, k: int) -> str:
        changed = self.changes(k)
        source, target = (int(np.asarray(column)[k]) for column in (self.source, self.target))
        of_joint = int(np.asarray(self.event)[k]) in (SwitchCause.JOINT_STOPS, SwitchCause.JOINT_BREAKS_LOOSE)
        of_contact = not of_joint or source != target or not changed
        return ", ".join([*([super().words(k)] if of_contact else []), *changed])


class StickingHistory(JointHistory, ContactHistory):
    """The modes of a run with a law of contact and joints that stick, at its saved times."""

    described: ClassVar[str] = "a law of contact and joints that stick"
    changing: ClassVar[str] = "the mode of contact or of a joint"

    @property
    def over_time(self) -> dict[str, Array]:
        return super().over_time | {"directions": self.directions}

    def as_solved(self, system: AbstractBody, states: Any) -> "tuple[StickingOnPlane, StickingState]":
        plane, state = super().as_solved(system, states)
        return StickingOnPlane(system, plane.contact), StickingState(**vars(state), slips=self.directions)


class StickingOnPlane(BodyOnPlane):
    """A ball or a disk with a law of contact, with joints that dry friction may hold."""

    title: ClassVar[str] = "body with a law of contact and joints that stick"
    state_type: ClassVar[Any] = StickingState

    def prepare(self) -> "StickingOnPlane":
        return StickingOnPlane(self.body.prepare(), self.contact)

    def moving(self, state: Any) -> AbstractBody:
        return with_directions(self.body, state.slips)

    def response_to_impulse(self, t: Float[Array, ""], state: Any) -> Response:
        # Any direction says that a joint is not held: friction in joints gives no impulse.
        return super().response_to_impulse(t, eqx.tree_at(lambda x: x.slips, state, jnp.ones_like(state.slips)))

    # The guards.

    def guards_in_step(self, t: Float[Array, ""], state: Any, reference: Heading) -> Float[Array, " guards"]:
        """Computes the guards of the contact, and two for each joint, as in ``stick_slip``."""
        response = self.response(t, state)
        acting = self.interaction(t, state, response)
        of_contact = self.guards_of_contact(t, state, reference, response, acting)
        holding = response.holding(acting.slip_acceleration, acting.normal)
        return jnp.concatenate([of_contact, sticking_guards(self.body, state.slips, state.body.thetadot, holding)])

    def assess(self, step: GuardedStep, accuracy: Accuracy) -> Assessment:
        """Finds the cause that the guard which is zero stands for, from ``FIRST_OF_JOINTS`` on for the guards of
        joints.
        """
        of_joint = step.zero >= OF_CONTACT
        contact_step = step._replace(guards=step.guards[:OF_CONTACT], zero=jnp.where(of_joint, NONE, step.zero))
        contact = super().assess(contact_step, accuracy)
        ends = of_joint & step.has_fallen
        return contact._replace(event=jnp.where(ends, FIRST_OF_JOINTS + step.zero - OF_CONTACT, contact.event))

    # How modes begin.

    def start(self, t: Float[Array, ""], state: ReleasedState | PlacedState) -> StickingState:
        contact_state = super().start(t, state)
        return StickingState(
            **vars(contact_state), slips=jnp.sign(contact_state.body.thetadot[sticking_slots(self.body)])
        )

    def transition(self, t: Float[Array, ""], state: Any, event: Int[Array, ""], accuracy: Accuracy) -> Transition:
        return transition(self, t, state, event, accuracy)

    # What a run shows.

    def history(self, times: Float[Array, " T"], states: Any, record: Any) -> StickingHistory:
        of_contact = super().history(times, states, record)
        fields: dict[str, Any] = dict(vars(of_contact))
        fields["switches"] = StickingSwitches(
            **vars(of_contact.switches),
            directions_before=record.before.slips,
            directions_after=record.after.slips,
            joints=self.body.sticking,
        )
        return StickingHistory(**fields, directions=states.slips)


# How modes follow each other.


def transition(
    plane: StickingOnPlane, t: Float[Array, ""], state: StickingState, event: Int[Array, ""], accuracy: Accuracy
) -> Transition:
    """Finds what follows a :class:`SwitchCause` of the contact or the zero of a joint's guard, the end of a window, or
    START.

    Events from ``FIRST_OF_JOINTS`` on are those of the guards of the joints.
    """
    # Guards of joints come after all causes of the contact, so that one number says what has happened.
    of_joint = event >= FIRST_OF_JOINTS
    heading = without_derivatives(plane).step_reference(*without_derivatives((t, state, accuracy)))
    # As in ``transition.transition``: the speed of a slip that ends here counts as fixed.
    heading = heading._replace(least=heading.speed)
    of_contact = jnp.argmax(jnp.asarray(CAUSES)[state.mode.astype(int)] == event)
    which = jnp.where(of_joint, OF_CONTACT + event - FIRST_OF_JOINTS, of_contact)
    guards = type(plane).guards_in_step
    t, before, slope = at_zero(guards, plane, t, state, which, event >= 0, (heading,))
    done = _next_mode(plane, t, before, event, accuracy.tolerance)
    stuck = jnp.any(_is_joint_of(event, state.slips.size) & (state.slips == 0))
    # Which joint it was and what it does is in the directions before and after.
    changed = jnp.where(stuck, int(SwitchCause.JOINT_BREAKS_LOOSE), int(SwitchCause.JOINT_STOPS))
    cause = jnp.where(of_joint, changed, event)
    return done.finish(cause, slope, pauses=event == int(SwitchCause.STOPS))


def _is_joint_of(event: Int[Array, ""], count: int) -> Bool[Array, " sticking"]:
    """Returns, for each joint, whether it is the one whose guard an event stands for."""
    return (event >= FIRST_OF_JOINTS) & (np.arange(count) == (event - FIRST_OF_JOINTS) % count)


def _next_mode(
    plane: StickingOnPlane,
    t: Float[Array, ""],
    state: StickingState,
    event: Int[Array, ""],
    tolerance: Float[Array, ""],
) -> Progress:
    """Finds the state that follows the end of a mode: after the end of a slip, or an impact."""
    keeps_flying = (event >= FIRST_OF_JOINTS) & state.is_in(Mode.FLIGHT)
    done = Progress.of(plane, t, state, event, keeps_flying)
    done = only_if(event == int(SwitchCause.STOPS), end_slip, plane, done, tolerance)
    done = only_if(done.lands, _strike, plane, done)
    done = only_if(done.decides, _decide, plane, done, event)
    return done._replace(state=begin_slip(plane, done, tolerance))


def _strike(plane: StickingOnPlane, done: Progress) -> Progress:
    """Applies an impact, in which no joint is held: each slips as it then moves."""
    t, before, of_impulse = done.t, done.state, plane.response_to_impulse(done.t, done.state)
    done = strike(plane, done)
    state: Any = done.state
    slots, eps = sticking_slots(plane.body), float(jnp.finfo(state.V.dtype).eps)
    rate, gains = state.body.thetadot[slots], jnp.abs(of_impulse.yielding.thetaddot[:, slots])
    change = slip_velocity(plane.body, t, state.released) - slip_velocity(plane.body, t, before.released)
    least = jnp.sqrt(jnp.sum(change**2)) * jnp.max(gains, axis=0) + jnp.abs(before.body.thetadot[slots])
    # The largest rate that such an impact could give the joint: what is rounding of it did not set the joint in motion.
    slips = jnp.where(jnp.abs(rate) <= ROUNDING_OF_STRIKE * eps * least, 0.0, jnp.sign(rate))
    return done._replace(state=eqx.tree_at(lambda x: x.slips, state, jax.lax.stop_gradient(slips)))


# The next mode.


class _Choice(NamedTuple):
    """Whether the contact sticks or the body flies, and the directions of a slip and of joints, 0 if they stick."""

    sticks: Bool[Array, ""]
    flies: Bool[Array, ""]
    sigma: Float[Array, "2"]
    slips: Float[Array, " sticking"]


class _Deciding(NamedTuple):
    """A body of which it is decided what is held.

    ``still`` says that it does not slip, ``mu`` is the coefficient of sliding friction.
    """

    plane: Any
    t: Float[Array, ""]
    state: ReleasedState
    still: Bool[Array, ""]
    mu: Float[Array, ""]

    def response(self, choice: _Choice) -> Response:
        """Computes the response where some things are held."""
        body = with_directions(self.plane.body, choice.slips)
        return response(body, self.t, self.state, touching=~choice.flies)

    def direct(self, choice: _Choice, body_response: Response) -> _Choice:
        """Returns the choice with the direction in which a slip grows, if one begins."""
        begins = self.still & ~choice.sticks & ~choice.flies
        sigma = jax.lax.cond(begins, lambda: friction.first_slip(body_response, self.mu).sigma, lambda: choice.sigma)
        return choice._replace(sigma=sigma)

    def with_one_less(self, choice: _Choice) -> _Choice:
        """Returns the choice in which the most overloaded of the contact and the joints has let go."""
        body_response, contact = self.response(choice), self.plane.contact
        choice = self.direct(choice, body_response)
        slides, slack = ~choice.sticks & ~choice.flies, self.plane.rounding_of_force(self.state, body_response)
        on_ground = select_tree(
            choice.sticks, friction.rolling(body_response), friction.sliding(body_response, self.mu, choice.sigma)
        )
        acting = select_tree(choice.flies, friction.flight(body_response), on_ground)
        holding, largest = (
            body_response.holding(acting.slip_acceleration, acting.normal),
            largest_frictions(self.plane.body),
        )
        N, static = acting.R[2], contact.static_friction
        holds = (friction.margin(acting.R, static) > -slack) & (-slack < N)
        # As squares of shares of the largest friction, loads of the contact and of joints compare. The least divisor
        # keeps the square and the quotient within the range of numbers.
        load = jnp.sum(acting.R[:2] ** 2) / jnp.maximum(static * N, float(jnp.finfo(N.dtype).tiny) ** 0.25) ** 2
        # A body that no friction presses on its ground leaves it before any joint lets go.
        of_ground = jnp.where(choice.sticks & ~holds, load, jnp.where(slides & ~(-slack < N), jnp.inf, -jnp.inf))
        overloaded = (choice.slips == 0) & (jnp.abs(holding) > largest)
        loads = jnp.concatenate([of_ground[None], jnp.where(overloaded, (holding / largest) ** 2, -jnp.inf)])
        most = (loads == jnp.max(loads)) & (loads > -jnp.inf)
        # Of several that are equally overloaded the first alone lets go: that may relieve the others.
        most &= jnp.cumsum(most) == 1
        return choice._replace(
            sticks=choice.sticks & ~most[0],
            flies=choice.flies | most[0] & ~choice.sticks,
            # A joint that breaks loose slips against the friction that held it.
            slips=jnp.where(most[1:], -jnp.sign(holding), choice.slips),
        )


def _decide(plane: StickingOnPlane, done: Progress, event: Int[Array, ""]) -> Progress:
    """Decides the mode that follows: everything is held as far as friction can do it."""
    t, body = done.t, plane.body
    switch_state = _change_joints(plane, done, event)
    slip = slip_velocity(body, t, switch_state.released)
    still = done.still | plane.is_still(slip, switch_state)
    deciding = _Deciding(plane, t, switch_state.released, still, plane.coefficient(jnp.where(still, 0.0, slip)))
    sticks = still & (plane.contact.static_friction > 0) & (event != int(SwitchCause.GIVES_WAY)) & ~done.flies
    sigma = friction.slip_direction(slip, jnp.zeros_like(slip[:2]))
    first = _Choice(sticks, done.flies, sigma, switch_state.slips)
    # What lets go is a yes or no without derivatives; the direction of the slip is found again afterwards, with them.
    fixed, held = without_derivatives((deciding, first))
    most = switch_state.slips.size + 2  # that let go: the contact, twice, and the joints
    held = jax.lax.fori_loop(0, most, lambda _, held: fixed.with_one_less(held), held)
    choice = held._replace(sigma=sigma)
    body_response = deciding.response(choice)
    choice = deciding.direct(choice, body_response)
    # The rest of a slip that ends is dissipated by friction; one without an end continues.
    stopped = with_slip(body, switch_state.released, body_response, slip, jnp.zeros_like(slip))
    stops = still & ~choice.flies & (choice.sticks | plane.slips_end)
    state: Any = select_tree(stops, switch_state.move(stopped), switch_state)
    rise = slip_velocity(body, t, state.released)[2]
    rise = jnp.where(choice.flies & (event != int(SwitchCause.LIFTS)), rise, 0.0)
    V = with_rise(body, t, state.released, rise)
    mode = jnp.where(choice.flies, int(Mode.FLIGHT), jnp.where(choice.sticks, int(Mode.ROLLING), int(Mode.SLIDING)))
    begun = Beginning.along(t, choice.sigma)
    after = eqx.tree_at(
        lambda x: (x.V, x.mode, x.begun, x.slips), state, (V, mode.astype(V.dtype), begun, choice.slips)
    )
    return done._replace(state=after, begins=still & ~choice.sticks & ~choice.flies)


def _change_joints(plane: StickingOnPlane, done: Progress, event: Int[Array, ""]) -> Any:
    """Returns the state after an event of a joint: one that stopped is held, and one that was held slips.

    A joint that turned back while the end of a slip was followed has stopped, too.
    """
    state: Any = done.state
    slots, count = sticking_slots(plane.body), state.slips.size
    changes, stuck = _is_joint_of(event, count), state.slips == 0
    # The first guard of a held joint is what friction has to spare against positive forces, the second against negative
    # ones.
    loose = jnp.where(event - FIRST_OF_JOINTS < count, -1.0, 1.0)
    stops = ~stuck & (changes | (state.slips * state.body.thetadot[slots] < 0))
    slips = jnp.where(stops, 0.0, jnp.where(changes & stuck, loose, state.slips))
    rests = np.zeros((state.body.thetadot.size, count), dtype=bool)
    rests[slots, np.arange(count)] = True
    rests = jnp.any(jnp.asarray(rests) & (slips == 0)[None], axis=1)
    thetadot = jnp.where(rests, 0.0, state.body.thetadot)
    return eqx.tree_at(lambda x: (x.body.thetadot, x.slips), state, (thetadot, slips))
