"""A body that exact dry resistance brings to rest, as one hybrid system with a mode of rest.

``simulate`` solves it in place of a body with such resistance, if no law of contact is given.

A body rolls until ω_h falls to zero. It then rests, with ω_h = 0 and ω̇_h = 0, if friction can hold it; if not, it rolls
on in another direction. It rests until the torque that holds it exceeds the largest one. Spinning, ω₃, has a mode of
rest of its own. As one of them begins or ends, the torque on the other jumps, which may break that loose, too.

The direction of rolling is ω_h/|ω_h|, which cannot be computed where a ball begins to roll or comes to rest:
``contact.slip`` says what is done there. A disk has two directions, which its state knows.
"""

import dataclasses
from collections.abc import Iterator
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
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
from ..dynamics.equations import turning
from ..dynamics.footing import ContactAxes, in_three, rate_over_ground
from ..dynamics.rest import Turning, begin, candidates, needs, resist
from ..forces.resistance import Resistance, TurningMode
from ..hybrid import (
    NONE,
    SLOW_ROLLING,
    START,
    WINDOW,
    AbstractHistory,
    Accuracy,
    Assessment,
    GuardedStep,
    Record,
    Switches,
    Transition,
    at_zero,
)
from ..state import PlacedState, ReducedState
from ..system import AbstractState


class DryRollingState(AbstractState):
    """The variables of a body that exact dry resistance may hold, which a solve advances.

    - ``body``: the state of the body. A solve advances ω relative to the ground, along the axes of the contact (of
      space, on a plane), instead of Ω, so that it is exactly 0 at rest.
    - ``rolls``, ``spin``, ``rolling``: how it turns, as in :class:`AbstractTurning`.
    """

    body: PlacedState
    rolls: Float[Array, "*batch"]
    spin: Float[Array, "*batch"]
    rolling: Beginning

    def projected(self) -> "DryRollingState":
        return eqx.tree_at(lambda x: x.body, self, self.body.projected())

    def conditions(self) -> Iterator[Condition]:
        yield from self.body.conditions()


class RestSwitches(Switches):
    """The times at which a body comes to rest, breaks loose or turns back.

    - ``before``, ``after``: the states of the body, with a leading axis.
    - ``rolls_before``, ``rolls_after``: 1 where it rolls, 0 where it rests, shape (max_switches,).
    - ``spin_before``, ``spin_after``: the sign of its spinning, 0 where that is held, shape (max_switches,).
    """

    rolls_before: Float[Array, "*batch switches"]
    rolls_after: Float[Array, "*batch switches"]
    spin_before: Float[Array, "*batch switches"]
    spin_after: Float[Array, "*batch switches"]

    def words(self, k: int) -> str:
        rolled, rolls, spun, spins = (
            float(np.asarray(of)[k]) for of in (self.rolls_before, self.rolls_after, self.spin_before, self.spin_after)
        )
        said = []
        if rolled != rolls:
            said.append("the body rolls" if rolls else "the body comes to rest")
        elif rolled and int(np.asarray(self.event)[k]) == ROLLING:
            said.append("the body rolls back")
        if spun != spins:
            said.append("its spinning ends" if spins == 0 else "it begins to spin" if spun == 0 else "it spins back")
        return ", ".join(said) or "nothing changed"


class RestHistory(AbstractHistory):
    """When exact dry resistance held a body at the saved times of a run, and the switches.

    - ``switches``: the ``RestSwitches``.
    - ``rests``: whether it held the body against rolling, shape (T,).
    - ``spin``: the sign of ω₃ as friction against spinning has it, 0 where that is held or there is none, shape (T,).
    """

    described: ClassVar[str] = "exact dry resistance, with which forces jump"

    switches: RestSwitches
    rests: Bool[Array, "*batch T"]
    spin: Float[Array, "*batch T"]

    @property
    def lines(self) -> list[str]:
        if int(self.switches.count) == 0:
            return ["it never came to rest or broke loose"]
        return [f"it came to rest, broke loose or turned back {self.switches.how_often}", *self.switches.first_lines]

    @property
    def advice(self) -> str:
        return SLOW_ROLLING

    def at_rows(self, rows: slice) -> "RestHistory":
        return dataclasses.replace(self, rests=self.rests[rows], spin=self.spin[rows])


ROLLING, SPINNING = 0, 1  # guards, and the events where they fall to zero


class DryRolling(AbstractTurning):
    """A ball or a disk that exact dry resistance may hold at rest."""

    body: AbstractBody

    title: ClassVar[str] = "body with exact dry resistance"
    state_type: ClassVar[Any] = DryRollingState

    def require_state(self, state: Any) -> None:
        if isinstance(state, ReducedState):
            raise TypeError(
                "Argument `state` must be a BallState or a RotationState where resistance is `exact`, because what "
                "comes to rest has a place and a direction in space, but it is a ReducedState."
            )
        super().require_state(state)

    def prepare(self) -> "DryRolling":
        return DryRolling(self.body.prepare())

    # What a solve advances.

    def to_packed(self, t: Float[Array, ""], state: DryRollingState) -> DryRollingState:
        omega = self.unless_held(state, self.over_ground(t, state))
        return eqx.tree_at(lambda x: x.body, state, state.body.with_Omega(omega))

    def from_packed(self, t: Float[Array, ""], packed: DryRollingState) -> DryRollingState:
        packed = packed.projected()
        Omega = ContactAxes.of(self.body, t, packed.body).in_body(packed.body.Omega)
        return eqx.tree_at(lambda x: x.body, packed, packed.body.with_Omega(Omega))

    def field_of_packed(self, t: Float[Array, ""], packed: DryRollingState) -> DryRollingState:
        state = self.from_packed(t, packed)
        moved = self.field(t, state)
        rate = self.unless_held(state, rate_over_ground(self.body, t, state.body, moved.body.Omega))
        return eqx.tree_at(lambda x: x.body, moved, moved.body.with_Omega(rate))

    def over_ground(self, t: Float[Array, ""], state: DryRollingState) -> Float[Array, "3"]:
        """Computes ω of the body relative to the ground, along the axes of the contact."""
        return self.contact_axes(t, state).over_ground(state.body.Omega)

    def contact_axes(self, t: Float[Array, ""], state: DryRollingState) -> ContactAxes:
        return ContactAxes.of(self.body, t, state.body)

    def direction(self, t: Float[Array, ""], state: DryRollingState) -> Float[Array, "2"]:
        """Returns the direction of ω_h of a body that rolls, space axes."""
        if self.body.planar:
            return state.rolling.sigma
        omega = self.over_ground(t, state)
        return jnp.where(t <= state.rolling.until, state.rolling.direction(t), unit(omega[:2]))

    def field(self, t: Float[Array, ""], state: DryRollingState) -> DryRollingState:
        moved = rates(self.moving(state), t, state.body, self.mode(t, state))
        return eqx.tree_at(lambda x: x.body, jax.tree.map(jnp.zeros_like, state), moved)

    def in_its_mode(self, t: Float[Array, ""], state: DryRollingState) -> AbstractBody:
        return in_mode(self.moving(state), self.mode(t, state))

    def turning(self, t: Float[Array, ""], state: DryRollingState) -> Turning:
        """Computes how the body turns without dry friction, and how torques change that."""
        return turning(self.moving(state), t, state.body)

    # The guards.

    def step_reference(self, t: Float[Array, ""], state: DryRollingState, accuracy: Accuracy) -> Heading:
        """Returns the direction of rolling as a step begins."""
        return self.heading_of_rolling(t, state, accuracy)

    def guards(self, t: Float[Array, ""], state: DryRollingState) -> Float[Array, " guards"]:
        """Computes the guards without a solve, in which rolling ends where ω_h vanishes."""
        zero = jnp.zeros_like(state.rolls)
        return self.guards_in_step(t, state, Heading(self.direction(t, state), zero, zero))

    def guards_in_step(
        self, t: Float[Array, ""], state: DryRollingState, reference: Heading
    ) -> Float[Array, " guards"]:
        """Computes the guards of rolling and of spinning: the rate in its direction, or what friction has to spare
        where it holds it.
        """
        turns = self.turning(t, state)
        acting = resist(self.resistance, turns, self.mode(t, state))
        spare = needs(self.resistance, turns.radius, acting.amounts, acting.normal)
        return self.guards_of_turning(t, state, spare, reference)

    def time_event(self, t: Float[Array, ""], state: DryRollingState) -> Float[Array, ""]:
        """Returns the end of the window in which the direction of rolling is known beforehand."""
        if self.body.planar:
            return jnp.full_like(state.rolls, jnp.inf)
        return jnp.where(state.rolls == 0, jnp.inf, state.rolling.until)

    def assess(self, step: GuardedStep, accuracy: Accuracy) -> Assessment:
        """Finds the guard that is zero, or that a ball has come to rest although none is; and the longest next step."""
        never = jnp.full_like(step.end, jnp.inf)
        if self.body.planar or self.resistance.dry is None:
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

    def start(self, t: Float[Array, ""], state: PlacedState) -> DryRollingState:
        """Returns the state with which a solve starts; its mode is decided by the first transition."""
        unity = jnp.ones_like(self.body.radius)  # nothing is held before it
        return DryRollingState(state, unity, unity, Beginning.none(unity))

    def transition(
        self, t: Float[Array, ""], state: DryRollingState, event: Int[Array, ""], accuracy: Accuracy
    ) -> Transition:
        """Finds what follows the end of a mode, the end of a window, or the start of a run."""
        starts, decides = event == START, (event == START) | (event >= 0)
        heading = without_derivatives(self).step_reference(*without_derivatives((t, state, accuracy)))
        # A ball is followed to its rest from this speed on, which counts as fixed, so that its guard is exactly zero
        # here. A disk has no direction that turns, and rolls until its rate is zero.
        heading = heading._replace(least=jnp.zeros_like(heading.speed) if self.body.planar else heading.speed)
        t, before, slope = at_zero(type(self).guards_in_step, self, t, state, event, reference=(heading,))
        stops = (event == ROLLING) & (before.rolls != 0)
        t, before, stopped = self._stop(t, before, stops, accuracy.tolerance)
        decides &= ~stops | stopped
        occurrence = Happened(starts, stopped, (event == ROLLING) & ~stops, event == SPINNING, event)
        decide = jax.jit(type(self).decide)  # compiled on its own, it is traced once
        after = jax.lax.cond(decides, decide, lambda system, t, state, occurrence: state, self, t, before, occurrence)
        if not self.body.planar:
            begun = select_tree(decides, after.rolling, Beginning.none(t))
            after = eqx.tree_at(lambda x: x.rolling, after, begun)
            after = self._with_window(t, before, after, accuracy.tolerance)
        return Transition(
            t=t,
            before=before,
            after=after,
            event=event,
            slope=slope,
            switches=decides & ~starts,
            crowds=~starts,
            pauses=stopped & (not self.body.planar),  # a ball comes to rest in ever shorter steps
            status=jnp.asarray(int(Status.SUCCESS)),
        )

    def _stop(
        self, t: Float[Array, ""], state: DryRollingState, stops: Bool[Array, ""], tolerance: Float[Array, ""]
    ) -> tuple[Float[Array, ""], DryRollingState, Bool[Array, ""]]:
        """Finds the time and the state where a slow body has come to rest, if it does so soon, and whether it does."""
        if self.body.planar:
            return t, state, stops

        def follow(t: Float[Array, ""], state: DryRollingState) -> tuple[Array, DryRollingState, Array]:
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

    def _end(
        self, t: Float[Array, ""], where: DryRollingState, state: DryRollingState, omega: Float[Array, "2"]
    ) -> slips.End:
        """Computes the end of rolling with ω_h, with what acts at some time and state."""
        mode = self.mode(t, state, unit(omega))
        about = self.resistance, self.turning(t, where), mode
        return slips.end(_pull, slips.Around(about), omega)

    def _brake(
        self,
        t: Float[Array, ""],
        state: DryRollingState,
        where: DryRollingState,
        omega: Float[Array, "2"],
        time: Float[Array, ""],
        share: float,
    ) -> DryRollingState:
        """Returns the state after a share of the time in which ω_h falls to 0, with rates as they are ``where``."""
        # The mean rate until the end, so that ω_h is then zero; the torque is whatever this needs.
        rate = -omega / jnp.where(time > 0, time, 1.0)
        braking = in_three(rate)
        held = self.mode(t, state, unit(omega))._replace(rests=jnp.asarray(True), braking=braking)
        # The whole way is gone with the rates halfway, which is then where ``where`` is.
        moved = rates(self.moving(state), t + (time * HALFWAY if share == 1.0 else 0.0), where.body, held)
        body = jax.tree.map(lambda x, rate: x + share * time * rate, state.body, moved)
        return eqx.tree_at(lambda x: x.body, state, body)

    def decide(self, t: Float[Array, ""], state: DryRollingState, given: "Happened") -> DryRollingState:
        """Returns the state in the mode that follows: at rest as far as friction can hold it."""
        moving, omega, turns = self.all_held(t, state, given)
        loose = given.loosens, given.spinning & self.is_held_still(state)
        mode = begin(self.resistance, turns, moving, self.body.planar, *loose)
        return self.with_mode(t, state, omega, mode, moving.rests & ~mode.rests)

    def all_held(
        self, t: Float[Array, ""], state: DryRollingState, given: "Happened"
    ) -> tuple[TurningMode, Float[Array, "3"], Turning]:
        """Returns the mode in which all that does not move is held, ω in space axes, and how the body turns."""
        # At the end of its rolling or spinning, the rate is 0, not nearly.
        omega = self.unless_held(state, self.over_ground(t, state))
        held = jnp.stack([given.stops, given.stops, given.spinning])
        omega = jnp.where(held, 0.0, omega)
        turns = self.turning(t, state)
        moving = candidates(self.resistance, omega, self.body.planar)
        # A body that rolls comes to rest by an event that says so, and not because its rate is rounding, as just after
        # it broke loose.
        may_rest = given.starts | given.stops | (state.rolls == 0)
        return moving._replace(rests=moving.rests & may_rest), omega, turns

    def with_mode(
        self,
        t: Float[Array, ""],
        state: DryRollingState,
        omega: Float[Array, "3"],
        mode: TurningMode,
        starts_to_roll: Bool[Array, ""],
    ) -> DryRollingState:
        """Returns the state in a mode, with ω in space axes, and with the direction of rolling that begins."""
        body = state.body.with_Omega(self.contact_axes(t, state).in_body(omega))
        rolls, sigma = jnp.where(mode.rests, 0.0, 1.0).astype(t.dtype), mode.sigma[:2]
        spin = mode.spin if self.resists_spinning else jnp.zeros_like(mode.spin)
        after = eqx.tree_at(
            lambda x: (x.body, x.rolls, x.spin, x.rolling), state, (body, rolls, spin, Beginning.along(t, sigma))
        )
        if self.body.planar or self.resistance.dry is None:
            return after
        return eqx.tree_at(lambda x: x.rolling, after, select_tree(starts_to_roll, after.rolling, Beginning.none(t)))

    def _with_window(
        self, t: Float[Array, ""], before: DryRollingState, state: DryRollingState, tolerance: Float[Array, ""]
    ) -> DryRollingState:
        """Returns the state with the direction of rolling that begins or stays slow, for as long as it is known."""
        if self.resistance.dry is None:
            return state
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

    def history(self, times: Float[Array, " T"], states: DryRollingState, record: Record | None) -> RestHistory:
        assert record is not None
        before, after = record.before, record.after
        switches = RestSwitches.of(
            record,
            before=before.body,
            after=after.body,
            rolls_before=before.rolls,
            rolls_after=after.rolls,
            spin_before=before.spin,
            spin_after=after.spin,
        )
        return RestHistory(switches=switches, rests=states.rolls == 0, spin=states.spin)


class Happened(NamedTuple):
    """What has happened: the run starts, rolling stops, rest ends, something happens to spinning; and the ``event``."""

    starts: Bool[Array, ""]
    stops: Bool[Array, ""]
    loosens: Bool[Array, ""]
    spinning: Bool[Array, ""]
    event: Int[Array, ""]


class _FromRest(NamedTuple):
    """A ball that begins to roll, in the mode of ``begins``."""

    system: DryRolling
    begins: DryRollingState

    @property
    def body(self) -> AbstractBody:
        """What is in motion."""
        return self.system.body

    def prepare(self, t: Float[Array, ""], state: PlacedState) -> tuple[()]:
        return ()

    def pull(
        self, t: Float[Array, ""], state: PlacedState, prepare: tuple[()], sigma: Float[Array, "2"]
    ) -> tuple[Float[Array, "2"], PlacedState]:
        """Computes ω̇_h in space axes, and the rates of the body."""
        moved = rates(self.system.moving(self.begins), t, state, self.system.mode(t, self.begins, sigma))
        return rate_over_ground(self.system.body, t, state, moved.Omega)[:2], moved


@jax.jit
def rates(body: AbstractBody, t: Float[Array, ""], state: PlacedState, mode: TurningMode) -> PlacedState:
    """Computes ẋ of a body in a mode."""
    return in_mode(body, mode).field(t, state)


def in_mode(body: AbstractBody, mode: TurningMode) -> AbstractBody:
    """Returns the body in a mode."""
    return eqx.tree_at(lambda body: body.resistance.mode, body, mode, is_leaf=lambda x: x is None)


def _pull(about: tuple[Resistance, Turning, TurningMode], sigma: Float[Array, "2"], _: Float[Array, ""]) -> slips.Pull:
    """Computes how a ball rolls in a direction, with what acts at a time and a state."""
    resistance, turns, mode = about
    acting = resist(resistance, turns, mode._replace(sigma=in_three(sigma)))
    power = -jnp.sum(sigma * acting.amounts[:2])
    return slips.Pull(acting.w[:2], power, acting.normal)
