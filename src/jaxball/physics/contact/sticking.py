"""A body that rolls, slides or flies, with joints that dry friction may hold: in each of its modes each joint sticks or
slips, as in ``stick_slip``.

Joints that stick are held in the matrix of the equations, so that the response of the body to the ground is that of one
in which they are locked, and so is the friction that holds them: linear in the slip acceleration. What ends a mode are
the three guards of a contact, and two for each joint.

In an impact no joint is held. The friction that holds a joint is finite, and gives no impulse, as no other finite force
does. So joints take their part of an impact freely, and those that it has set in motion slip afterwards.
"""

from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..body import AbstractBody
from ..dynamics.sticking import (
    JointHistory,
    JointSwitches,
    sticking_guards,
    sticking_slots,
    with_directions,
)
from ..hybrid import NONE, Accuracy, Assessment, GuardedStep, Transition
from ..state import PlacedState
from .body_on_plane import BodyOnPlane, ContactHistory
from .modes import ContactState, ContactSwitches, SwitchCause
from .released import ReleasedState, Response
from .slip import Heading
from .sticking_transition import FIRST_OF_JOINTS, OF_CONTACT, transition


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
        return super().response_to_impulse(t, eqx.tree_at(lambda x: x.slips, state, jnp.ones_like(state.slips)))

    # The guards.

    def guards_in_step(self, t: Float[Array, ""], state: Any, reference: Heading) -> Float[Array, " guards"]:
        """Those of the contact, and two for each joint, as in ``stick_slip``."""
        found = self.response(t, state)
        acting = self.interaction(t, state, found)
        of_contact = self.guards_of_contact(t, state, reference, found, acting)
        holding = found.holding(acting.slip_acceleration, acting.normal)
        return jnp.concatenate([of_contact, sticking_guards(self.body, state.slips, state.body.thetadot, holding)])

    def assess(self, step: GuardedStep, accuracy: Accuracy) -> Assessment:
        """The cause that the guard which is zero stands for, from ``FIRST_OF_JOINTS`` on for those of joints."""
        of_joint = step.zero >= OF_CONTACT
        own = step._replace(guards=step.guards[:OF_CONTACT], zero=jnp.where(of_joint, NONE, step.zero))
        contact = super().assess(own, accuracy)
        ends = of_joint & step.has_fallen
        return contact._replace(event=jnp.where(ends, FIRST_OF_JOINTS + step.zero - OF_CONTACT, contact.event))

    # How modes begin.

    def start(self, t: Float[Array, ""], state: ReleasedState | PlacedState) -> StickingState:
        given = super().start(t, state)
        return StickingState(**vars(given), slips=jnp.sign(given.body.thetadot[sticking_slots(self.body)]))

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
