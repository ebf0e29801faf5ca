"""A body on its ground that rolls, slides or flies, as one hybrid system with a mode for each.

``simulate`` solves it in place of a body that is given a law of contact.

Within a mode, the motion follows a smooth field, and guard functions are positive. Where one of them falls to zero, the
mode ends, and the next one is decided there:

- rolling ends where it would need more friction than μ_s N, or where the normal force falls to zero;
- sliding ends where the slip velocity vanishes, or where the normal force falls to zero;
- flight ends where the body lands, with an impact.

On the ground, a body that does not slip rolls if friction can hold it, and otherwise begins to slip as
``friction.first_slip`` determines.

The ground is a plane or a surface. What differs is in few places: the contact axes, in which slip and reaction have
their components (``released``), and how the height in flight follows from the place of the body (``over_surface``).
"""

import dataclasses
from collections.abc import Iterator
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...interface.printing import format_value, is_single
from ...numerics.vectors import root
from ..body import AbstractBody, AbstractBodyWithModes
from ..conditions import Condition, ExplainedCondition
from ..dynamics.load import Load
from ..forces.resistance import TurningMode
from ..grounds import AbstractSurface
from ..hybrid import NONE, STIFF, WINDOW, AbstractHistory, Accuracy, Assessment, GuardedStep, Transition
from ..rolling import Reaction
from ..state import PlacedState, ReducedState
from . import friction, over_surface as over, slip as slips
from .law import Contact
from .modes import CAUSES, ContactState, ContactSwitches, Mode, SwitchCause, cause_of
from .released import (
    ReleasedState,
    Response,
    in_space,
    rates,
    release,
    response,
    rolling_contact,
    slip_velocity,
)
from .transition import Progress, begin_slip, decide, response_on_plane, strike, transition
from .window import Beginning

ROUNDING_OF_VELOCITY = 8  # in units of rounding: velocities and accelerations that are smaller count as zero
FORCES = 32  # in units of rounding of the forces whose sum a reaction is: one that is smaller counts as zero
RISEN = 1e-6  # of √(r/g): a body that rises counts as being as high as after this time, at least
SLOW_DISK = 0.55  # as slip.SLOW, for a disk: its slip does not turn, but must exceed the error of a mode's end
NOWHERE = -1  # the mode at times to which a solve did not come
NOTHING = 1e-9  # a normal force below this part of its size in a step counts as zero


class BodyOnPlane(AbstractBodyWithModes[ContactState]):
    """A ball or a disk with a law of contact, on a plane or a surface."""

    body: AbstractBody
    contact: Contact

    title: ClassVar[str] = "body with a law of contact"
    state_type: ClassVar[Any] = ContactState

    def require_state(self, state: Any) -> None:
        if isinstance(state, ReducedState):
            raise TypeError(
                "Argument `state` must be a BallState, a RotationState, a DiskState or a ReleasedState with `contact`, "
                "because a body that may slip has a velocity and a position, but it is a ReducedState."
            )
        type(self.body).require_state(self.body, state.body if isinstance(state, ReleasedState) else state)

    def conditions(self) -> Iterator[Condition]:
        yield from self.body.conditions()
        yield from self.contact.conditions()

    def start_conditions(self, t: Float[Array, ""], state: ContactState) -> Iterator[Condition | ExplainedCondition]:
        yield from self.body.start_conditions(t, state.body)
        if self.body.planar:
            holds = state.V[1] == 0
            yield Condition(holds, "state.V", state.V, "in the plane of the disk, with 0 for its second entry")

    def prepare(self) -> Any:
        return type(self)(self.body.prepare(), self.contact)

    # What a solve advances. A body is evaluated with a versor of length 1: near the end of a slip small errors turn it
    # far, and where a mode ends, the forces in it and in the next one must be those of the same attitude.

    def to_packed(self, t: Float[Array, ""], state: ContactState) -> ContactState:
        slip = slip_velocity(self.body, t, state.released)
        # A slip that is rounding has no direction worth following, and where the body rolls it must stay exactly zero.
        stopped = self.slips_end & self.is_still(slip, state)
        slip = slip.at[:2].set(jnp.where(stopped, 0.0, slip[:2]))
        slip = jnp.where(state.is_in(Mode.ROLLING), 0.0, slip)
        packed = eqx.tree_at(lambda x: x.V, state, jnp.where(state.is_in(Mode.FLIGHT), state.V, slip))
        return over.with_place(self.body, t, state, packed)

    def from_packed(self, t: Float[Array, ""], packed: ContactState) -> ContactState:
        packed = over.with_nearest_piece(self.body, t, packed.projected())
        rolling, axes = rolling_contact(self.body, t, packed.body)
        V = in_space(axes, packed.V) + rolling
        return eqx.tree_at(lambda x: x.V, packed, jnp.where(packed.is_in(Mode.FLIGHT), packed.V, V))

    def field_of_packed(self, t: Float[Array, ""], packed: ContactState) -> ContactState:
        state = self.from_packed(t, packed)
        response, rolls = self.response(t, state), state.is_in(Mode.ROLLING)
        acting = self.interaction(t, state, response)
        body, moved = state.body, self._move(t, state, response, acting)
        speeds = jnp.concatenate([body.Omega, body.thetadot])
        gains = jnp.concatenate([moved.body.Omega, moved.body.thetadot])
        g, r = self.body.gravity, self.body.radius
        # The gains are angular accelerations, and linear ones of sliding joints: the smaller of both scales decides.
        least = ROUNDING_OF_VELOCITY * float(jnp.finfo(g.dtype).eps) * jnp.minimum(g, g / r)
        stays = jnp.all(speeds == 0) & jnp.all(moved.body.z == 0)
        rests = rolls & stays & jnp.all(jnp.abs(gains) <= least)
        # Rounding must not set in motion a body that friction holds; its derivatives are unchanged.
        moved = jax.tree.map(lambda x: x - jnp.where(rests, jax.lax.stop_gradient(x), 0.0), moved)
        # The rate of the slip velocity, without the rounding of a difference.
        slipping = jnp.where(rolls, 0.0, acting.slip_acceleration)
        V = jnp.where(packed.is_in(Mode.FLIGHT), moved.V, slipping)
        return over.with_rates_of_place(self.body, state, eqx.tree_at(lambda x: x.V, moved, V))

    def field(self, t: Float[Array, ""], state: ContactState) -> ContactState:
        response = self.response(t, state)
        return self._move(t, state, response, self.interaction(t, state, response))

    def _move(
        self, t: Float[Array, ""], state: ContactState, response: Response, acting: friction.Interaction
    ) -> ContactState:
        """Computes ẋ, where the response and the reaction are known."""
        slip = jnp.where(state.is_in(Mode.ROLLING), 0.0, slip_velocity(self.body, t, state.released))
        moved = rates(self.body, state.released, response, acting.amounts)
        rates_of_all = jax.tree.map(jnp.zeros_like, state).move(moved)
        return eqx.tree_at(lambda x: x.friction_loss, rates_of_all, -jnp.sum(acting.R[:2] * slip[:2]))

    def projected(self, t: Float[Array, ""], packed: ContactState) -> ContactState:
        packed = packed.projected()
        return over.with_piece_remembered(self.body, t, packed) if self.always_projected else packed

    @property
    def always_projected(self) -> bool:
        """Whether each step ends with the nearest piece of a surface, from which the next ones are sought."""
        ground = self.body.ground
        return isinstance(ground, AbstractSurface) and ground.follows_foot

    # The contact.

    def response(self, t: Float[Array, ""], state: ContactState) -> Response:
        """Computes how the body moves under each reaction."""
        return response(self.moving(state), t, state.released, touching=~state.is_in(Mode.FLIGHT))

    def response_to_impulse(self, t: Float[Array, ""], state: ContactState) -> Response:
        """Computes how the body moves under each impulse of the ground, by the rates of its response."""
        return response_on_plane(self, t, state)

    def coefficient(self, slip: Float[Array, "3"], share: float = 1.0) -> Float[Array, ""]:
        """Returns the kinetic friction coefficient at a share of the speed of a slip."""
        return self.contact.coefficient(share * root(jnp.sum(slip[:2] ** 2)))

    def coefficient_and_direction(
        self, t: Float[Array, ""], state: ContactState, slip: Float[Array, "3"]
    ) -> tuple[Float[Array, ""], Float[Array, "2"]]:
        """Returns μ and σ; where friction has faded with the slip, μ′(0) and v_s, for the derivative of their
        product.
        """
        mu, sigma = self.coefficient(slip), state.direction(t, slip)
        if self.contact.friction_law is None:
            return mu, sigma
        # Without slip σ is not defined, and μ = 0. Friction is −N μ(v) v_s/v, which near v = 0 is −N μ′(0) v_s: a
        # product of two factors that has the right value, 0, and the right derivative.
        has_faded = ~self.slips_end & (jnp.sum(slip[:2] ** 2) == 0)
        slope = jax.jvp(self.contact.coefficient, (jnp.zeros_like(mu),), (jnp.ones_like(mu),))[1]
        return jnp.where(has_faded, slope, mu), jnp.where(has_faded, slip[:2], sigma)

    @property
    def slips_end(self) -> Bool[Array, ""]:
        """Whether a slip ends in a finite time: not on a smooth plane, nor by friction that fades with the slip."""
        return self.contact.friction > 0

    def interaction(self, t: Float[Array, ""], state: ContactState, response: Response) -> friction.Interaction:
        """Computes the reaction of the plane in the mode that the state is in."""
        slip = slip_velocity(self.body, t, state.released)
        contact = friction.SolvedContact.of(response, state.is_in(Mode.SLIDING), state.is_in(Mode.FLIGHT))
        return contact.interaction(*self.coefficient_and_direction(t, state, slip))

    def plane_reaction(self, t: Float[Array, ""], state: Any) -> Reaction:
        """Computes the normal force and the friction, in the mode that the state is in."""
        R = self.interaction(t, state, self.response(t, state)).R
        return Reaction(R[2], jnp.sum(R[:2] ** 2))

    def dry_torque(
        self, t: Float[Array, ""], state: ContactState, interaction: friction.Interaction, acting: Load
    ) -> Float[Array, "3"] | None:
        """Computes the torque of dry friction against rolling and spinning, body axes; None without."""
        if self.body.resistance is None:
            return None
        height = self.body.height_of_centre(acting.Gamma)
        unit = self.body.resistance.dry_torque(height, acting.resisted, acting.Gamma)
        return None if unit is None else interaction.normal * unit

    def step_reference(self, t: Float[Array, ""], state: ContactState, accuracy: Accuracy) -> slips.Heading:
        """Returns the heading of a slip as a step begins."""
        slip = slip_velocity(self.body, t, state.released)
        sigma = state.direction(t, slip)
        size = self.speed_of(state.released)
        power = SLOW_DISK if self.body.planar else slips.SLOW
        return slips.Heading.of(sigma, slip[:2], size, accuracy.atol + accuracy.rtol * size, power)

    def guards(self, t: Float[Array, ""], state: ContactState) -> Float[Array, "3"]:
        """Computes the guards without a solve, in which a slip ends where its velocity vanishes."""
        sigma, zero = state.direction(t, slip_velocity(self.body, t, state.released)), jnp.zeros_like(state.height)
        return self.guards_in_step(t, state, slips.Heading(sigma, zero, zero))

    def guards_in_step(self, t: Float[Array, ""], state: ContactState, reference: Any) -> Float[Array, " guards"]:
        """Computes the guards, for ``CAUSES``. A slip lasts while it goes along its heading."""
        response = self.response(t, state)
        return self.guards_where(t, state, reference, response, self.interaction(t, state, response))

    def guards_where(
        self,
        t: Float[Array, ""],
        state: ContactState,
        reference: Any,
        response: Response,
        acting: friction.Interaction,
    ) -> Float[Array, " guards"]:
        """Computes the guards where the response and the reaction are known."""
        slack = self.rounding_of_force(state, response)
        slip, unit = slip_velocity(self.body, t, state.released), jnp.ones_like(state.height)
        spare = friction.margin(acting.R, self.contact.static_friction) + slack
        # A slip on a smooth ground, or against friction that fades, never ends: its guard must not fall.
        forward = jnp.where(self.slips_end, jnp.sum(slip[:2] * reference.sigma) - reference.least, unit)
        # A body that rises does not land, where rounding takes its height below zero as it lifts.
        above = jnp.maximum(
            state.height + over.rounding_of_height(self.body, t, state),
            jnp.where(slip[2] > 0, RISEN * slips.unit_of_time(self.body) * slip[2], -jnp.inf),
        )
        above = over.clearance_for_landing(self.body, t, state, above)
        rolls, slides = state.is_in(Mode.ROLLING), state.is_in(Mode.SLIDING)
        return jnp.stack(
            [
                jnp.where(rolls, spare, jnp.where(slides, forward, above)),
                jnp.where(rolls | slides, acting.R[2] + slack, unit),
                jnp.where(slides, acting.solvability, unit),
            ]
        )

    def time_event(self, t: Float[Array, ""], state: ContactState) -> Float[Array, ""]:
        """Returns the end of the window in which the direction of a slip is known beforehand, or of a step in
        flight.
        """
        until = jnp.where(state.is_in(Mode.SLIDING), state.begun.until, jnp.inf)
        return jnp.minimum(until, t + over.longest_flight(self.body, t, state))

    def assess(self, step: GuardedStep, accuracy: Accuracy) -> Assessment:
        """Finds the cause that the guard which is zero stands for, or that a slip has ended although no guard is zero.

        Where friction gives way because the normal force vanishes, the body lifts off. The longest next step is
        infinite, except where a slip slows down.
        """
        state, least, guards = step.state, step.reference.least, step.guards
        slip = slip_velocity(self.body, step.end, state.released)
        errors = slips.ERRORS * (accuracy.atol + accuracy.rtol * self.speed_of(state.released))
        # A slip that does not continue along its heading may be at its end.
        slow = root(jnp.sum(slip[:2] ** 2)) <= 2 * least + errors
        # The friction that can be had vanishes with the normal force, so both guards fall together, in either order.
        cause = cause_of(state.mode, step.zero)
        weightless = guards[1, -1] <= NOTHING * step.largest[1]
        cause = jnp.where((cause == int(SwitchCause.GIVES_WAY)) & weightless, int(SwitchCause.LIFTS), cause)
        ends = (step.zero != NONE) & jnp.where(cause == int(SwitchCause.STOPS), slow, step.has_fallen)
        # The guard is the speed along the heading less ``least``, so these are the speeds at both ends of the step.
        before, after = guards[0, 0] + least, guards[0, -1] + least
        slides = state.is_in(Mode.SLIDING)
        slows_down = slides & self.slips_end
        stops = slows_down & slow & slips.nears_its_end(before, after, least)
        otherwise = jnp.where(step.timed & slides, WINDOW, jnp.where(stops, int(SwitchCause.STOPS), NONE))
        longest = slips.longest_step(before, after, least, step.end - step.start, accuracy)
        longest = jnp.where(slows_down & ~ends, longest, jnp.inf)
        return Assessment(jnp.where(ends, cause, otherwise), longest)

    def is_still(self, slip: Float[Array, "3"], state: ContactState | ReleasedState) -> Bool[Array, ""]:
        """Returns whether the slip velocity is zero up to rounding."""
        least = ROUNDING_OF_VELOCITY * float(jnp.finfo(slip.dtype).eps) * self.speed_of(state)
        return root(jnp.sum(slip[:2] ** 2)) <= least

    def rounding_of_force(self, state: ContactState | ReleasedState, response: Response) -> Float[Array, ""]:
        """Estimates the rounding of N and |f|, with which a body still rolls where friction just holds it.

        Nor does it leave a plane on which nothing presses it. It grows with the weight and with the rotation.
        """
        R, Omega = jax.lax.stop_gradient((response.rolling.reaction, state.body.Omega))
        # The mass that a normal acceleration of the contact has to move, (D⁻¹)₃₃.
        m = jax.lax.stop_gradient(response.yielding.reaction[2, 2])
        g, r = jax.lax.stop_gradient((jnp.abs(self.body.gravity), self.body.radius))
        scale, limits = root(jnp.sum(R**2)) + m * (g + r * jnp.sum(Omega**2)), jnp.finfo(R.dtype)
        # Positive also where nothing acts at all, so that a guard of 0 there is not an event.
        return FORCES * float(limits.eps) * scale + float(limits.tiny) ** 0.5

    def rise(self, t: Float[Array, ""], state: ContactState) -> Float[Array, ""]:
        """Computes the rate at which a body leaves its ground; 0 if it is rounding, but not for a ball on a plane."""
        rate = slip_velocity(self.body, t, state.released)[2]
        if not over.has_surface(self.body) and self.body.shape is None:
            return rate
        least = ROUNDING_OF_VELOCITY * float(jnp.finfo(rate.dtype).eps) * self.speed_of(state)
        return jnp.where(jnp.abs(rate) > least, rate, 0.0)

    def unit_of_speed(self, response: Response) -> Float[Array, ""]:
        """Computes √(g r); without gravity, the acceleration by which the body would fall takes the place of g."""
        g = jnp.abs(self.body.gravity)
        return root(jnp.where(g > 0, g, jnp.abs(response.free[2])) * self.body.radius)

    def speed_of(self, state: ReleasedState | ContactState) -> Float[Array, ""]:
        """Computes a reference speed for errors of velocities."""
        return root(jnp.sum(state.V**2)) + self.body.radius * root(jnp.sum(state.body.Omega**2))

    # How modes begin.

    def start(self, t: Float[Array, ""], state: ReleasedState | PlacedState) -> ContactState:
        """Returns the state with which a solve starts; its mode is decided by the first transition.

        A rolling state is one without slip. A body that does not slip counts as rolling.
        """
        rolls = not isinstance(state, ReleasedState)
        start_state = release(self.body.prepare(), t, state) if rolls else state
        zero = jnp.zeros_like(start_state.height)
        # In the mode of flight packing leaves V as it is, also for a body on the ground: in that of rolling it makes
        # the slip exactly zero.
        mode, begun = zero + int(Mode.ROLLING if rolls else Mode.FLIGHT), Beginning.none(zero)
        near = over.near_to(self.body, start_state.body.z, zero)
        return ContactState(start_state.body, start_state.V, start_state.height, zero, zero, mode, begun, near)

    def transition(
        self, t: Float[Array, ""], state: ContactState, event: Int[Array, ""], accuracy: Accuracy
    ) -> Transition:
        return transition(self, t, state, event, accuracy)

    # The parts of a transition.

    def guard_of(self, state: ContactState, event: Int[Array, ""]) -> Int[Array, ""]:
        """Returns the guard of an event, a :class:`SwitchCause` here; 0 where no guard has it."""
        return jnp.argmax(jnp.asarray(CAUSES)[state.mode.astype(int)] == event)

    def with_fixed_speeds(self, heading: Any) -> Any:
        """Returns the heading for which the guard of a slip that ends is exactly zero: the speed counts as fixed."""
        return heading._replace(least=heading.speed)

    def progress(self, t: Float[Array, ""], state: Any, event: Int[Array, ""]) -> Progress:
        """Begins a transition."""
        return Progress.of(self, t, state, event)

    def end_rolling(self, done: Progress, event: Int[Array, ""], tolerance: Float[Array, ""]) -> Progress:
        """Moves the state to the end of rolling, if it has one soon."""
        return done

    strike, decide, begin = strike, decide, begin_slip

    def all_held(self, done: Progress, event: Int[Array, ""]) -> tuple[Any, TurningMode | None, Bool[Array, " loads"]]:
        """Returns the state and the mode of turning where all is held that stands, and what the event has loosened."""
        return done.state, None, jnp.zeros(0, bool)

    def as_chosen(self, state: Any, choice: Any, t: Float[Array, ""]) -> Any:
        """Returns the state in the modes of a ``Choice``, besides that of the contact."""
        return state

    def cause_of_event(self, state: ContactState, event: Int[Array, ""]) -> Int[Array, ""]:
        """Returns the :class:`SwitchCause` of an event in a state."""
        return event

    def slows(self, event: Int[Array, ""]) -> Bool[Array, ""]:
        """Returns whether an event comes in ever shorter steps."""
        return event == int(SwitchCause.STOPS)

    # What a run shows.

    @property
    def max_switches(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        """How many switches are kept."""
        return self.contact.capacity

    def history(self, times: Float[Array, " T"], states: ContactState, record: Any) -> "ContactHistory":
        slip, sigma = self.prepare().slips(times, states)
        before, after = record.before, record.after
        switches = ContactSwitches.of(
            record,
            source=_whole(before.mode),
            target=_whole(after.mode),
            before=before.released,
            after=after.released,
            lost=after.impact_loss - before.impact_loss,
        )
        saved = {name: getattr(states, name) for name in ("V", "height", "friction_loss", "impact_loss")}
        mode = _whole(states.mode)
        return ContactHistory(law=self.contact, mode=mode, slip=slip, sigma=sigma, switches=switches, **saved)

    def slips(self, times: Float[Array, " T"], states: ContactState) -> tuple[Float[Array, "T 3"], Float[Array, "T 2"]]:
        """Computes the slip velocities, exactly 0 for a body that rolls, and their directions, 0 unless it slides;
        ``self`` is prepared.
        """

        def slip(t: Float[Array, ""], state: ContactState) -> tuple[Float[Array, "3"], Float[Array, "2"]]:
            velocity = jnp.where(state.is_in(Mode.ROLLING), 0.0, slip_velocity(self.body, t, state.released))
            return velocity, jnp.where(state.is_in(Mode.SLIDING), state.direction(t, velocity), 0.0)

        return jax.lax.map(lambda arguments: slip(*arguments), (times, states))


class ContactHistory(AbstractHistory):
    """The modes of a run with a law of contact, at its saved times.

    - ``switches``: the ``ContactSwitches``.
    - ``law``: the :class:`~jaxball.Contact`.
    - ``mode``: the :class:`~jaxball.Mode` at each time, shape (T,); −1 at times that the solve did not reach.
    - ``V``: the velocity of the geometric centre, space axes, length/time, shape (T, 3).
    - ``height``: of the body above the ground, length, shape (T,).
    - ``slip``: v_s, the velocity of the body's lowest point relative to the ground, length/time, shape (T, 3), in space
      axes; on a surface p along ∂p/∂u1, across, and along the normal.
    - ``sigma``: the direction of the slip, a unit vector, shape (T, 2), also where the slip begins; 0 before the first.
    - ``friction_loss``, ``impact_loss``: the energy dissipated so far by sliding friction and by impacts,
      mass length²/time², shape (T,) each.
    """

    described: ClassVar[str] = "a law of contact"
    changing: ClassVar[str] = "the mode of contact"

    switches: ContactSwitches
    law: Contact
    mode: Int[Array, "*batch T"]
    V: Float[Array, "*batch T 3"]
    height: Float[Array, "*batch T"]
    slip: Float[Array, "*batch T 3"]
    sigma: Float[Array, "*batch T 2"]
    friction_loss: Float[Array, "*batch T"]
    impact_loss: Float[Array, "*batch T"]

    def __repr__(self) -> str:
        single = is_single(self.switches.count)
        return "\n".join(["ContactHistory", *(f"  {line}" for line in self.lines)]) if single else format_value(self)

    @property
    def lines(self) -> list[str]:
        """How the body moved on its plane, and the energy that this dissipated. For one trajectory, not for a batch."""
        modes = np.asarray(self.mode)
        indices = np.flatnonzero(modes >= 0)
        if not indices.size:
            return []
        last = indices[-1]
        when = "is {} at the end" if last == modes.size - 1 else "was {} at the last saved time that was reached"
        changed = f"changed {self.switches.how_often}" if int(self.switches.count) else "never changed"
        friction_loss, impact_loss = (
            float(np.asarray(dissipation)[last]) for dissipation in (self.friction_loss, self.impact_loss)
        )
        dissipation = f"sliding friction dissipated the energy {friction_loss:.10g}, and impacts {impact_loss:.10g}"
        end = when.format(Mode(int(modes[last])).name.lower())
        return [f"{self.changing} {changed}, and {end}", *self.switches.first_lines, dissipation]

    @property
    def advice(self) -> str:
        modes = np.asarray(self.mode)
        reached = np.flatnonzero(modes >= 0)
        if not reached.size or modes[reached[-1]] != Mode.SLIDING:
            return ""
        slip = float(np.linalg.norm(np.asarray(self.slip)[reached[-1]]))
        return f"The body slides, at {slip:.3g} at the last saved time that was reached. A slow slip is stiff: {STIFF}"

    @property
    def over_time(self) -> dict[str, Array]:
        names = ("mode", "V", "height", "slip", "sigma", "friction_loss", "impact_loss")
        return {name: getattr(self, name) for name in names}

    @property
    def coefficients(self) -> dict[str, Array]:
        return {"friction": self.law.friction, "static_friction": self.law.static_friction}

    def at_rows(self, rows: slice) -> "ContactHistory":
        return dataclasses.replace(self, **{name: array[rows] for name, array in self.over_time.items()})

    def as_solved(self, system: AbstractBody, states: Any) -> tuple[BodyOnPlane, ContactState]:
        """Returns the body on its plane and its states, in which the body itself has the ``states``."""
        # A saved state has its σ beside it, also where the slip begins and v_s has none: it holds at any time.
        mode, ever = self.mode.astype(self.height.dtype), jnp.full_like(self.height, jnp.finfo(self.height.dtype).max)
        begun = Beginning.along(ever, self.sigma)
        near = over.near_to(system, states.z, self.height)
        return BodyOnPlane(system, self.law), ContactState(
            states, self.V, self.height, self.friction_loss, self.impact_loss, mode, begun, near
        )


def _whole(mode: Float[Array, "*rows"]) -> Int[Array, "*rows"]:
    return jnp.where(jnp.isfinite(mode), mode, NOWHERE).astype(int)
