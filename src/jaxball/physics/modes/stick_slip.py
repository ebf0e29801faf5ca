"""A body whose joints stick and slip, as one hybrid system with a mode for each joint with dry friction.

``simulate`` solves it in place of a body with such joints, if no law of contact is given.

A joint slips until its rate θ̇ falls to zero, and sticks until the friction that holds it reaches its static level. It
is then held exactly, with θ̇ = 0 and θ̈ = 0. As one joint sticks or breaks loose, the load of others that stick jumps,
and those that friction no longer holds break loose at the same time.
"""

from collections.abc import Iterator
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ...programs.derivatives.differentiation import without_derivatives
from ..body import AbstractBody, AbstractBodyWithModes
from ..conditions import Condition
from ..dynamics.equations import holding_friction
from ..dynamics.sticking import (
    JointHistory,
    JointSwitches,
    change_joint,
    release_joints,
    sticking_guards,
    sticking_slots,
    with_directions,
)
from ..hybrid import Record
from ..state import State
from ..system import AbstractState


class StickSlipState(AbstractState):
    """The variables of a body whose joints stick and slip that a solve advances.

    - ``body``: the state of the body; θ̇ of a joint that sticks is 0.
    - ``slips``: for each joint with dry friction, 1 or −1 where it slips in that direction, 0 where it sticks.
    """

    body: State
    slips: Float[Array, "*batch sticking"]

    def projected(self) -> "StickSlipState":
        return eqx.tree_at(lambda x: x.body, self, self.body.projected())

    def conditions(self) -> Iterator[Condition]:
        yield from self.body.conditions()


class StickSlipSwitches(JointSwitches):
    """The times at which joints stick, break loose or turn back."""

    def words(self, k: int) -> str:
        return ", ".join(self.changes(k)) or "nothing changed"


class StickSlipHistory(JointHistory):
    """Which joints stick at the saved times of a run, and the ``switches``, :class:`StickSlipSwitches`."""

    described: ClassVar[str] = "joints that stick, at which forces jump"

    switches: StickSlipSwitches

    @property
    def lines(self) -> list[str]:
        if int(self.switches.count) == 0:
            return ["no joint began to stick or broke loose"]
        return [f"joints stuck, broke loose or turned back {self.switches.how_often}", *self.switches.first_lines]


class StickSlip(AbstractBodyWithModes[StickSlipState]):
    """A ball or a disk with joints that dry friction may hold."""

    body: AbstractBody

    title: ClassVar[str] = "body with joints that stick and slip"
    state_type: ClassVar[Any] = StickSlipState

    def prepare(self) -> "StickSlip":
        return StickSlip(self.body.prepare())

    # The motion.

    def field(self, t: Float[Array, ""], state: StickSlipState) -> StickSlipState:
        moved = self.moving(state).field(t, state.body)
        return StickSlipState(moved, jnp.zeros_like(state.slips))

    def moving(self, state: StickSlipState) -> AbstractBody:
        return with_directions(self.body, state.slips)

    def guards(self, t: Float[Array, ""], state: StickSlipState) -> Float[Array, " guards"]:
        holding = holding_friction(self.moving(state), t, state.body)
        return sticking_guards(self.body, state.slips, state.body.thetadot, holding)

    def reset(self, t: Float[Array, ""], state: StickSlipState, which: Int[Array, ""]) -> StickSlipState:
        """Returns the state after an event: a joint that broke loose slips against the friction that held it; one that
        stopped is held if it can be.
        """
        directions, thetadot = change_joint(self.body, state.slips, state.body.thetadot, which)
        body = eqx.tree_at(lambda x: x.thetadot, state.body, thetadot)
        return StickSlipState(body, self._release(t, body, directions))

    def start(self, t: Float[Array, ""], state: State) -> StickSlipState:
        """Returns the state with which a solve starts; a joint at rest sticks if friction can hold it."""
        moving = jnp.sign(state.thetadot[sticking_slots(self.body)])
        return StickSlipState(state, self.prepare()._release(t, state, moving))

    def _release(
        self, t: Float[Array, ""], state: State, directions: Float[Array, " sticking"]
    ) -> Float[Array, " sticking"]:
        # Which joints stick is a yes or no for each, and has no derivatives.
        body, t, state, directions = without_derivatives((self.body, t, state, directions))
        return release_joints(body, directions, lambda body: holding_friction(body, t, state))

    # What a run shows.

    def history(self, times: Float[Array, " T"], states: StickSlipState, record: Record | None) -> StickSlipHistory:
        assert record is not None
        switches = StickSlipSwitches.of(
            record,
            before=record.before.body,
            after=record.after.body,
            directions_before=record.before.slips,
            directions_after=record.after.slips,
            joints=self.body.sticking,
        )
        return StickSlipHistory(switches=switches, directions=states.slips)
