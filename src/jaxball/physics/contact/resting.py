"""A body that rolls, slides or flies where exact dry resistance may hold it at rest on its ground.

``simulate`` solves it in place of a body that has such resistance and is given a law of contact.

The modes are those of a body on its ground, and in each of them but flight the body turns, or is held against rolling
or against spinning. A body that does not slip and is held against rolling is at rest. One that slips may be held, too:
it slides without turning where sliding friction is less than dry resistance. In flight the ground resists nothing.
Impacts have no impulse of dry resistance.

What ends a mode are the three guards of a contact, and those of ``dry_rolling``: the rate of rolling or of spinning in
its direction, or what dry resistance has to spare where it holds the body.
"""

import dataclasses
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ...numerics.directions import unit
from ...numerics.vectors import apply
from ..body import AbstractBody
from ..dynamics.footing import ContactAxes, footing_of_released, rate_of_carrier
from ..dynamics.load import Load
from ..grounds import Footing
from ..hybrid import NONE, SLOW_ROLLING, WINDOW, Accuracy, Assessment, GuardedStep, Transition
from ..state import PlacedState
from . import friction, over_surface as over
from .body_on_plane import BodyOnPlane, ContactHistory
from .modes import ContactState, Mode, SwitchCause
from .released import ReleasedState, Response, response, slip_velocity
from .resisted import DryTorque, Resisting
from .resting_transition import Headings, transition
from .slip import Heading
from .turning import AbstractTurning
from .window import Beginning

TURNING_GUARD, SPINNING_GUARD = 3, 4  # after the three of a contact


class RestingState(ContactState):
    """The variables of a body that may slip, fly and rest, which a solve advances.

    A solve advances ω relative to the ground, in contact axes (in flight, and on a plane, those of space), instead of
    Ω, so that it is exactly 0 at rest.

    - ``rolls``, ``spin``, ``rolling``: how it turns, as in :class:`AbstractTurning`.
    """

    rolls: Float[Array, "*batch"]
    spin: Float[Array, "*batch"]
    rolling: Beginning


class RestingHistory(ContactHistory):
    """The modes of a run with a law of contact and exact dry resistance, at its saved times.

    - ``rests``: whether dry resistance held the body against rolling, shape (T,); a body that slips may be held, too.
    - ``spin``: the sign of ω₃ as friction against spinning has it, 0 where that is held or there is none, shape (T,).
    - ``rolling``: the direction of ω_h of a body that rolls, a unit vector, also where that begins; else 0,
      shape (T, 2).
    """

    described: ClassVar[str] = "a law of contact and exact dry resistance"

    rests: Bool[Array, "*batch T"]
    spin: Float[Array, "*batch T"]
    rolling: Float[Array, "*batch T 2"]

    @property
    def advice(self) -> str:
        return super().advice or SLOW_ROLLING

    @property
    def over_time(self) -> dict[str, Array]:
        return super().over_time | {name: getattr(self, name) for name in ("rests", "spin", "rolling")}

    def as_solved(self, system: AbstractBody, states: Any) -> "tuple[RestingOnPlane, RestingState]":
        plane, state = super().as_solved(system, states)
        # Rest is a mode to those who read a run; to the equations it is rolling with ``rolls`` = 0.
        mode = jnp.where(self.mode == int(Mode.REST), int(Mode.ROLLING), self.mode).astype(state.mode.dtype)
        rolls = jnp.where(self.rests, 0.0, 1.0).astype(state.mode.dtype)
        rolling = Beginning.along(state.begun.until, self.rolling)
        fields: dict[str, Any] = dict(vars(state), mode=mode)
        solved = RestingState(**fields, rolls=rolls, spin=self.spin, rolling=rolling)
        return RestingOnPlane(system, plane.contact), solved


class RestingOnPlane(AbstractTurning, BodyOnPlane):
    """A ball or a disk with a law of contact, which exact dry resistance may hold at rest."""

    title: ClassVar[str] = "body with a law of contact and exact dry resistance"
    state_type: ClassVar[Any] = RestingState

    def prepare(self) -> "RestingOnPlane":
        return RestingOnPlane(self.body.prepare(), self.contact)

    # What a solve advances.

    def to_packed(self, t: Float[Array, ""], state: Any) -> Any:
        packed = super().to_packed(t, state)
        omega = self.unless_held(state, self.over_ground(t, state))
        return eqx.tree_at(lambda x: x.body, packed, packed.body.with_Omega(omega))

    def from_packed(self, t: Float[Array, ""], packed: Any) -> Any:
        packed = packed.projected()
        Omega = self.contact_axes(t, packed).in_body(packed.body.Omega)
        return super().from_packed(t, eqx.tree_at(lambda x: x.body, packed, packed.body.with_Omega(Omega)))

    def field_of_packed(self, t: Float[Array, ""], packed: Any) -> Any:
        moved = super().field_of_packed(t, packed)
        rate = self.rate_over_ground(t, self.from_packed(t, packed), moved.body.Omega)
        return eqx.tree_at(lambda x: x.body, moved, moved.body.with_Omega(self.unless_held(packed, rate)))

    def contact_axes(self, t: Float[Array, ""], state: Any) -> ContactAxes:
        """Returns the axes of the contact at a state, packed or not; in flight the axes of space, which are at rest."""
        body = state.body
        if not over.has_surface(self.body):
            return ContactAxes(body.Lambda, None)
        flies = state.is_in(Mode.FLIGHT)
        # In flight, the place of a packed state has no coordinates.
        u = jnp.where(flies, jnp.reshape(state.near, body.z.shape), body.z)
        touching = ContactAxes.of(self.body, t, eqx.tree_at(lambda x: x.z, body, u))
        assert touching.spin is not None
        return ContactAxes(jnp.where(flies, body.Lambda, touching.rows), jnp.where(flies, 0.0, touching.spin))

    def over_ground(self, t: Float[Array, ""], state: Any) -> Float[Array, "3"]:
        """Computes ω relative to the ground, in contact axes."""
        return self.contact_axes(t, state).over_ground(state.body.Omega)

    def rate_over_ground(self, t: Float[Array, ""], state: Any, Omegadot: Float[Array, "3"]) -> Float[Array, "3"]:
        """Computes the rate of ω relative to the ground, in contact axes, from Ω̇."""
        rate, carried = apply(self.contact_axes(t, state).rows, Omegadot), self.compute_carried_rate(t, state)
        return rate if carried is None else rate + carried

    def compute_carried_rate(
        self, t: Float[Array, ""], state: Any, under: Footing | None = None
    ) -> Float[Array, "3"] | None:
        """Computes that rate while ω is constant, contact axes; None on a plane. ``under`` is the footing, if known."""
        if not over.has_surface(self.body):
            return None
        touching = ~state.is_in(Mode.FLIGHT)
        if under is None:
            under = footing_of_released(self.body, t, state.body, state.V, state.height, touching)
        carried = rate_of_carrier(self.body, t, state.body, under)
        assert carried is not None
        return jnp.where(touching, apply(self.contact_axes(t, state).rows, carried), 0.0)

    # The plane.

    def direction(self, t: Float[Array, ""], state: RestingState) -> Float[Array, "2"]:
        """Returns the direction of ω_h of a body that rolls, contact axes."""
        omega = self.over_ground(t, state)
        begins = t <= state.rolling.until
        return jnp.where(begins, state.rolling.direction(t), unit(omega[:2]))

    def resisting(self, t: Float[Array, ""], state: RestingState) -> Resisting:
        """Returns the body before its mode of turning is known."""
        body_response = response(self.body, t, state.released, touching=~state.is_in(Mode.FLIGHT))
        carried = self.compute_carried_rate(t, state, body_response.footing)
        return Resisting.of(self.body, self.contact_axes(t, state).rows, body_response, carried)

    def response(self, t: Float[Array, ""], state: Any) -> Response:
        resisting = self.resisting(t, state)
        return resisting.resist_turning(resisting.torque(self.mode(t, state)))

    def torque(self, t: Float[Array, ""], state: RestingState) -> tuple[Resisting, DryTorque]:
        """Returns the body and its dry torque."""
        resisting = self.resisting(t, state)
        return resisting, resisting.torque(self.mode(t, state))

    def dry_torque(
        self, t: Float[Array, ""], state: Any, interaction: friction.Interaction, acting: Load
    ) -> Float[Array, "3"]:
        resisting, torque = self.torque(t, state)
        return apply(resisting.axes.T, torque(interaction.slip_acceleration, interaction.normal))

    # The guards.

    def step_reference(self, t: Float[Array, ""], state: Any, accuracy: Accuracy) -> Any:
        """Returns the headings of a slip and of rolling as a step begins."""
        return Headings(super().step_reference(t, state, accuracy), self.heading_of_rolling(t, state, accuracy))

    def guards(self, t: Float[Array, ""], state: Any) -> Float[Array, "5"]:
        """Computes the guards without a solve, in which a slip and rolling end where their velocities vanish."""
        sigma, zero = state.direction(t, slip_velocity(self.body, t, state.released)), jnp.zeros_like(state.height)
        headings = Heading(sigma, zero, zero), Heading(self.direction(t, state), zero, zero)
        return self.guards_in_step(t, state, Headings(*headings))

    def guards_in_step(self, t: Float[Array, ""], state: Any, reference: Any) -> Float[Array, "5"]:
        """Computes the guards of the contact, of rolling and of spinning."""
        resisting, torque = self.torque(t, state)
        response = resisting.resist_turning(torque)
        acting = self.interaction(t, state, response)
        of_contact = self.guards_of_contact(t, state, reference.slip, response, acting)
        spare, unit = resisting.spare(torque, acting), jnp.ones_like(state.height)
        of_turning = self.guards_of_turning(t, state, spare, reference.rolling)
        return jnp.concatenate([of_contact, jnp.where(state.is_in(Mode.FLIGHT), unit, of_turning)])

    def time_event(self, t: Float[Array, ""], state: Any) -> Float[Array, ""]:
        """Returns the next end of a window in which the direction of a slip or of rolling is known beforehand."""
        slip, rolling = super().time_event(t, state), state.rolling.until
        if self.body.planar:
            return slip
        rolling = jnp.where((state.rolls != 0) & (rolling > t), rolling, jnp.inf)
        return jnp.minimum(jnp.where(slip > t, slip, jnp.inf), rolling)

    def assess(self, step: GuardedStep, accuracy: Accuracy) -> Assessment:
        """Finds the cause that the guard which is zero stands for, or an end of a slip or of rolling; and the longest
        step.
        """
        # The contact assesses its own three guards, as if there were no others.
        turns, state = step.zero >= TURNING_GUARD, step.state
        reference, guards = step.reference, step.guards
        contact_step = step._replace(
            reference=reference.slip,
            guards=guards[:TURNING_GUARD],
            zero=jnp.where(turns, NONE, step.zero),
        )
        contact = super().assess(contact_step, accuracy)
        rolls = (state.rolls != 0) & ~state.is_in(Mode.FLIGHT) & self.resists_rolling
        stops, ends = rolls & (step.zero == TURNING_GUARD), turns & step.has_fallen
        nears, longest = jnp.zeros_like(turns), contact.longest
        if not self.body.planar:
            # The rate along the heading also falls to zero where a ball turns aside at speed: only a slow one may be at
            # its end.
            slow, nears, braked = self.approach_rest(step, reference.rolling, TURNING_GUARD, accuracy)
            ends, nears = turns & jnp.where(stops, slow, step.has_fallen), rolls & nears
            longest = jnp.minimum(longest, jnp.where(rolls & ~ends, braked, jnp.inf))
        rolling = jnp.where(state.rolls == 0, int(SwitchCause.BREAKS_LOOSE), int(SwitchCause.ROLLING_ENDS))
        spinning = jnp.where(state.spin == 0, int(SwitchCause.BEGINS_TO_SPIN), int(SwitchCause.SPINNING_ENDS))
        cause = jnp.where(step.zero == SPINNING_GUARD, spinning, rolling)
        otherwise = jnp.where((contact.event == NONE) & step.timed & rolls, WINDOW, contact.event)
        otherwise = jnp.where((contact.event < 0) & nears, int(SwitchCause.ROLLING_ENDS), otherwise)
        return Assessment(jnp.where(ends, cause, otherwise), longest)

    # How modes begin.

    def start(self, t: Float[Array, ""], state: ReleasedState | PlacedState) -> RestingState:
        contact_state = super().start(t, state)
        unit = jnp.ones_like(contact_state.height)  # nothing is held before the first transition
        return RestingState(**vars(contact_state), rolls=unit, spin=unit, rolling=Beginning.none(unit))

    def transition(self, t: Float[Array, ""], state: Any, event: Int[Array, ""], accuracy: Accuracy) -> Transition:
        return transition(self, t, state, event, accuracy)

    # What a run shows.

    def history(self, times: Float[Array, " T"], states: Any, record: Any) -> RestingHistory:
        of_contact = super().history(times, states, record)
        rests = states.rolls == 0
        plane = self.prepare()
        rolling = jax.lax.map(lambda arguments: plane.direction(*arguments), (times, states))
        before, after = ((x.mode, x.rolls) for x in (record.before, record.after))
        switches = dataclasses.replace(
            of_contact.switches,
            source=_with_rest(of_contact.switches.source, before[1]),
            target=_with_rest(of_contact.switches.target, after[1]),
        )
        return RestingHistory(
            **vars(of_contact) | {"mode": _with_rest(of_contact.mode, states.rolls), "switches": switches},
            rests=rests,
            spin=states.spin,
            rolling=jnp.where(rests[..., None], 0.0, rolling),
        )


def _with_rest(mode: Int[Array, "*rows"], rolls: Float[Array, "*rows"]) -> Int[Array, "*rows"]:
    """Returns the modes, with rest in place of rolling where dry resistance holds the body."""
    return jnp.where((mode == int(Mode.ROLLING)) & (rolls == 0), int(Mode.REST), mode)
