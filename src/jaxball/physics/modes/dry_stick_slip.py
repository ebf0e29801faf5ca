"""A body that exact dry resistance brings to rest, with joints that stick and slip.

``simulate`` solves it in place of a body with both, if no law of contact is given.

Everything that dry friction may hold is held at once by one linear system: joints that stick are held in its matrix,
and the torque at the contact is what then keeps ω_h and ω₃ as they are. Its guards are those of ``dry_rolling``, and
those of ``stick_slip``. As one thing stops or lets go, the loads of all others jump, and the most overloaded lets go
first.
"""

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...programs.derivatives.differentiation import without_derivatives
from ..body import AbstractBody
from ..dynamics.equations import holding_friction
from ..dynamics.footing import ContactAxes
from ..dynamics.law import release
from ..dynamics.rest import begin, let_go, needs, resist
from ..dynamics.sticking import (
    JointHistory,
    JointSwitches,
    change_joint,
    loosen,
    overloads,
    sticking_guards,
    sticking_slots,
    with_directions,
)
from ..forces.resistance import TurningMode
from ..hybrid import Record
from ..state import PlacedState
from .dry_rolling import DryRolling, DryRollingState, Happened, RestHistory, RestSwitches, in_mode

OF_TURNING = 2  # guards of rolling and of spinning, before those of the joints


class DryStickSlipState(DryRollingState):
    """The variables of a body that rests and whose joints stick, which a solve advances.

    - ``slips``: for each joint with dry friction, 1 or −1 where it slips in that direction, 0 where it sticks.
    """

    slips: Float[Array, "*batch sticking"]


class DryStickSlipSwitches(JointSwitches, RestSwitches):
    """The times at which the body comes to rest, breaks loose or turns back, or a joint does."""

    def words(self, k: int) -> str:
        changed, turned = self.changes(k), super().words(k)
        return ", ".join([*([] if turned == "nothing changed" and changed else [turned]), *changed])


class DryStickSlipHistory(JointHistory, RestHistory):
    """When dry friction held a body and its joints at the saved times of a run, and the switches."""

    described: ClassVar[str] = "exact dry resistance and joints that stick, with which forces jump"


class DryStickSlip(DryRolling):
    """A ball or a disk that exact dry resistance may hold at rest, with joints that dry friction may hold."""

    title: ClassVar[str] = "body with exact dry resistance and joints that stick"
    state_type: ClassVar[Any] = DryStickSlipState

    def prepare(self) -> "DryStickSlip":
        return DryStickSlip(self.body.prepare())

    def moving(self, state: Any) -> AbstractBody:
        return with_directions(self.body, state.slips)

    # The guards.

    def guards_in_step(self, t: Float[Array, ""], state: Any, reference: Any) -> Float[Array, " guards"]:
        """Computes the guards of the body, and two for each joint."""
        of_turning = super().guards_in_step(t, state, reference)
        holding = self.holding(t, state.body, state.slips, self.mode(t, state))
        return jnp.concatenate([of_turning, sticking_guards(self.body, state.slips, state.body.thetadot, holding)])

    def holding(
        self, t: Float[Array, ""], state: PlacedState, directions: Float[Array, " sticking"], mode: TurningMode
    ) -> Float[Array, " sticking"]:
        """Computes the friction in joints that stick, where the body turns in a mode that is given in space axes."""
        return holding_friction(in_mode(with_directions(self.body, directions), mode), t, state)

    # How modes follow each other.

    def start(self, t: Float[Array, ""], state: PlacedState) -> DryStickSlipState:
        slips = jnp.sign(state.thetadot[sticking_slots(self.body)])
        return DryStickSlipState(**vars(super().start(t, state)), slips=slips)

    def decide(self, t: Float[Array, ""], state: Any, given: Happened) -> Any:
        """Returns the state in the mode that follows: everything is at rest that friction can hold so."""
        state = self._joints_changed(state, given)
        moving, omega, _ = self.all_held(t, state, given)
        body = state.body.with_Omega(ContactAxes.of(self.body, t, state.body).in_body(omega))
        state = eqx.tree_at(lambda x: x.body, state, body)
        spins = given.spinning & self.is_held_still(state)
        last = self._release(t, state, moving, given.loosens & moving.rests, spins & moving.still)
        state = eqx.tree_at(lambda x: x.slips, state, last.slips)
        # What has let go was decided without derivatives, and is let go again here, where the direction of rolling has
        # them.
        rolls, loose = moving.rests & ~last.mode.rests, moving.still & ~last.mode.still
        mode = begin(self.resistance, self.turning(t, state), moving, self.body.planar, rolls, loose)
        return self.with_mode(t, state, omega, mode, moving.rests & ~mode.rests)

    def _joints_changed(self, state: DryStickSlipState, occurrence: Happened) -> DryStickSlipState:
        """Returns the state after an event of a joint: one that stopped is held, and one that was held slips."""
        which = occurrence.event - OF_TURNING
        directions, thetadot = change_joint(self.body, state.slips, state.body.thetadot, which)
        return eqx.tree_at(lambda x: (x.body.thetadot, x.slips), state, (thetadot, directions))

    def _release(
        self,
        t: Float[Array, ""],
        state: DryStickSlipState,
        moving: TurningMode,
        rolls: Bool[Array, ""],
        spins: Bool[Array, ""],
    ) -> "_Held":
        """Finds what is held when friction has let go of all that it cannot hold, the most overloaded first.

        ``rolls`` and ``spins`` say that it lets go at once of rolling and of spinning.
        """
        system, t, state, moving = without_derivatives((self, t, state, moving))

        def weigh(held: _Held) -> tuple[Array, tuple[Array, Array]]:
            turns = system.turning(t, eqx.tree_at(lambda x: x.slips, state, held.slips))
            acting = resist(system.resistance, turns, held.mode)
            need = needs(system.resistance, turns.radius, acting.amounts, acting.normal)
            friction = system.holding(t, state.body, held.slips, held.mode)
            of_joints = overloads(system.body, held.slips, friction)
            return jnp.concatenate([need.overloads(held.mode), of_joints]), (acting.amounts, friction)

        def without(held: _Held, acting: tuple[Array, Array], off: Bool[Array, " loads"]) -> _Held:
            torque, friction = acting
            mode = let_go(held.mode, torque, off[:OF_TURNING])
            return _Held(mode, loosen(held.slips, friction, off[OF_TURNING:]))

        at_once = jnp.concatenate([jnp.stack([rolls, spins]), jnp.zeros(state.slips.size, bool)])
        return release(_Held(moving, state.slips), weigh, without, at_once)

    # What a run shows.

    def history(self, times: Float[Array, " T"], states: Any, record: Record | None) -> RestHistory:
        assert record is not None
        of_turning = super().history(times, states, record)
        fields: dict[str, Any] = dict(vars(of_turning))
        fields["switches"] = DryStickSlipSwitches(
            **vars(of_turning.switches),
            directions_before=record.before.slips,
            directions_after=record.after.slips,
            joints=self.body.sticking,
        )
        return DryStickSlipHistory(**fields, directions=states.slips)


class _Held(NamedTuple):
    """What is held: the mode of turning, and the directions of joints, 0 where they stick."""

    mode: TurningMode
    slips: Float[Array, " sticking"]
