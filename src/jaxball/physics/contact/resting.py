"""A body that rolls, slides or flies where exact dry resistance may hold it at rest on its ground.

``simulate`` solves it in place of a body that has such resistance and is given a law of contact.

The modes are those of a body on its ground, and in each of them but flight the body turns, or is held against rolling
or against spinning. A body that does not slip and is held against rolling is at rest. One that slips may be held, too:
it slides without turning where sliding friction is less than dry resistance. In flight the ground resists nothing.
Impacts have no impulse of dry resistance.

What ends a mode are the three guards of a contact, and those of ``modes.held``: the rate of rolling or of spinning in
its direction, or what dry resistance has to spare where it holds the body.
"""

import dataclasses
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ...numerics.arrays import select_tree
from ...numerics.directions import unit
from ...numerics.vectors import apply
from ..body import AbstractBody
from ..dynamics.footing import ContactAxes, footing_of_released, rate_of_carrier
from ..dynamics.load import Load
from ..dynamics.rest import TurningLaw, candidates, needs
from ..forces.resistance import TurningMode
from ..grounds import Footing
from ..hybrid import NONE, SLOW_ROLLING, START, WINDOW, Accuracy, Assessment, GuardedStep
from ..state import PlacedState
from . import friction, over_surface as over
from .body_on_plane import BodyOnPlane, ContactHistory
from .holding import Choice, Headings, begin, decide_held, end_rolling
from .modes import ContactState, Mode, SwitchCause
from .released import ReleasedState, Response, Turned, slip_velocity
from .slip import Heading
from .transition import Progress, only_if
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

    def response(self, t: Float[Array, ""], state: Any) -> Response:
        return self.response_in(t, state, self.mode(t, state))

    def response_in(self, t: Float[Array, ""], state: Any, mode: TurningMode) -> Response:
        """Computes how the body moves under each reaction in a mode of turning."""
        body_response = super().response(t, state)
        carried = self.compute_carried_rate(t, state, body_response.footing)
        turned = Turned(self.contact_axes(t, state).rows, carried, self.law_of_turning(state, mode))
        return body_response._replace(turned=turned)

    def law_of_turning(self, state: Any, mode: TurningMode) -> TurningLaw:
        """Returns what exact dry resistance gives in a mode of turning."""
        law = TurningLaw.of(self.resistance, self.body.height_of_centre(state.body.Gamma), mode)
        # A disk is held upright by other forces than friction.
        return law._replace(solved=law.solved.at[0].set(False)) if self.body.planar else law

    def dry_torque(
        self, t: Float[Array, ""], state: Any, interaction: friction.Interaction, acting: Load
    ) -> Float[Array, "3"]:
        return apply(self.contact_axes(t, state).rows.T, interaction.torque)

    # The guards.

    def step_reference(self, t: Float[Array, ""], state: Any, accuracy: Accuracy) -> Any:
        """Returns the headings of a slip and of rolling as a step begins."""
        return Headings(super().step_reference(t, state, accuracy), self.heading_of_rolling(t, state, accuracy))

    def guards(self, t: Float[Array, ""], state: Any) -> Float[Array, "5"]:
        """Computes the guards without a solve, in which a slip and rolling end where their velocities vanish."""
        sigma, zero = state.direction(t, slip_velocity(self.body, t, state.released)), jnp.zeros_like(state.height)
        headings = Heading(sigma, zero, zero), Heading(self.direction(t, state), zero, zero)
        return self.guards_in_step(t, state, Headings(*headings))

    def guards_where(
        self, t: Float[Array, ""], state: Any, reference: Any, response: Response, acting: friction.Interaction
    ) -> Float[Array, "5"]:
        """Computes the guards of the contact, of rolling and of spinning."""
        of_contact = super().guards_where(t, state, reference.slip, response, acting)
        height = self.body.height_of_centre(state.body.Gamma)
        spare = needs(self.resistance, height, acting.torque, acting.normal)
        of_turning = self.guards_of_turning(t, state, spare, reference.rolling)
        return jnp.concatenate([of_contact, jnp.where(state.is_in(Mode.FLIGHT), 1.0, of_turning)])

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

    def start(self, t: Float[Array, ""], state: ReleasedState | PlacedState) -> Any:
        contact_state = super().start(t, state)
        unit = jnp.ones_like(contact_state.height)  # nothing is held before the first transition
        return RestingState(**vars(contact_state), rolls=unit, spin=unit, rolling=Beginning.none(unit))

    # The parts of a transition.

    def guard_of(self, state: Any, event: Int[Array, ""]) -> Int[Array, ""]:
        of_contact = super().guard_of(state, event)
        turns, spins = (_is_one_of(event, *causes) for causes in (_ROLLING, _SPINNING))
        return jnp.where(turns, TURNING_GUARD, jnp.where(spins, SPINNING_GUARD, of_contact))

    def with_fixed_speeds(self, heading: Headings) -> Headings:
        slip, rolling = heading
        # A ball's rolling is given to ``end_rolling`` while it still has this speed, which counts as fixed. That of a
        # disk does not turn, and is followed to exactly zero.
        least = jnp.zeros_like(rolling.speed) if self.body.planar else rolling.speed
        return Headings(super().with_fixed_speeds(slip), rolling._replace(least=least))

    def progress(self, t: Float[Array, ""], state: Any, event: Int[Array, ""]) -> Progress:
        done, none, no = super().progress(t, state, event), Beginning.none(state.height), jnp.asarray(False)
        # The end of one window leaves the other in force; a new mode leaves neither.
        begun, rolling = (select_tree(done.decides | (x.until <= t), none, x) for x in (state.begun, state.rolling))
        if self.body.planar:
            rolling = state.rolling  # that of a disk does not turn
        now = eqx.tree_at(lambda x: (x.begun, x.rolling), done.state, (begun, rolling))
        return done._replace(state=now, stands=no, turns=no)

    def end_rolling(self, done: Progress, event: Int[Array, ""], tolerance: Float[Array, ""]) -> Progress:
        return only_if(event == int(SwitchCause.ROLLING_ENDS), end_rolling, self, done, tolerance)

    def decide(self, done: Progress, event: Int[Array, ""]) -> Progress:
        return decide_held(self, done, event)

    def all_held(self, done: Progress, event: Int[Array, ""]) -> tuple[Any, TurningMode | None, Bool[Array, " loads"]]:
        state: Any = eqx.tree_at(lambda x: x.mode, done.state, jnp.full_like(done.state.mode, int(Mode.SLIDING)))
        assert done.stands is not None
        axes, before = self.contact_axes(done.t, state), done.state
        omega = self.unless_held(before, axes.over_ground(before.body.Omega))
        spin_ends = event == int(SwitchCause.SPINNING_ENDS)
        omega = jnp.where(jnp.stack([done.stands, done.stands, spin_ends]), 0.0, omega)
        before = eqx.tree_at(lambda x: x.body, before, before.body.with_Omega(axes.in_body(omega)))
        moving = candidates(self.resistance, omega, self.body.planar)
        # A body that rolls comes to rest by an event that says so, and not because its rate is rounding, as just after
        # it broke loose. In flight the ground holds nothing.
        may_rest = (event == START) | done.stands | done.lands | (before.rolls == 0)
        moving = moving._replace(rests=moving.rests & may_rest & ~done.flies, still=moving.still & ~done.flies)
        breaks, spins = event == int(SwitchCause.BREAKS_LOOSE), event == int(SwitchCause.BEGINS_TO_SPIN)
        return before, moving, jnp.stack([moving.rests & breaks, moving.still & spins])

    def as_chosen(self, state: Any, choice: Choice, t: Float[Array, ""]) -> Any:
        """Returns the state in the modes of a choice."""
        assert choice.mode is not None
        mode, dtype = choice.mode, state.V.dtype
        spin = mode.spin if self.resists_spinning else jnp.zeros_like(mode.spin)
        # In flight the ground holds nothing, and 0 would say that it does.
        spin = jnp.where(choice.flies & (spin == 0), 1.0, spin).astype(dtype)
        turning = jnp.where(mode.rests, 0.0, 1.0).astype(dtype), spin, Beginning.along(t, mode.sigma[:2])
        return eqx.tree_at(lambda x: (x.rolls, x.spin, x.rolling), state, turning)

    def begin(self, done: Progress, tolerance: Float[Array, ""]) -> RestingState:
        return begin(self, done, tolerance)

    def slows(self, event: Int[Array, ""]) -> Bool[Array, ""]:
        return super().slows(event) | (event == int(SwitchCause.ROLLING_ENDS)) & (not self.body.planar)

    # What a run shows.

    def history(self, times: Float[Array, " T"], states: Any, record: Any) -> Any:
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


_ROLLING = SwitchCause.ROLLING_ENDS, SwitchCause.BREAKS_LOOSE
_SPINNING = SwitchCause.SPINNING_ENDS, SwitchCause.BEGINS_TO_SPIN


def _is_one_of(cause: Int[Array, ""], *causes: SwitchCause) -> Bool[Array, ""]:
    return jnp.any(jnp.stack([cause == int(each) for each in causes]))


def _with_rest(mode: Int[Array, "*rows"], rolls: Float[Array, "*rows"]) -> Int[Array, "*rows"]:
    """Returns the modes, with rest in place of rolling where dry resistance holds the body."""
    return jnp.where((mode == int(Mode.ROLLING)) & (rolls == 0), int(Mode.REST), mode)
