"""A body that dry friction may hold at rest, and its joints, as one hybrid system with a mode for each.

``simulate`` solves it in place of a body with exact dry resistance, or with joints that stick, if no law of contact is
given.

- A body **rolls** until ω_h falls to zero. It then rests, with ω_h = 0 and ω̇_h = 0, if friction can hold it; if not,
  it rolls on in another direction. It rests until the torque that holds it exceeds the largest one.
- **Spinning**, ω₃, has a mode of rest of its own.
- A **joint** slips until its rate θ̇ falls to zero, and sticks, with θ̇ = 0 and θ̈ = 0, until the friction that holds it
  reaches its static level.

Each of these parts is there or not, which is known before anything is computed. All that friction may hold is held at
once by one linear system: joints that stick are held in its matrix, and the torque at the contact is what then keeps
ω_h and ω₃ as they are. As one thing stops or lets go, the loads of all others jump, and the most overloaded lets go
first.

The direction of rolling is ω_h/|ω_h|, which cannot be computed where a ball begins to roll or comes to rest:
``contact.slip`` says what is done there. A disk has two directions, which its state knows.
"""

import dataclasses
from collections.abc import Iterator
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ...interface.status import Status
from ...numerics.arrays import select_tree
from ...numerics.directions import unit
from ...programs.derivatives.differentiation import without_derivatives
from ..body import AbstractBody
from ..conditions import Condition
from ..contact import slip as slips, window as windows
from ..contact.slip import HALFWAY, Heading
from ..contact.turning import AbstractTurning
from ..contact.window import Beginning, Course
from ..dynamics.equations import holding_friction, turning
from ..dynamics.footing import ContactAxes, in_three, rate_over_ground
from ..dynamics.law import release
from ..dynamics.rest import Turning, along_growth, candidates, let_go, needs, resist
from ..dynamics.sticking import (
    change_joint,
    loosen,
    overloads,
    sticking_guards,
    sticking_slots,
    with_directions,
)
from ..forces.resistance import Resistance, TurningMode
from ..hybrid import (
    NONE,
    START,
    WINDOW,
    Accuracy,
    Assessment,
    GuardedStep,
    Record,
    Transition,
    at_zero,
)
from ..state import PlacedState, ReducedState
from ..system import AbstractState
from .history import ROLLING, SPINNING, HeldHistory, HeldSwitches


class HeldState(AbstractState):
    """The variables of a body that dry friction may hold, which a solve advances.

    - ``body``: the state of the body; θ̇ of a joint that sticks is 0. Under exact dry resistance, a solve advances ω
      relative to the ground, along the axes of the contact (of space, on a plane), instead of Ω, so that it is exactly
      0 at rest.
    - ``rolls``, ``spin``, ``rolling``: how it turns, as in :class:`AbstractTurning`; None without such resistance.
    - ``slips``: for each joint with dry friction, 1 or −1 where it slips in that direction, 0 where it sticks; None
      without such joints.
    """

    body: Any
    rolls: Float[Array, "*batch"] | None = None
    spin: Float[Array, "*batch"] | None = None
    rolling: Beginning | None = None
    slips: Float[Array, "*batch sticking"] | None = None

    def projected(self) -> "HeldState":
        return dataclasses.replace(self, body=self.body.projected())

    def conditions(self) -> Iterator[Condition]:
        yield from self.body.conditions()


OF_TURNING = 2  # guards of rolling and of spinning, before those of joints


class HeldBody(AbstractTurning):
    """A ball or a disk that dry friction may hold, and its joints."""

    body: AbstractBody

    title: ClassVar[str] = "body that dry friction may hold"
    state_type: ClassVar[Any] = HeldState

    def require_state(self, state: Any) -> None:
        if isinstance(state, ReducedState) and self.body.is_held:
            raise TypeError(
                "Argument `state` must be a BallState or a RotationState where resistance is `exact`, because what "
                "comes to rest has a place and a direction in space, but it is a ReducedState."
            )
        super().require_state(state)

    def prepare(self) -> "HeldBody":
        return HeldBody(self.body.prepare())

    # What a solve advances.

    def to_packed(self, t: Float[Array, ""], state: HeldState) -> HeldState:
        if not self.body.is_held:
            return state
        omega = self.unless_held(state, self.over_ground(t, state))
        return dataclasses.replace(state, body=state.body.with_Omega(omega))

    def from_packed(self, t: Float[Array, ""], packed: HeldState) -> HeldState:
        if not self.body.is_held:
            return packed
        packed = packed.projected()
        Omega = ContactAxes.of(self.body, t, packed.body).in_body(packed.body.Omega)
        return dataclasses.replace(packed, body=packed.body.with_Omega(Omega))

    def field_of_packed(self, t: Float[Array, ""], packed: HeldState) -> HeldState:
        state = self.from_packed(t, packed)
        moved = self.field(t, state)
        if not self.body.is_held:
            return moved
        rate = self.unless_held(state, rate_over_ground(self.body, t, state.body, moved.body.Omega))
        return dataclasses.replace(moved, body=moved.body.with_Omega(rate))

    def contact_axes(self, t: Float[Array, ""], state: HeldState) -> ContactAxes:
        return ContactAxes.of(self.body, t, state.body)

    def field(self, t: Float[Array, ""], state: HeldState) -> HeldState:
        moved = rates(self.moving(state), t, state.body, self.mode_at(t, state))
        return dataclasses.replace(jax.tree.map(jnp.zeros_like, state), body=moved)

    def mode_at(self, t: Float[Array, ""], state: HeldState) -> TurningMode | None:
        """Returns the mode of turning; None without exact dry resistance."""
        return self.mode(t, state) if self.body.is_held else None

    def turning(self, t: Float[Array, ""], state: HeldState) -> Turning:
        """Computes how the body turns without dry friction, and how torques change that."""
        return turning(self.moving(state), t, state.body)

    def moving(self, state: HeldState) -> AbstractBody:
        """Returns the body in the modes of its joints."""
        return self.body if state.slips is None else with_directions(self.body, state.slips)

    # The guards.

    def step_reference(self, t: Float[Array, ""], state: HeldState, accuracy: Accuracy) -> Heading | None:
        """Returns the direction of rolling as a step begins."""
        return self.heading_of_rolling(t, state, accuracy) if self.body.is_held else None

    def guards(self, t: Float[Array, ""], state: HeldState) -> Float[Array, " guards"]:
        """Computes the guards without a solve, in which rolling ends where ω_h vanishes."""
        zero = jnp.zeros_like(self.body.radius)
        return self.guards_in_step(
            t, state, Heading(self.direction(t, state), zero, zero) if self.body.is_held else None
        )

    def guards_in_step(
        self, t: Float[Array, ""], state: HeldState, reference: Heading | None
    ) -> Float[Array, " guards"]:
        """Computes the guards of rolling and of spinning, and two for each joint: the rate in its direction, or what
        friction has to spare where it holds it.
        """
        guards, mode = [], self.mode_at(t, state)
        if mode is not None and reference is not None:
            turns = self.turning(t, state)
            acting = resist(self.resistance, turns, mode)
            spare = needs(self.resistance, turns.radius, acting.amounts, acting.normal)
            guards.append(self.guards_of_turning(t, state, spare, reference))
        if state.slips is not None:
            holding = self.holding(t, state.body, state.slips, mode)
            guards.append(sticking_guards(self.body, state.slips, state.body.thetadot, holding))
        return jnp.concatenate(guards)

    def holding(
        self, t: Float[Array, ""], state: PlacedState, directions: Float[Array, " sticking"], mode: TurningMode | None
    ) -> Float[Array, " sticking"]:
        """Computes the friction in joints that stick, where the body turns in a mode that is given in space axes."""
        return holding_friction(in_mode(with_directions(self.body, directions), mode), t, state)

    def time_event(self, t: Float[Array, ""], state: HeldState) -> Float[Array, ""]:
        """Returns the end of the window in which the direction of rolling is known beforehand."""
        if self.body.planar or state.rolling is None:
            return jnp.full_like(t, jnp.inf)
        return jnp.where(state.rolls == 0, jnp.inf, state.rolling.until)

    @property
    def turns_aside(self) -> bool:
        """Whether its direction of rolling may turn, so that it is followed to its rest: that of a ball."""
        return self.body.is_held and not self.body.planar and self.resistance.dry is not None

    def assess(self, step: GuardedStep, accuracy: Accuracy) -> Assessment:
        """Finds the guard that is zero, or that a ball has come to rest although none is; and the longest next step."""
        never = jnp.full_like(step.end, jnp.inf)
        if not self.turns_aside:
            return Assessment(jnp.where(step.has_fallen, step.zero, NONE), never)
        rolls = step.state.rolls != 0
        slow, nears, longest = self.approach_rest(step, step.reference, ROLLING, accuracy)
        # The rate along the heading also falls to zero where a ball turns aside at speed: only a slow one may be at its
        # end.
        stops = rolls & (step.zero == ROLLING)
        ends = (step.zero != NONE) & jnp.where(stops, slow, step.has_fallen)
        otherwise = jnp.where(step.timed, WINDOW, jnp.where(rolls & nears, ROLLING, NONE))
        return Assessment(jnp.where(ends, step.zero, otherwise), jnp.where(rolls & ~ends, longest, never))

    # How modes follow each other.

    def start(self, t: Float[Array, ""], state: Any) -> HeldState:
        """Returns the state with which a solve starts; its mode is decided by the first transition."""
        start = HeldState(state)
        if self.body.is_held:
            unity = jnp.ones_like(self.body.radius)  # nothing is held before it
            start = dataclasses.replace(start, rolls=unity, spin=unity, rolling=Beginning.none(unity))
        if not self.body.sticking:
            return start
        return dataclasses.replace(start, slips=jnp.sign(state.thetadot[sticking_slots(self.body)]))

    def transition(
        self, t: Float[Array, ""], state: HeldState, event: Int[Array, ""], accuracy: Accuracy
    ) -> Transition:
        """Finds what follows the end of a mode, the end of a window, or the start of a run."""
        starts, decides = event == START, (event == START) | (event >= 0)
        heading = without_derivatives(self).step_reference(*without_derivatives((t, state, accuracy)))
        if heading is not None:
            # A ball is followed to its rest from this speed on, which counts as fixed, so that its guard is exactly
            # zero here. A disk has no direction that turns, and rolls until its rate is zero.
            least = jnp.zeros_like(heading.speed) if self.body.planar else heading.speed
            heading = heading._replace(least=least)
        t, before, slope = at_zero(type(self).guards_in_step, self, t, state, event, reference=(heading,))
        no = jnp.asarray(False)
        happened = Happened(starts, no, no, no, event - OF_TURNING if self.body.is_held else event)
        if before.rolls is not None:
            stops = (event == ROLLING) & (before.rolls != 0)
            t, before, stopped = self._stop(t, before, stops, accuracy.tolerance)
            decides &= ~stops | stopped
            happened = happened._replace(stops=stopped, loosens=(event == ROLLING) & ~stops, spinning=event == SPINNING)
        decide = jax.jit(type(self).decide)  # compiled on its own, it is traced once
        after = jax.lax.cond(decides, decide, lambda system, t, state, happened: state, self, t, before, happened)
        if self.turns_aside:
            begun = select_tree(decides, after.rolling, Beginning.none(t))
            after = dataclasses.replace(after, rolling=begun)
            after = self._with_window(t, before, after, accuracy.tolerance)
        return Transition(
            t=t,
            before=before,
            after=after,
            event=event,
            slope=slope,
            switches=decides & ~starts,
            crowds=~starts,
            pauses=happened.stops & (not self.body.planar),  # a ball comes to rest in ever shorter steps
            status=jnp.asarray(int(Status.SUCCESS)),
        )

    def _stop(
        self, t: Float[Array, ""], state: HeldState, stops: Bool[Array, ""], tolerance: Float[Array, ""]
    ) -> tuple[Float[Array, ""], HeldState, Bool[Array, ""]]:
        """Finds the time and the state where a slow body has come to rest, if it does so soon, and whether it does."""
        if self.body.planar:
            return t, state, stops

        def follow(t: Float[Array, ""], state: HeldState) -> tuple[Array, HeldState, Array]:
            omega = self.over_ground(t, state)[:2]
            # As in the midpoint rule: the end is found again with what acts halfway, to which the first end leads.
            first = self._end(t, state, state, omega)
            halfway = self._brake(t, state, state, omega, first.time, HALFWAY)
            end = self._end(t + HALFWAY * first.time, halfway, state, omega)
            ends = self.comes_to_rest(first, end, omega, tolerance)
            stopped = self._brake(t, state, halfway, omega, end.time, 1.0).projected()
            contact = self.contact_axes(t + end.time, stopped)
            spin = contact.over_ground(stopped.body.Omega)[2]
            at_rest = stopped.body.with_Omega(contact.in_body(jnp.stack([0 * spin, 0 * spin, spin])))
            stopped = eqx.tree_at(lambda x: x.body, stopped, at_rest)
            return (*select_tree(ends, (t + end.time, stopped), (t, state)), ends)

        return jax.lax.cond(stops, lambda: follow(t, state), lambda: (t, state, jnp.asarray(False)))

    def _end(self, t: Float[Array, ""], where: HeldState, state: HeldState, omega: Float[Array, "2"]) -> slips.End:
        """Computes the end of rolling with ω_h, with what acts at some time and state."""
        mode = self.mode(t, state, unit(omega))
        about = self.resistance, self.turning(t, where), mode
        return slips.end(_pull, slips.Around(about), omega)

    def _brake(
        self,
        t: Float[Array, ""],
        state: HeldState,
        where: HeldState,
        omega: Float[Array, "2"],
        time: Float[Array, ""],
        share: float,
    ) -> HeldState:
        """Returns the state after a share of the time in which ω_h falls to 0, with rates as they are ``where``."""
        # The mean rate until the end, so that ω_h is then zero; the torque is whatever this needs.
        rate = -omega / jnp.where(time > 0, time, 1.0)
        braking = in_three(rate)
        held = self.mode(t, state, unit(omega))._replace(rests=jnp.asarray(True), braking=braking)
        # The whole way is gone with the rates halfway, which is then where ``where`` is.
        moved = rates(self.moving(state), t + (time * HALFWAY if share == 1.0 else 0.0), where.body, held)
        body = jax.tree.map(lambda x, rate: x + share * time * rate, state.body, moved)
        return eqx.tree_at(lambda x: x.body, state, body)

    def decide(self, t: Float[Array, ""], state: HeldState, happened: "Happened") -> HeldState:
        """Returns the state in the mode that follows: everything is at rest that friction can hold so."""
        if state.slips is not None:
            slips, thetadot = change_joint(self.body, state.slips, state.body.thetadot, happened.joint)
            state = eqx.tree_at(lambda x: (x.body.thetadot, x.slips), state, (thetadot, slips))
        if not self.body.is_held:
            return dataclasses.replace(state, slips=self._release(t, state, None, jnp.zeros(0, bool)).slips)
        # At the end of its rolling or spinning, the rate is 0, not nearly.
        omega = self.unless_held(state, self.over_ground(t, state))
        omega = jnp.where(jnp.stack([happened.stops, happened.stops, happened.spinning]), 0.0, omega)
        axes = self.contact_axes(t, state)
        state = dataclasses.replace(state, body=state.body.with_Omega(axes.in_body(omega)))
        moving = candidates(self.resistance, omega, self.body.planar)
        # A body that rolls comes to rest by an event that says so, and not because its rate is rounding, as just after
        # it broke loose.
        may_rest = happened.starts | happened.stops | (state.rolls == 0)
        moving = moving._replace(rests=moving.rests & may_rest)
        spins = happened.spinning & self.is_held_still(state)
        loose = jnp.stack([happened.loosens & moving.rests, spins & moving.still])
        held = self._release(t, state, moving, loose)
        assert held.mode is not None
        begins = moving.rests & ~held.mode.rests
        mode = held.mode._replace(sigma=jnp.where(begins, held.mode.sigma, moving.sigma))
        state = dataclasses.replace(state, slips=held.slips)
        if self.turns_aside:
            # What lets go was decided without derivatives, which the direction of rolling has.
            mode = along_growth(self.resistance, self.turning(t, state), mode, begins)
        spin = mode.spin if self.resists_spinning else jnp.zeros_like(mode.spin)
        rolls, rolling = jnp.where(mode.rests, 0.0, 1.0).astype(t.dtype), Beginning.along(t, mode.sigma[:2])
        if self.turns_aside:
            rolling = select_tree(begins, rolling, Beginning.none(t))
        return dataclasses.replace(state, rolls=rolls, spin=spin, rolling=rolling)

    def _release(
        self, t: Float[Array, ""], state: HeldState, moving: TurningMode | None, loose: Bool[Array, " loads"]
    ) -> "_Held":
        """Finds what is held when friction has let go of all that it cannot hold, the most overloaded first.

        It has no derivatives: what is held is a yes or no for each.

        - ``moving``: the mode of turning in which all that stands is held.
        - ``loose``: of rolling and of spinning, what is let go at once.
        """
        system, t, state, moving = without_derivatives((self, t, state, moving))
        turns = system.turning(t, state) if moving is not None and state.slips is None else None

        def weigh(held: _Held) -> tuple[Array, tuple[Array | None, Array | None]]:
            loads, torque, friction = [], None, None
            if held.mode is not None:
                now = system.turning(t, dataclasses.replace(state, slips=held.slips)) if turns is None else turns
                acting = resist(system.resistance, now, held.mode)
                torque, need = acting.amounts, needs(system.resistance, now.radius, acting.amounts, acting.normal)
                loads.append(need.overloads(held.mode))
            if held.slips is not None:
                friction = system.holding(t, state.body, held.slips, held.mode)
                loads.append(overloads(system.body, held.slips, friction))
            return jnp.concatenate(loads), (torque, friction)

        def without(held: _Held, acting: tuple[Any, Any], off: Bool[Array, " loads"]) -> _Held:
            (mode, slips), (torque, friction) = held, acting
            mode = None if mode is None else let_go(mode, torque, off[:OF_TURNING])
            return _Held(mode, None if slips is None else loosen(slips, friction, off[-slips.size :]))

        joints = jnp.zeros(0 if state.slips is None else state.slips.size, bool)
        return release(_Held(moving, state.slips), weigh, without, jnp.concatenate([loose, joints]))

    def _with_window(
        self, t: Float[Array, ""], before: HeldState, state: Any, tolerance: Float[Array, ""]
    ) -> HeldState:
        """Returns the state with the direction of rolling that begins or stays slow, for as long as it is known."""
        longest = windows.longest_window(t, self.driving_kinks(), slips.unit_of_time(self.body))
        # At ω_h = 0 the direction cannot be computed from the rate: ``decide`` says in which the ball begins to roll.
        begins, (course, rolls_on) = state.rolling.until == t, self.follow_rolling(t, before, state, tolerance)
        rolls_on &= ~begins
        course = select_tree(rolls_on, course, Course.of(state.rolling.sigma))
        begun = jax.lax.cond(
            begins | rolls_on,
            lambda: windows.beginning(_FromRest(self, state), t, state.body, course, longest),
            lambda: Beginning.none(t),
        )
        state = select_tree(rolls_on & (begun.until > t), self.along_course(t, state, course), state)
        return eqx.tree_at(lambda x: x.rolling, state, begun)

    # What a run shows.

    def history(self, times: Float[Array, " T"], states: HeldState, record: Record | None) -> HeldHistory:
        assert record is not None
        sides: dict[str, Any] = {
            f"{name}_{side}": getattr(of_side, field)
            for name, field in (("rolls", "rolls"), ("spin", "spin"), ("directions", "slips"))
            for side, of_side in (("before", record.before), ("after", record.after))
        }
        shown = {"before": record.before.body, "after": record.after.body}
        switches = HeldSwitches.of(record, **shown, **sides, joints=self.body.sticking)
        rests = None if states.rolls is None else states.rolls == 0
        return HeldHistory(switches=switches, rests=rests, spin=states.spin, directions=states.slips)


class Happened(NamedTuple):
    """What has happened: the run starts, rolling stops, rest ends, something happens to spinning; and the guard of the
    ``joint``, negative for none.
    """

    starts: Bool[Array, ""]
    stops: Bool[Array, ""]
    loosens: Bool[Array, ""]
    spinning: Bool[Array, ""]
    joint: Int[Array, ""]


class _Held(NamedTuple):
    """What is held: the mode of turning, and the directions of joints, 0 where they stick; None for neither."""

    mode: TurningMode | None
    slips: Float[Array, " sticking"] | None


class _FromRest(NamedTuple):
    """A ball that begins to roll, in the mode of ``begins``."""

    system: HeldBody
    begins: HeldState

    @property
    def body(self) -> AbstractBody:
        """What is in motion, in the modes of its joints."""
        return self.system.moving(self.begins)

    def prepare(self, t: Float[Array, ""], state: PlacedState) -> tuple[()]:
        return ()

    def pull(
        self, t: Float[Array, ""], state: PlacedState, prepare: tuple[()], sigma: Float[Array, "2"]
    ) -> tuple[Float[Array, "2"], PlacedState]:
        """Computes ω̇_h in space axes, and the rates of the body."""
        moved = rates(self.system.moving(self.begins), t, state, self.system.mode(t, self.begins, sigma))
        return rate_over_ground(self.system.body, t, state, moved.Omega)[:2], moved


@jax.jit
def rates(body: AbstractBody, t: Float[Array, ""], state: Any, mode: TurningMode | None) -> Any:
    """Computes ẋ of a body in a mode."""
    return in_mode(body, mode).field(t, state)


def in_mode(body: AbstractBody, mode: TurningMode | None) -> AbstractBody:
    """Returns the body in a mode of turning, if it has one."""
    return (
        body
        if mode is None
        else eqx.tree_at(lambda body: body.resistance.mode, body, mode, is_leaf=lambda x: x is None)
    )


def _pull(about: tuple[Resistance, Turning, TurningMode], sigma: Float[Array, "2"], _: Float[Array, ""]) -> slips.Pull:
    """Computes how a ball rolls in a direction, with what acts at a time and a state."""
    resistance, turns, mode = about
    acting = resist(resistance, turns, mode._replace(sigma=in_three(sigma)))
    power = -jnp.sum(sigma * acting.amounts[:2])
    return slips.Pull(acting.w[:2], power, acting.normal)
