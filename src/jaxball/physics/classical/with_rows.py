"""A system from a Lagrangian whose contacts and dry friction hold it for a while, as one hybrid system.

``simulate`` solves it in place of a :class:`LagrangianSystem` with such rows. A mode says of each row whether it is
held, and in which direction it moves otherwise (``rows``). It lasts while gaps are positive, while what moves goes on
in its direction, and while what holds is within its limits. Steps end on all that is held, so that a gap that is closed
stays 0, and a velocity that sticks, too.

An impact changes q̇ by M⁻¹Jᵀλ, in no time. All contacts that touch take part in it: those that are struck rebound by
their restitution, and others open if that pulls at them. Dry friction, whose force is finite, gives no impulse.
"""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...interface.status import Status
from ...numerics.arrays import AnyArray, select_tree
from ...numerics.vectors import apply
from ...programs.derivatives.differentiation import without_derivatives
from ..conditions import Condition, ExplainedCondition
from ..hybrid import AbstractHistory, Accuracy, Record, Switches, Transition
from ..system import AbstractState, AbstractSystem
from .lagrangian import IN_STEP, AbstractLagrangianSystem, LagrangianState
from .multipliers import nearest_place, nearest_velocity
from .rows import (
    Limits,
    amounts,
    check_determined,
    choose,
    limits_of,
    mode_at_rest,
    repeat,
    rounding_of_gaps,
    rows_in_state,
)

if TYPE_CHECKING:
    from .from_functions import LagrangianSystem


class RowsState(AbstractState):
    """The variables of a system with rows that a solve advances.

    - ``motion``: (q, q̇).
    - ``mode``: of each row 0 where it is held, else 1 or −1.
    - ``fastest``: the fastest approach of each contact so far.
    - ``friction_loss``, ``impact_loss``: the energy that dry friction and impacts have taken.
    """

    motion: LagrangianState
    mode: Float[Array, "*batch rows"]
    fastest: Float[Array, "*batch contacts"]
    friction_loss: Float[Array, "*batch"]
    impact_loss: Float[Array, "*batch"]

    def conditions(self) -> Iterator[Condition]:
        yield from self.motion.conditions()


class RowSwitches(Switches):
    """The times at which a contact is struck, closes or opens, and dry friction sticks or gives way.

    - ``before``, ``after``: the :class:`LagrangianState` before and after each, with a leading axis.
    - ``mode_before``, ``mode_after``: of each row 0 where it is held, else 1 or −1, shape (max_switches, rows).
    - ``lost``: the energy that an impact took, shape (max_switches,).
    - ``rows``: the names of the rows, and ``contacts`` how many of them are contacts.
    """

    mode_before: Float[Array, "*batch switches rows"]
    mode_after: Float[Array, "*batch switches rows"]
    lost: Float[Array, "*batch switches"]
    rows: tuple[str, ...] = eqx.field(static=True)
    contacts: int = eqx.field(static=True)

    def words(self, k: int) -> str:
        before, after = np.asarray(self.mode_before[k]), np.asarray(self.mode_after[k])
        said = []
        for row, (name, now, then) in enumerate(zip(self.rows, before, after, strict=True)):
            if row < self.contacts:
                struck = now == then == 1 and int(np.asarray(self.event)[k]) == row
                if struck or now != then:
                    said.append(f"{name} {'is struck' if struck else 'opens' if then else 'closes'}")
            elif now != then:
                said.append(f"{name} {'sticks' if then == 0 else 'gives way' if now == 0 else 'turns back'}")
        return ", ".join(said) or "nothing changed"


class RowHistory(AbstractHistory):
    """What was held at the saved times of a run, the energy that this took, and the switches.

    - ``switches``: the ``RowSwitches``.
    - ``mode``: of each row, in the order of ``rows`` of the system, 0 where it is held, 1 or −1 where it moves in that
      direction; an open contact has 1. Shape (T, rows).
    - ``friction_loss``, ``impact_loss``: the energy that dry friction and impacts have taken so far, shape (T,) each.
      In an impact on a wall that moves, what that has done counts, too.
    """

    described: ClassVar[str] = "contacts with one side or dry friction, at which velocities or forces jump"

    switches: RowSwitches
    mode: Float[Array, "*batch T rows"]
    friction_loss: Float[Array, "*batch T"]
    impact_loss: Float[Array, "*batch T"]

    @property
    def held(self) -> Bool[Array, "*batch T rows"]:
        """Whether each row is held: the contact closed, the velocity stuck."""
        return self.mode == 0

    @property
    def lines(self) -> list[str]:
        if int(self.switches.count) == 0:
            return ["no contact was struck, and nothing stuck or gave way"]
        return [f"what is held changed {self.switches.how_often}", *self.switches.first_lines]

    def at_rows(self, rows: slice) -> "RowHistory":
        names = ("mode", "friction_loss", "impact_loss")
        return dataclasses.replace(self, **{name: getattr(self, name)[rows] for name in names})


class Impact(NamedTuple):
    """What an impact does: the state after it, and which rows are then ``still``; that has no derivatives."""

    state: RowsState
    still: Bool[Array, " rows"]


class LagrangianWithRows(AbstractSystem[RowsState]):
    """A system from a Lagrangian with contacts or dry friction."""

    system: "LagrangianSystem"

    title: ClassVar[str] = "Lagrangian system with contacts or dry friction"
    state_type: ClassVar[Any] = RowsState

    def require_state(self, state: Any) -> None:
        type(self.system).require_state(self.system, state)

    def conditions(self) -> Iterator[Condition]:
        yield from self.system.conditions()

    def start_conditions(self, t: Float[Array, ""], state: RowsState) -> Iterator[Condition | ExplainedCondition]:
        yield from self.system.conditions_of_rows(t, state.motion)
        yield check_determined(state.mode, self.system.rows)

    def run_conditions(self, times: Float[AnyArray, " T"]) -> Iterator[Condition | ExplainedCondition]:
        yield from self.system.run_conditions(times)

    def numbers(self) -> Iterator[tuple[str, Array]]:
        yield from self.system.numbers()

    def driving_kinks(self) -> Float[Array, " kinks"]:
        return self.system.driving_kinks()

    # The motion.

    def field(self, t: Float[Array, ""], state: RowsState) -> RowsState:
        rows = rows_in_state(self.system, t, state.motion)
        limits = limits_of(self.system)
        acting = amounts(rows.law, state.mode, limits.level)
        rate = LagrangianState(state.motion.qdot, rows.free + apply(rows.pull, acting))
        rubbing = jnp.sum(limits.level * state.mode * rows.velocities)
        none = jax.tree.map(jnp.zeros_like, state)
        return dataclasses.replace(none, motion=rate, friction_loss=rubbing)

    @property
    def always_projected(self) -> bool:
        return True

    def projected(self, t: Float[Array, ""], packed: RowsState) -> RowsState:
        """Returns the nearest state that keeps all constraints and all that is held."""
        return eqx.tree_at(lambda x: x.motion, packed, self._on_held(t, packed.motion, packed.mode == 0))

    @eqx.filter_jit
    def _on_held(self, t: Float[Array, ""], state: LagrangianState, held: Bool[Array, " rows"]) -> LagrangianState:
        system, q, qdot = self.system, state.q, state.qdot
        mass = AbstractLagrangianSystem.equations(system, t, state).mass
        of_velocity, of_place = system._counts()
        contacts = sum(system.row_sizes()[0])

        def places(t: Float[Array, ""], q: Float[Array, " n"]) -> Float[Array, " places"]:
            return jnp.concatenate([system._of_place(t, q), system.gaps(t, q)])

        def rates(t: Float[Array, ""], q: Float[Array, " n"], qdot: Float[Array, " n"]) -> Float[Array, " rates"]:
            return jnp.concatenate([system._rates(t, q, qdot), system.row_rates(t, q, qdot)])

        always = jnp.ones(of_velocity + of_place, bool)
        if of_place + contacts:
            q = nearest_place(mass, places, t, q, IN_STEP, jnp.append(always[:of_place], held[:contacts]))
        rows = jax.jacfwd(rates, argnums=2)(t, q, qdot)
        on_all = jnp.append(always, held)
        return LagrangianState(q, nearest_velocity(mass, rows, rates(t, q, qdot), qdot, on_all))

    # The guards.

    def guards(self, t: Float[Array, ""], state: RowsState) -> Float[Array, " guards"]:
        """Computes one guard for each row, and a second one for dry friction: where it holds, which of the two falls
        says in which direction it gives way.
        """
        rows, limits = rows_in_state(self.system, t, state.motion), limits_of(self.system)
        held, contacts, slack = state.mode == 0, self.contacts, rows.rounding_of_amounts
        z = amounts(rows.law, state.mode, limits.level)
        below, above = z - limits.low + slack, limits.high - z + slack
        height = self.system.gaps(t, state.motion.q) + self._rounding_of_gaps(t, state.motion)
        open_or_onward = jnp.append(height, (state.mode * rows.velocities)[contacts:])
        first = jnp.where(held, jnp.append(below[:contacts], above[contacts:]), open_or_onward)
        return jnp.append(first, jnp.where(held, below, 1.0)[contacts:])

    @property
    def contacts(self) -> int:
        """How many of the rows are contacts; they come first."""
        return sum(self.system.row_sizes()[0])

    def _rounding_of_gaps(self, t: Float[Array, ""], state: LagrangianState) -> Float[Array, " contacts"]:
        return rounding_of_gaps(*without_derivatives((self.system, t, state.q)))

    # How modes follow each other.

    def start(self, t: Float[Array, ""], state: LagrangianState) -> RowsState:
        """Returns the state with which a solve starts: what is at rest is held if it can be."""
        none = jnp.zeros_like(state.q[0])
        fastest = jnp.zeros(self.contacts, state.q.dtype)
        return RowsState(state, mode_at_rest(self.system, t, state), fastest, none, none)

    def transition(
        self, t: Float[Array, ""], state: RowsState, event: Int[Array, ""], accuracy: Accuracy
    ) -> Transition:
        """Computes what happens at an event; where it is not determined what is held then, the run ends."""
        done = super().transition(t, state, event, accuracy)
        unknown = jnp.any(jnp.isnan(jnp.append(done.after.mode, done.after.motion.qdot)))
        status = jnp.where(unknown, int(Status.NOT_FINITE), done.status)
        return done._replace(after=select_tree(unknown, done.before, done.after), status=status)

    def reset(self, t: Float[Array, ""], state: RowsState, which: Int[Array, ""]) -> RowsState:
        """Returns the state after an event: after an impact, if there is one, everything is held that can be."""
        system, contacts, rows = self.system, self.contacts, jnp.arange(state.mode.size)
        is_second = which >= rows.size  # of the guards of dry friction that holds
        here = rows == jnp.where(is_second, which - rows.size + contacts, which)
        impact = self._strike(t, state, here)
        motion = self._on_held(t, impact.state.motion, impact.still)
        fixed = without_derivatives((system, t, motion))
        after, limits = rows_in_state(*fixed), limits_of(system)
        moving = jnp.where(rows < contacts, 1.0, jnp.sign(after.velocities))
        # What no longer holds may seem to by rounding: it begins as loose.
        loose = jnp.where((rows < contacts) | is_second, 1.0, -1.0)
        begins = jnp.where(here & (state.mode == 0), loose, 0.0)
        mode = jnp.where(impact.still, begins, moving)
        mode = choose(after.law, limits, mode, impact.still, after.rounding_of_amounts)
        return dataclasses.replace(impact.state, motion=motion, mode=mode)

    def _strike(self, t: Float[Array, ""], state: RowsState, here: Bool[Array, " rows"]) -> Impact:
        """Computes the impact of all contacts that touch, which is none unless one of them is struck."""
        motion, contacts = state.motion, self.contacts
        rows, gaps = rows_in_state(self.system, t, motion), self.system.gaps(t, motion.q)
        is_contact, held, u = jnp.arange(state.mode.size) < contacts, state.mode == 0, rows.velocities
        near = jnp.append(gaps <= self._rounding_of_gaps(t, motion), jnp.zeros(u.size - contacts, bool))
        touches = is_contact & (here | held | near)
        rebound, fastest = self._rebound(jnp.where(touches, u, 0.0)[:contacts], rows.rounding[:contacts], state.fastest)
        # Impulses change u as forces change u̇, with the velocity after the impact in the place of rest.
        law = rows.law._replace(rest=u - jnp.append(rebound, jnp.zeros(u.size - contacts, u.dtype)))
        none = jnp.zeros_like(u)
        pushes = Limits(none, jnp.full_like(u, jnp.inf), none)
        rounding = rows.rounding / without_derivatives(jnp.diagonal(law.matrix))
        hit = choose(law, pushes, jnp.where(touches, 0.0, 1.0), touches, rounding)
        impulse = amounts(law, hit, none)
        qdot, change = motion.qdot + apply(rows.pull, impulse), apply(law.matrix, impulse)
        # The work of the impulses, by the mean velocity.
        loss = -0.5 * jnp.sum(impulse * apply(rows.matrix, motion.qdot + qdot))
        after = dataclasses.replace(
            state, motion=LagrangianState(motion.q, qdot), fastest=fastest, impact_loss=state.impact_loss + loss
        )
        slow, unchanged = jnp.abs(u + change) <= rows.rounding, jnp.abs(change) <= rows.rounding
        stays = (hit == 0) & (jnp.append(rebound, none[contacts:]) == 0)
        still = jnp.where(is_contact, touches & (stays | slow), slow | unchanged & (here | held))
        return Impact(after, still)

    def _rebound(
        self, u: Float[Array, " contacts"], rounding: Float[Array, " contacts"], fastest: Float[Array, " contacts"]
    ) -> tuple[Float[Array, " contacts"], Float[Array, " contacts"]]:
        """Computes the rates of gaps after an impact, and the fastest approaches so far."""
        sizes, contacts = self.system.row_sizes()[0], self.system.unilateral
        e, slowest = (repeat((getattr(x, name) for x in contacts), sizes) for name in ("restitution", "slowest"))
        approach = without_derivatives(-u)
        strikes, fastest = approach > rounding, jnp.maximum(fastest, approach)
        rebounds = strikes & (without_derivatives(e) * approach > slowest * fastest)
        return jnp.where(rebounds, -e * u, 0.0), fastest

    # What is known of the motion.

    def laws(self, t: Float[Array, ""], state: RowsState) -> Any:
        """Returns those of the system, with the energy that dry friction and impacts have taken added to its own."""
        laws = self.system.laws(t, state.motion)
        return laws._replace(energy=laws.energy + state.friction_loss + state.impact_loss)

    def law_rates(self, t: Float[Array, ""], state: RowsState) -> Mapping[str, Float[Array, "..."]]:
        """Computes Ė of both together: what walls and belts that move do, too."""
        rows = rows_in_state(self.system, t, state.motion)
        z = amounts(rows.law, state.mode, limits_of(self.system).level)
        terms = AbstractLagrangianSystem.equations(self.system, t, state.motion)
        _, multipliers = terms._replace(force=terms.force + apply(rows.matrix.T, z)).solve()
        drift = rows.velocities - apply(rows.matrix, state.motion.qdot)
        return {"energy": self.system.power(t, state.motion, multipliers) - jnp.sum(z * drift)}

    # What a run shows.

    @property
    def shown(self) -> Any:
        return self.system

    def state_to_show(self, state: RowsState) -> LagrangianState:
        return state.motion

    def history(self, times: Float[Array, " T"], states: RowsState, record: Record | None) -> RowHistory:
        assert record is not None
        before, after = record.before, record.after
        switches = RowSwitches.of(
            record,
            before=before.motion,
            after=after.motion,
            mode_before=before.mode,
            mode_after=after.mode,
            lost=after.impact_loss - before.impact_loss,
            rows=self.system.rows,
            contacts=self.contacts,
        )
        losses = {"friction_loss": states.friction_loss, "impact_loss": states.impact_loss}
        return RowHistory(switches=switches, mode=states.mode, **losses)
