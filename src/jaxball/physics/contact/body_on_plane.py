"""A body on its ground whose motion has modes, as one hybrid system.

``simulate`` solves it in place of a body that has a law of contact, or that dry friction may hold. Within a mode, the
motion follows a smooth field, and guard functions are positive. Where one of them falls to zero, the mode ends, and the
next one is decided there: everything that does not move is held, as far as friction can do it. ``guards`` says what
ends a mode, ``transition`` what follows, and ``holding`` what is then held.

It has three parts, of which each is there or not. That is known before anything is computed:

- **A law of contact.** Rolling ends where it would need more friction than μ_s N, sliding where the slip velocity
  vanishes, both where the normal force falls to zero, and flight where the body lands, with an impact. On the ground, a
  body that does not slip rolls if friction can hold it, and else begins to slip as ``friction.first_slip`` determines.
- **Exact dry resistance.** In each mode but flight the body rolls until ω_h falls to zero, and is then held, at rest if
  it does not slip, until the torque that holds it exceeds the largest one; spinning, ω₃, has a mode of rest of its own.
  In flight the ground resists nothing, and impacts have no impulse of dry resistance.
- **Joints that dry friction or hard stops may hold.** One with friction slips until θ̇ falls to zero, and sticks until
  the friction that holds it reaches its static level. One that comes to a hard stop strikes it (``stops``), and rests
  against it until an effort takes it off. In an impact no joint is held: friction is finite, and gives no impulse.

Without a law of contact a body does not slip, and its equations are those of rolling (``equations``); with one they are
those of the released body (``released``).

The ground is a plane or a surface. What differs is in few places: the contact axes, in which slip and reaction have
their components (``released``), and how the height in flight follows from the place of the body (``over_surface``).
"""

import dataclasses
from collections.abc import Iterator
from typing import Any, ClassVar, NamedTuple, TypeGuard

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ...numerics.arrays import AnyArray
from ...numerics.directions import unit
from ...numerics.vectors import add, apply, convert, in_three, root
from ..body import AbstractBody
from ..conditions import Condition, ExplainedCondition, Problem
from ..dynamics.coupling import Joints
from ..dynamics.dry_friction import Turning, TurningLaw, TurningMode
from ..dynamics.equations import holding_friction, turning
from ..dynamics.footing import ContactAxes, footing_of_released, rate_of_carrier
from ..dynamics.load import Load
from ..dynamics.locked import reaction
from ..dynamics.sticking import with_directions
from ..forces.resistance import AbstractResistance, Levels
from ..grounds import AbstractSurface, Footing
from ..hybrid import Accuracy, Assessment, GuardedStep, Transition
from ..rolling import Reaction
from ..state import ReducedState
from ..system import AbstractSystem
from . import friction, over_surface as over
from .guards import Headings, assess, guards, guards_follow_motion, headings, headings_at_rest
from .history import HeldHistory, history_of
from .law import Contact
from .modes import ContactState, Mode
from .released import ReleasedState, Response, Turned, rates, response, rolling_contact, slip_velocity
from .slide import coefficient_and_direction, slide, slide_of
from .transition import start, transition

ROUNDING = 8  # in units of rounding: velocities and accelerations that are smaller count as zero


def has_contact(system: Any) -> TypeGuard["BodyOnPlane"]:
    """Returns whether a system is a body with a law of contact."""
    return isinstance(system, BodyOnPlane) and system.contact is not None


class Forces(NamedTuple):
    """What acts at a contact: its ``response`` and what comes with it, and the friction in joints that stick.

    ``response`` is None without a law of contact, ``acting`` without that and without exact dry resistance, and
    ``holding`` without joints that stick.
    """

    response: Response | None
    acting: Any
    holding: Any


class BodyOnPlane(AbstractSystem[ContactState]):
    """A ball or a disk whose motion has modes, on a plane or a surface: with a law of contact, exact dry resistance,
    joints that dry friction may hold, or any of these. What no mode changes is that of its ``body``.

    Without a law of contact it rolls without slipping, whatever friction that needs.
    """

    body: AbstractBody
    contact: Contact | None

    title: ClassVar[str] = "body with a law of contact or dry friction"
    state_type: ClassVar[Any] = ContactState

    def require_state(self, state: Any) -> None:
        if isinstance(state, ReducedState) and self.contact is not None:
            raise TypeError(
                "Argument `state` must be a BallState, a RotationState, a DiskState or a ReleasedState with `contact`, "
                "because a body that may slip has a velocity and a position, but it is a ReducedState."
            )
        if isinstance(state, ReducedState) and self.body.is_held:
            raise TypeError(
                "Argument `state` must be a BallState or a RotationState where resistance is `exact`, because what "
                "comes to rest has a place and a direction in space, but it is a ReducedState."
            )
        type(self.body).require_state(self.body, state.body if isinstance(state, ReleasedState) else state)

    def conditions(self) -> Iterator[Condition]:
        yield from self.body.conditions()
        if self.contact is not None:
            yield from self.contact.conditions()

    def start_conditions(self, t: Float[Array, ""], state: ContactState) -> Iterator[Condition | ExplainedCondition]:
        yield from self.body.start_conditions(t, state.body)
        if self.body.planar and state.V is not None:
            holds = state.V[1] == 0
            yield Condition(holds, "state.V", state.V, "in the plane of the disk, with 0 for its second entry")

    def run_conditions(self, times: Float[AnyArray, " T"]) -> Iterator[Condition | ExplainedCondition]:
        yield from self.body.run_conditions(times)

    def numbers(self) -> Iterator[tuple[str, Array]]:
        yield from self.body.numbers()

    def driving_kinks(self) -> Float[Array, " kinks"]:
        """Returns all kinks: accelerations, on which the modes depend, jump where prescribed motions have jumps."""
        return jnp.concatenate([self.body.driving_kinks(), self.body.motion_kinks()])

    def is_confined(self, times: Float[Array, " T"], state: Any) -> Bool[Array, ""]:
        return self.body.is_confined(times, state.body)

    def time_of_leaving(self, times: Float[Array, " T"], states: Any) -> Float[Array, ""] | None:
        return self.body.time_of_leaving(times, states.body)

    def clearance(self, t: Float[Array, ""], state: Any) -> Float[Array, ""] | None:
        return self.body.clearance(t, state.body)

    def breaches(self, times: Any, state: Any, states: Any) -> Iterator[Problem]:
        bodies = (None if of_modes is None else of_modes.body for of_modes in (state, states))
        yield from self.body.breaches(times, *bodies)

    @property
    def shown(self) -> AbstractBody:
        return self.body

    def state_to_show(self, state: Any) -> Any:
        return state.body

    def prepare(self) -> "BodyOnPlane":
        return BodyOnPlane(self.body.prepare(), self.contact)

    # What a solve advances. A body is evaluated with a versor of length 1: near the end of a slip small errors turn it
    # far, and where a mode ends, the forces in it and in the next one must be those of the same attitude.

    def to_packed(self, t: Float[Array, ""], state: ContactState) -> ContactState:
        packed = state
        if self.advances_omega(state):
            omega = self.unless_held(state, self.over_ground(t, state))
            packed = dataclasses.replace(packed, body=packed.body.with_Omega(omega))
        if self.contact is None:
            return packed
        slip = slip_velocity(self.body, t, state.released)
        # A slip that is rounding has no direction worth following, and where the body rolls it must stay exactly zero.
        stopped = self.slips_end & self.is_still(slide_of(self, slip, t, state), state)
        slip = slip.at[:2].set(jnp.where(stopped, slip[:2] - jax.lax.stop_gradient(slip[:2]), slip[:2]))
        slip = jnp.where(state.is_in(Mode.ROLLING), 0.0, slip)
        packed = dataclasses.replace(packed, V=jnp.where(state.is_in(Mode.FLIGHT), state.V, slip))
        return over.with_place(self.body, t, state, packed)

    def from_packed(self, t: Float[Array, ""], packed: ContactState) -> ContactState:
        packed = packed.projected()
        if self.advances_omega(packed):
            Omega = self.contact_axes(t, packed).in_body(packed.body.Omega)
            packed = dataclasses.replace(packed, body=packed.body.with_Omega(Omega))
        if self.contact is None:
            return packed
        packed = over.with_nearest_piece(self.body, t, packed)
        rolling, under = rolling_contact(self.body, t, packed.body)
        V = under.to_space(packed.V) + rolling
        return dataclasses.replace(packed, V=jnp.where(packed.is_in(Mode.FLIGHT), packed.V, V))

    def field_of_packed(self, t: Float[Array, ""], packed: ContactState) -> ContactState:
        state = self.from_packed(t, packed)
        moved = self.field(t, state) if self.contact is None else self._field_of_slip(t, state)
        if not self.advances_omega(state):
            return moved
        rate = self.unless_held(packed, self.rate_over_ground(t, state, moved.body.Omega))
        return dataclasses.replace(moved, body=moved.body.with_Omega(rate))

    def _field_of_slip(self, t: Float[Array, ""], state: ContactState) -> ContactState:
        """Computes the rates with that of the slip velocity in place of V̇, which is zero where the body rolls."""
        response, rolls = self.response(t, state), state.is_in(Mode.ROLLING)
        acting = self.interaction(t, state, response)
        body, moved = state.body, self._move(t, state, response, acting)
        speeds = jnp.concatenate([body.Omega, body.thetadot])
        gains = jnp.concatenate([moved.body.Omega, moved.body.thetadot])
        g, r = self.body.gravity, self.body.radius
        # The gains are angular accelerations, and linear ones of sliding joints: the smaller of both scales decides.
        least = ROUNDING * float(jnp.finfo(g.dtype).eps) * jnp.minimum(g, g / r)
        stays = jnp.all(speeds == 0) & jnp.all(moved.body.z == 0)
        rests = rolls & stays & jnp.all(jnp.abs(gains) <= least)
        # Rounding must not set in motion a body that friction holds; its derivatives are unchanged.
        moved = jax.tree.map(lambda x: x - jnp.where(rests, jax.lax.stop_gradient(x), 0.0), moved)
        # The rate of the slip velocity, without the rounding of a difference.
        slipping = jnp.where(rolls, 0.0, acting.slip_acceleration)
        V = jnp.where(state.is_in(Mode.FLIGHT), moved.V, slipping)
        return over.with_rates_of_place(self.body, state, dataclasses.replace(moved, V=V))

    def field(self, t: Float[Array, ""], state: ContactState) -> ContactState:
        if self.contact is None:
            return jax.tree.map(jnp.zeros_like, state).move(self.rates_of_rolling(t, state, self.mode(t, state)))
        response = self.response(t, state)
        return self._move(t, state, response, self.interaction(t, state, response))

    def _move(
        self, t: Float[Array, ""], state: ContactState, response: Response, acting: friction.Interaction
    ) -> ContactState:
        """Computes ẋ, where the response and the reaction are known."""
        sliding = jnp.where(state.is_in(Mode.ROLLING), 0.0, slide(self, t, state))
        moved = rates(self.body, state.released, response, acting.amounts)
        rates_of_all = jax.tree.map(jnp.zeros_like, state).move(moved)
        return dataclasses.replace(rates_of_all, friction_loss=-jnp.sum(acting.grip[:-1] * sliding))

    def projected(self, t: Float[Array, ""], packed: ContactState) -> ContactState:
        packed = packed.projected()
        return over.with_piece_remembered(self.body, t, packed) if self.always_projected else packed

    @property
    def always_projected(self) -> bool:
        """Whether each step ends with the nearest piece of a surface, from which the next ones are sought."""
        ground = self.body.ground
        return isinstance(ground, AbstractSurface) and ground.follows_foot

    @property
    def law(self) -> Contact:
        """The law of contact."""
        assert self.contact is not None
        return self.contact

    @property
    def pivot(self) -> Float[Array, ""] | None:
        """The radius ρ of a limit surface; None without one, and for a disk, which does not spin."""
        return None if self.contact is None or self.body.planar else self.contact.limit_radius

    def advances_omega(self, state: ContactState) -> bool:
        """Returns whether a solve advances ω over the ground, parts of which friction may hold at 0, instead of Ω."""
        return state.rolls is not None or self.pivot is not None

    # How it turns, and rolls where nothing slips.

    @property
    def resistance(self) -> AbstractResistance:
        """The exact resistance."""
        assert self.body.resistance is not None
        return self.body.resistance

    @property
    def static_levels(self) -> Levels:
        """The largest levels that hold the body."""
        return Levels.at_rest(self.resistance)

    @property
    def resists_rolling(self) -> bool:
        return self.body.is_held and self.static_levels.rolling is not None

    @property
    def resists_spinning(self) -> bool:
        return self.static_levels.spinning is not None and not self.body.planar

    @property
    def turns_aside(self) -> bool:
        """Whether its direction of rolling may turn, so that it is followed to its rest: that of a ball."""
        return self.resists_rolling and not self.body.planar

    def is_held_still(self, state: Any) -> Bool[Array, ""]:
        """Returns whether friction holds the body against spinning."""
        return (state.spin == 0) & self.resists_spinning

    def unless_held(self, state: Any, omega: Float[Array, "3"]) -> Float[Array, "3"]:
        """Returns ω over the ground, or its rate, with 0 for what friction holds."""
        if self.pivot is not None:
            omega = omega.at[2].set(jnp.where(state.is_in(Mode.ROLLING), 0.0, omega[2]))
        if state.rolls is None:
            return omega
        rests = state.rolls == 0
        return jnp.where(jnp.stack([rests, rests, self.is_held_still(state)]), 0.0, omega)

    def mode(self, t: Float[Array, ""], state: Any, sigma: Float[Array, "2"] | None = None) -> Any:
        """Returns the mode of turning of a body that rolls in the direction ``sigma``, if that is known; None without
        exact dry resistance.
        """
        if state.rolls is None:
            return None
        omega = self.over_ground(t, state)
        direction = self.direction(t, state, omega) if sigma is None else sigma
        rests = state.rolls == 0
        sigma3 = jnp.where(rests, 0.0, in_three(direction))
        spin = state.spin if self.resists_spinning else jnp.zeros_like(state.spin)
        # Not |ω|, so that levels are smooth also where a step goes on beyond the end of a motion.
        levels = Levels.at(self.resistance, jnp.sum(sigma3 * omega), spin * omega[2])
        return TurningMode(sigma3, spin, rests, self.is_held_still(state), jnp.zeros_like(sigma3), levels)

    def direction(self, t: Float[Array, ""], state: Any, omega: Float[Array, "3"] | None = None) -> Float[Array, "2"]:
        """Computes the direction of ω_h of a body that rolls, contact axes; ``omega`` is ω over it, if known."""
        if self.body.planar:
            return state.rolling.sigma
        omega = self.over_ground(t, state) if omega is None else omega
        return jnp.where(t <= state.rolling.until, state.rolling.direction(t), unit(omega[:2]))

    def over_ground(self, t: Float[Array, ""], state: Any) -> Float[Array, "3"]:
        """Computes ω of the body relative to the ground, along the axes of the contact."""
        return self.contact_axes(t, state).over_ground(state.body.Omega)

    def contact_axes(self, t: Float[Array, ""], state: Any) -> ContactAxes:
        """Returns the axes of the contact at a state, packed or not; in flight the axes of space, which are at rest."""
        body = state.body
        if self.contact is None or not over.has_surface(self.body):
            return ContactAxes.of(self.body, t, body)
        flies = state.is_in(Mode.FLIGHT)
        # In flight, the place of a packed state has no coordinates.
        u = jnp.where(flies, jnp.reshape(state.near, body.z.shape), body.z)
        touching = ContactAxes.of(self.body, t, eqx.tree_at(lambda x: x.z, body, u))
        assert touching.spin is not None
        return ContactAxes(jnp.where(flies, body.Lambda, touching.rows), jnp.where(flies, 0.0, touching.spin))

    def rate_over_ground(self, t: Float[Array, ""], state: Any, Omegadot: Float[Array, "3"]) -> Float[Array, "3"]:
        """Computes the rate of ω relative to the ground, in contact axes, from Ω̇."""
        rate = apply(self.contact_axes(t, state).rows, Omegadot)
        return add(rate, self._compute_carried_rate(t, state))

    def _compute_carried_rate(
        self, t: Float[Array, ""], state: Any, under: Footing | None = None
    ) -> Float[Array, "3"] | None:
        """Computes that rate while ω is constant, contact axes; None where the ground does not turn. ``under`` is the
        footing, if known.
        """
        touching = ~state.is_in(Mode.FLIGHT)
        if under is None and self.contact is not None:
            under = footing_of_released(self.body, t, state.body, state.V, state.height, touching)
        carried = rate_of_carrier(self.body, t, state.body, under)
        return convert(lambda rate: jnp.where(touching, apply(self.contact_axes(t, state).rows, rate), 0.0), carried)

    def turning(self, t: Float[Array, ""], state: Any) -> Turning:
        """Computes how a body that does not slip turns without dry friction, and how torques change that."""
        return turning(self.moving(state), t, state.body)

    def rates_of_rolling(self, t: Float[Array, ""], state: Any, mode: TurningMode | None) -> Any:
        """Computes ẋ of a body that does not slip, in a mode of turning."""
        return field_in_mode(self.moving(state), t, state.body, mode)

    def holding_in_rolling(
        self, t: Float[Array, ""], state: Any, mode: TurningMode | None
    ) -> Float[Array, " sticking"]:
        """Computes the friction in joints that stick, of a body that does not slip, in a mode of turning."""
        return holding_friction(self.moving(state), t, state.body, mode=mode)

    def forces(self, t: Float[Array, ""], state: ContactState) -> Forces:
        """Computes what acts in the modes of a state."""
        if self.contact is not None:
            response = self.response(t, state)
            acting = self.interaction(t, state, response)
            return Forces(response, acting, None if state.slips is None else response.part("holding", acting.amounts))
        mode, acting = self.mode(t, state), None
        if mode is not None:
            acting = friction.resist_rolling(self.turning(t, state), mode)
        return Forces(None, acting, None if state.slips is None else self.holding_in_rolling(t, state, mode))

    # The contact.

    def response(
        self, t: Float[Array, ""], state: Any, mode: TurningMode | None = None, efforts: Joints | None = None
    ) -> Response:
        """Computes how the body moves under each reaction, and ``efforts`` on joints; ``mode`` is that of the state."""
        touching, pivots = ~state.is_in(Mode.FLIGHT), self.pivot is not None
        moved = response(self.moving(state), t, state.released, touching, efforts, pivots=pivots)
        if not self.advances_omega(state):
            return moved
        carried, law = self._compute_carried_rate(t, state, moved.footing), TurningLaw.none(state.V)
        if state.rolls is not None:
            law = self.law_of_turning(state, self.mode(t, state) if mode is None else mode)
        return moved._replace(turned=Turned(self.contact_axes(t, state).rows, carried, law, self.pivot))

    def law_of_turning(self, state: Any, mode: TurningMode) -> TurningLaw:
        """Returns what exact dry resistance gives in a mode of turning."""
        law = TurningLaw.of(self.body.height_of_centre(state.body.Gamma), mode)
        # A disk is held upright by other forces than friction.
        return law._replace(solved=law.solved.at[0].set(False)) if self.body.planar else law

    def moving(self, state: ContactState) -> AbstractBody:
        """Returns the body in the modes of its joints."""
        return self.body if state.slips is None else with_directions(self.body, state.slips)

    def on_ground(self, state: ContactState) -> ContactState:
        """Returns the state of a body that touches the ground: one that lands still has the mode of flight."""
        # Any mode on the ground says that it touches.
        mode = None if state.mode is None else jnp.full_like(state.mode, int(Mode.SLIDING))
        return dataclasses.replace(state, mode=mode)

    def response_on_ground(self, t: Float[Array, ""], state: ContactState) -> Response:
        """Computes the response of a body that touches the ground."""
        return self.response(t, self.on_ground(state))

    def coefficient(self, slip: Float[Array, " n"], share: float = 1.0) -> Float[Array, ""]:
        """Returns the kinetic friction coefficient at a share of the speed of a slip."""
        return self.law.coefficient(share * root(jnp.sum(slip[:2] ** 2)))

    @property
    def slips_end(self) -> Bool[Array, ""]:
        """Whether a slip ends in a finite time: not on a smooth plane, nor by friction that fades with the slip."""
        return self.law.friction > 0

    def interaction(self, t: Float[Array, ""], state: ContactState, response: Response) -> friction.Interaction:
        """Computes the reaction of the plane in the mode that the state is in."""
        contact = friction.SolvedContact.of(response, state.is_in(Mode.SLIDING), state.is_in(Mode.FLIGHT))
        return contact.interaction(*coefficient_and_direction(self, t, state, slide(self, t, state)))

    def plane_reaction(self, t: Float[Array, ""], state: Any) -> Reaction:
        if self.contact is None:
            return reaction(self.moving(state), t, state.body, self.mode(t, state))
        R = self.interaction(t, state, self.response(t, state)).R
        return Reaction(R[2], jnp.sum(R[:2] ** 2))

    def dry_torque(
        self, t: Float[Array, ""], state: ContactState, interaction: friction.Interaction, acting: Load
    ) -> Float[Array, "3"] | None:
        """Computes the torque of dry friction against rolling and spinning, body axes; None without."""
        if self.advances_omega(state):
            return apply(self.contact_axes(t, state).rows.T, interaction.torque)
        if self.body.resistance is None:
            return None
        height = self.body.height_of_centre(acting.Gamma)
        unit = self.body.resistance.dry_torque(height, acting.resisted, acting.Gamma)
        return None if unit is None else interaction.normal * unit

    def step_reference(self, t: Float[Array, ""], state: ContactState, accuracy: Accuracy) -> Headings:
        return headings(self, t, state, accuracy)

    def guards(self, t: Float[Array, ""], state: ContactState) -> Float[Array, " guards"]:
        """Computes the guards without a solve: slip and rolling end where their velocities vanish."""
        return guards(self, t, state, headings_at_rest(self, t, state))

    def guards_in_step(self, t: Float[Array, ""], state: ContactState, reference: Any) -> Float[Array, " guards"]:
        return guards(self, t, state, reference)

    def guards_follow_motion(self, t: Float[Array, ""], packed: ContactState, reference: Any) -> bool:
        return self.contact is not None and guards_follow_motion(self, t, packed, reference)

    def kept_in_modes(self, packed: ContactState) -> tuple[Any, ...]:
        of_contact = packed.impact_loss, packed.mode, packed.begun, packed.near
        return *of_contact, packed.rolls, packed.spin, packed.rolling, packed.slips, packed.stop_loss

    def time_event(self, t: Float[Array, ""], state: ContactState) -> Float[Array, ""]:
        """Returns the next end of a window of slip or rolling in a known direction, or of a step in flight."""
        until = jnp.full_like(t, jnp.inf)
        if state.begun is not None:
            until = jnp.where(state.is_in(Mode.SLIDING), state.begun.until, jnp.inf)
            until = jnp.minimum(until, t + over.longest_flight(self.body, t, state))
        if self.body.planar or state.rolling is None:
            return until
        ends = (state.rolls != 0) & (state.rolling.until > t)
        rolling = jnp.where(ends, state.rolling.until, jnp.inf)
        return jnp.minimum(jnp.where(until > t, until, jnp.inf), rolling)

    def assess(self, step: GuardedStep, accuracy: Accuracy) -> Assessment:
        return assess(self, step, accuracy)

    def is_still(self, slide: Float[Array, " n"], state: ContactState | ReleasedState) -> Bool[Array, ""]:
        """Returns whether the slide is zero up to rounding."""
        return root(jnp.sum(slide**2)) <= self.rounding_of_velocity(state)

    def rounding_of_velocity(self, state: ReleasedState | ContactState) -> Float[Array, ""]:
        """Computes the velocity below which one counts as zero."""
        return ROUNDING * float(jnp.finfo(state.V.dtype).eps) * self.speed_of(state)

    def speed_of(self, state: ReleasedState | ContactState) -> Float[Array, ""]:
        """Computes a reference speed for errors of velocities."""
        return root(jnp.sum(state.V**2)) + self.body.radius * root(jnp.sum(state.body.Omega**2))

    def start(self, t: Float[Array, ""], state: Any) -> ContactState:
        return start(self, t, state)

    def transition(
        self, t: Float[Array, ""], state: ContactState, event: Int[Array, ""], accuracy: Accuracy
    ) -> Transition:
        return transition(self, t, state, event, accuracy)

    @property
    def max_switches(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        return AbstractSystem.max_switches if self.contact is None else self.law.capacity

    def history(self, times: Float[Array, " T"], states: ContactState, record: Any) -> HeldHistory:
        return history_of(self.prepare(), times, states, record)


@jax.jit
def field_in_mode(body: AbstractBody, t: Float[Array, ""], state: Any, mode: TurningMode | None) -> Any:
    """Computes ẋ of a body in a mode of turning, if it has one."""
    return body.field(t, state, mode)
