"""A body that rolls, slides or flies, with joints that dry friction may hold: in each of its modes each joint sticks or
slips, as in ``stick_slip``.

Joints that stick are held in the matrix of the equations, so that the response of the body to the ground is that of one
in which they are locked, and so is the friction that holds them: linear in the slip acceleration. What ends a mode are
the three guards of a contact, and two for each joint.

In an impact no joint is held. The friction that holds a joint is finite, and gives no impulse, as no other finite force
does. So joints take their part of an impact freely, and those that it has set in motion slip afterwards.
"""

import dataclasses
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..body import AbstractBody
from ..dynamics.sticking import describe_changes, largest_frictions, sticking_slots, with_directions
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


class StickingSwitches(ContactSwitches):
    """The switches of such a body: of the mode of its contact, and of its joints.

    - ``directions_before``, ``directions_after``: in which each joint with dry friction slips, 0 where it sticks,
      shape (capacity, joints).
    - ``joints``: what these joints are called.
    """

    directions_before: Float[Array, "*batch capacity joints"]
    directions_after: Float[Array, "*batch capacity joints"]
    joints: tuple[str, ...] = eqx.field(static=True)

    def words(self, k: int) -> str:
        changed = describe_changes(self.joints, self.directions_before[k], self.directions_after[k])
        source, target = (int(np.asarray(column)[k]) for column in (self.source, self.target))
        of_joint = int(np.asarray(self.event)[k]) in (SwitchCause.JOINT_STOPS, SwitchCause.JOINT_BREAKS_LOOSE)
        of_contact = not of_joint or source != target or not changed
        return ", ".join([*([super().words(k)] if of_contact else []), *changed])


class StickingHistory(ContactHistory):
    """The modes of a run with a law of contact and joints that stick, at its saved times.

    - ``directions``: in which each joint with dry friction slips, 1 or −1, and 0 where it sticks, shape (T, joints).
    """

    described: ClassVar[str] = "a law of contact and joints that stick"
    changing: ClassVar[str] = "the mode of contact or of a joint"

    directions: Float[Array, "*batch T joints"]

    @property
    def sticks(self) -> Bool[Array, "*batch T joints"]:
        """Whether each joint sticks at the saved times."""
        return self.directions == 0

    @property
    def over_time(self) -> dict[str, Array]:
        return super().over_time | {"directions": self.directions}

    def as_solved(self, system: AbstractBody, states: Any) -> "tuple[StickingOnPlane, StickingState]":
        plane, state = super().as_solved(system, states)
        fields = {field.name: getattr(state, field.name) for field in dataclasses.fields(state)}
        return StickingOnPlane(system, plane.contact), StickingState(**fields, slips=self.directions)


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
        """Computes the guards of the contact, and two for each joint, as in ``stick_slip``."""
        response = self.response(t, state)
        acting = self.interaction(t, state, response)
        of_contact = self.guards_of_contact(t, state, reference, response, acting)
        holding = response.holding(acting.slip_acceleration, acting.normal)
        sticks, largest = state.slips == 0, largest_frictions(self.body)
        onward = state.slips * state.body.thetadot[sticking_slots(self.body)]
        first = jnp.where(sticks, largest - holding, onward)
        return jnp.concatenate([of_contact, first, jnp.where(sticks, largest + holding, 1.0)])

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
        fields = {field.name: getattr(contact_state, field.name) for field in dataclasses.fields(contact_state)}
        return StickingState(**fields, slips=jnp.sign(contact_state.body.thetadot[sticking_slots(self.body)]))

    def transition(self, t: Float[Array, ""], state: Any, event: Int[Array, ""], accuracy: Accuracy) -> Transition:
        return transition(self, t, state, event, accuracy)

    # What a run shows.

    def history(self, times: Float[Array, " T"], states: Any, record: Any) -> StickingHistory:
        of_contact = super().history(times, states, record)
        fields: dict[str, Any]
        fields, switches = (
            {field.name: getattr(each, field.name) for field in dataclasses.fields(each)}
            for each in (of_contact, of_contact.switches)
        )
        fields["switches"] = StickingSwitches(
            **switches,
            directions_before=record.before.slips,
            directions_after=record.after.slips,
            joints=self.body.sticking,
        )
        return StickingHistory(**fields, directions=states.slips)
