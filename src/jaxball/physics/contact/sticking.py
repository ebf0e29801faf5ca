"""A body that rolls, slides or flies, with joints that dry friction may hold.

``simulate`` solves it in place of a body with such joints that is given a law of contact. In each of its modes each
joint sticks or slips, as in ``modes.held``.

Joints that stick are held in the matrix of the equations, so that the response of the body to the ground is that of one
in which they are locked, and so is the friction that holds them: linear in the slip acceleration. What ends a mode are
the three guards of a contact, and two for each joint.

In an impact no joint is held. The friction that holds a joint is finite, and gives no impulse, as no other finite force
does. So joints take their part of an impact freely, and those that it has set in motion slip afterwards.

As a mode ends, everything that does not move is held, as far as friction can do it (``holding``).
"""

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..body import AbstractBody
from ..dynamics.sticking import (
    JointHistory,
    JointSwitches,
    change_joint,
    sticking_guards,
    sticking_slots,
    with_directions,
)
from ..forces.resistance import TurningMode
from ..hybrid import NONE, Accuracy, Assessment, GuardedStep
from ..state import PlacedState
from . import friction
from .body_on_plane import BodyOnPlane, ContactHistory
from .holding import Choice, decide_held
from .modes import ContactState, ContactSwitches, Mode, SwitchCause
from .released import ReleasedState, Response, slip_velocity
from .transition import Progress

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
    history_type: ClassVar[Any] = StickingHistory
    of_body: ClassVar[int] = 3  # guards of the body, before those of the joints

    def moving(self, state: Any) -> AbstractBody:
        return with_directions(self.body, state.slips)

    def response_to_impulse(self, t: Float[Array, ""], state: Any) -> Response:
        # Any direction says that a joint is not held: friction in joints gives no impulse.
        return super().response_to_impulse(t, eqx.tree_at(lambda x: x.slips, state, jnp.ones_like(state.slips)))

    # The guards.

    def guards_where(
        self, t: Float[Array, ""], state: Any, reference: Any, response: Response, acting: friction.Interaction
    ) -> Float[Array, " guards"]:
        """Computes the guards of the body, and two for each joint, as in ``modes.held``."""
        of_body = super().guards_where(t, state, reference, response, acting)
        holding = response.part("holding", acting.amounts)
        return jnp.concatenate([of_body, sticking_guards(self.body, state.slips, state.body.thetadot, holding)])

    def assess(self, step: GuardedStep, accuracy: Accuracy) -> Assessment:
        """Finds the cause that the guard which is zero stands for, from ``FIRST_OF_JOINTS`` on for the guards of
        joints.
        """
        first = self.of_body
        of_joint = step.zero >= first
        body_step = step._replace(guards=step.guards[:first], zero=jnp.where(of_joint, NONE, step.zero))
        of_body, ends = super().assess(body_step, accuracy), of_joint & step.has_fallen
        return of_body._replace(event=jnp.where(ends, FIRST_OF_JOINTS + step.zero - first, of_body.event))

    # How modes begin.

    def start(self, t: Float[Array, ""], state: ReleasedState | PlacedState) -> Any:
        start = super().start(t, state)
        return self.state_type(**vars(start), slips=jnp.sign(start.body.thetadot[sticking_slots(self.body)]))

    # The parts of a transition. Guards of joints come after all causes, so that one number says what has happened.

    def guard_of(self, state: Any, event: Int[Array, ""]) -> Int[Array, ""]:
        of_body = super().guard_of(state, event)
        return jnp.where(event >= FIRST_OF_JOINTS, self.of_body + event - FIRST_OF_JOINTS, of_body)

    def progress(self, t: Float[Array, ""], state: Any, event: Int[Array, ""]) -> Progress:
        done = super().progress(t, state, event)
        # What has happened to a joint does not concern a body in flight.
        flies = (event >= FIRST_OF_JOINTS) & state.is_in(Mode.FLIGHT)
        height = jnp.where(flies, state.height, done.state.height)
        return done._replace(state=eqx.tree_at(lambda x: x.height, done.state, height), flies=done.flies | flies)

    def strike(self, done: Progress) -> Progress:
        """Applies an impact, in which no joint is held: each slips as it then moves."""
        t, before, of_impulse = done.t, done.state, self.response_to_impulse(done.t, done.state)
        done = super().strike(done)
        state: Any = done.state
        slots, eps = sticking_slots(self.body), float(jnp.finfo(state.V.dtype).eps)
        rate, gains = state.body.thetadot[slots], jnp.abs(of_impulse.yielding.thetaddot[:, slots])
        change = slip_velocity(self.body, t, state.released) - slip_velocity(self.body, t, before.released)
        least = jnp.sqrt(jnp.sum(change**2)) * jnp.max(gains, axis=0) + jnp.abs(before.body.thetadot[slots])
        # The largest rate that such an impact could give the joint: what is rounding of it did not set it in motion.
        slips = jnp.where(jnp.abs(rate) <= ROUNDING_OF_STRIKE * eps * least, 0.0, jnp.sign(rate))
        return done._replace(state=eqx.tree_at(lambda x: x.slips, state, jax.lax.stop_gradient(slips)))

    def decide(self, done: Progress, event: Int[Array, ""]) -> Progress:
        return decide_held(self, done, event)

    def all_held(self, done: Progress, event: Int[Array, ""]) -> tuple[Any, TurningMode | None, Bool[Array, " loads"]]:
        """Returns the state after an event of a joint, and what the event has loosened of the rest."""
        state: Any = done.state
        slips, thetadot = change_joint(self.body, state.slips, state.body.thetadot, event - FIRST_OF_JOINTS)
        state = eqx.tree_at(lambda x: (x.body.thetadot, x.slips), state, (thetadot, slips))
        state, moving, loose = super().all_held(done._replace(state=state), event)
        return state, moving, jnp.append(loose, jnp.zeros(slips.size, bool))

    def as_chosen(self, state: Any, choice: Choice, t: Float[Array, ""]) -> Any:
        """Returns the state in the modes of a choice."""
        return eqx.tree_at(lambda x: x.slips, super().as_chosen(state, choice, t), choice.slips)

    def cause_of_event(self, state: Any, event: Int[Array, ""]) -> Int[Array, ""]:
        # Which joint it was and what it does is in the directions before and after.
        count = state.slips.size
        which = (event >= FIRST_OF_JOINTS) & (np.arange(count) == (event - FIRST_OF_JOINTS) % count)
        stuck = jnp.any(which & (state.slips == 0))
        of_joint = jnp.where(stuck, int(SwitchCause.JOINT_BREAKS_LOOSE), int(SwitchCause.JOINT_STOPS))
        return jnp.where(event >= FIRST_OF_JOINTS, of_joint, super().cause_of_event(state, event))

    # What a run shows.

    def history(self, times: Float[Array, " T"], states: Any, record: Any) -> Any:
        of_contact = super().history(times, states, record)
        fields: dict[str, Any] = dict(vars(of_contact))
        fields["switches"] = StickingSwitches(
            **vars(of_contact.switches),
            directions_before=record.before.slips,
            directions_after=record.after.slips,
            joints=self.body.sticking,
        )
        return self.history_type(**fields, directions=states.slips)
