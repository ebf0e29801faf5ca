"""Finds where in a solve the mode of a system ends, and continues the solve in the next mode, for the ``loop``.

Each step is checked as soon as it is taken. Where one of the guards, which are positive while the mode lasts, falls to
zero within it, the step is rejected, and the search of :mod:`mode_ends` begins. The next step begins with the state
after the reset.

Guards are found like events: by the interpolation of a step, in pieces so short that each guard is followed. That holds
for steps of any length, as those of a body at rest are, whose guards may depend on the time all the same.
"""

import functools
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..interface.status import Status
from ..numerics.arrays import select_tree
from ..numerics.kinks import before_kink
from ..numerics.pieces import Span
from ..physics.hybrid import NONE, START, Accuracy, GuardedStep, Record, Transition
from ..physics.packing import Packing
from ..programs.derivatives.differentiation import without_derivatives
from ..programs.derivatives.reverse_rules import CarryOut, PullByForwardMode, put
from .mode_ends import LEAST_LENGTH, SHORTER, Look, RootBracket, bracket_zero, is_too_quick, look_at
from .solvers.dense.crossings import Functions

GRAZING = 1e-6  # a guard that falls by less than this part of its size in a step touches zero
CLOSE_SWITCHES = 1e-9  # switches closer to each other than this part of a run are counted as crowded
TOO_MANY = 64  # crowded switches


class Rows(NamedTuple):
    """The switches that are kept, as vectors, or one of them; unused rows have the time NaN."""

    times: Float[Array, "*capacity"]
    event: Int[Array, "*capacity"]
    before: Float[Array, "*capacity size"]
    after: Float[Array, "*capacity size"]
    grazing: Bool[Array, "*capacity"]

    @classmethod
    def empty(cls, capacity: int, y: Float[Array, " size"]) -> "Rows":
        """Makes room for ``capacity`` switches."""
        vectors, no = jnp.zeros((capacity, y.size), y.dtype), jnp.zeros(capacity, bool)
        return cls(jnp.full(capacity, jnp.nan, y.dtype), jnp.zeros(capacity, int), vectors, vectors, no)

    def with_row(self, k: Int[Array, ""], switch: "Rows") -> "Rows":
        """Returns the rows with a switch in row ``k``, if there is one."""
        there = k < self.times.shape[0]
        return Rows(*(put(column, k, new, there) for column, new in zip(self, switch, strict=True)))


class HybridCarry(NamedTuple):
    """What a solve carries from step to step of a system with modes.

    - ``event``: the event at the end of the last step, ``START`` before the first, or ``NONE``.
    - ``size``: the size of the guard that fell to zero there.
    - ``due``: the time of the next time event.
    - ``length``: of the longest step that no event cut short.
    - ``piece``: of the last piece in which guards were looked at.
    - ``begun``: the vector with which the first mode began.
    - ``switches``: how many there have been.
    - ``crowd``: how many in a row were too near to each other, ``last`` the time of the last.
    - ``status``: not ``SUCCESS`` where no mode can follow.
    - ``rows``: the switches that are kept; None where they are elsewhere.
    """

    bracket: RootBracket
    event: Int[Array, ""]
    size: Float[Array, ""]
    due: Float[Array, ""]
    length: Float[Array, ""]
    piece: Float[Array, ""]
    begun: Float[Array, " size"]
    switches: Int[Array, ""]
    crowd: Int[Array, ""]
    last: Float[Array, ""]
    status: Int[Array, ""]
    rows: Rows | None


class NextStep(NamedTuple):
    """The next step, as it is proposed: whether the last one is kept, start and end, the memory of the controller.

    ``exact`` says that it must end just there, so that nothing may round its end to that of the run.
    """

    keep: Bool[Array, ""]
    start: Float[Array, ""]
    end: Float[Array, ""]
    memory: Any
    exact: Bool[Array, ""]


Vectors = Callable[[Float[Array, " m"]], Float[Array, "m size"]]


class Taken(NamedTuple):
    """A step that was taken, from ``start`` to ``end``, and from the vector ``before`` to ``after``.

    - ``sketch``: the vectors at times within it, at no cost; ``exact``: as accurate as the step, where they are asked
      for. Both are a PyTree.
    - ``memory``: that of the controller.
    - ``run``: when the run starts and ends.
    """

    start: Float[Array, ""]
    end: Float[Array, ""]
    before: Float[Array, " size"]
    after: Float[Array, " size"]
    sketch: Vectors
    exact: Callable[[Bool[Array, ""]], Vectors]
    memory: Any
    run: tuple[Float[Array, ""], Float[Array, ""]]

    @property
    def span(self) -> Span:
        """Its times."""
        return Span(self.start, self.end, self.run)

    def between_ends(self, times: Float[Array, " m"], vectors: Float[Array, "m size"]) -> Float[Array, "m size"]:
        """Returns the ``vectors`` at times within it, with those that are known in the place of the ones at its
        ends.
        """
        within = jnp.where((times > self.start)[:, None], vectors, self.before)
        return jnp.where((times < self.end)[:, None], within, self.after)


class Reset(NamedTuple):
    """The vectors before and after a reset, at the same time, and whether it ``happened``."""

    before: Float[Array, " size"]
    after: Float[Array, " size"]
    happened: Bool[Array, ""] | bool


class BetweenSteps(eqx.Module):
    """What a solve does between its steps: nothing, where its system has no modes.

    ``args`` are the parameters of a solve.
    """

    jumps: ClassVar[bool] = False  # whether the field may jump from one step to the next

    def init(self, t0: Float[Array, ""], y0: Float[Array, " size"], length: Float[Array, ""]) -> Any:
        """Returns the carry before the first step, of this length."""
        return ()

    def count_moving(self, y0: Float[Array, " size"], args: Any) -> int:
        """Returns how many entries of a vector, the first ones, change otherwise than at events."""
        return y0.size

    def goes_on(self, carry: Any) -> Bool[Array, ""] | bool:
        """Returns whether a mode can follow."""
        return True

    def with_event_if(self, counts: Bool[Array, ""], carry: Any) -> Any:
        """Returns the carry without an event unless it ``counts``."""
        return carry

    def apply_reset(
        self,
        carry: Any,
        step: NextStep,
        y: Float[Array, " size"],
        run: tuple[Array, Array],
        args: Any,
        carry_out: CarryOut,
    ) -> tuple[Any, NextStep, Reset]:
        """Returns the next step from the state after an event, if there was one; ``run`` is from start to end."""
        return carry, step, Reset(y, y, False)

    def detect(self, carry: Any, taken: Taken, proposed: NextStep, args: Any) -> tuple[Any, NextStep]:
        """Returns the next step in view of the guards in the one taken, which may be rejected."""
        return carry, proposed

    def first(self, carry: Any, y0: Float[Array, " size"]) -> Float[Array, " size"]:
        """Returns the vector with which the run began."""
        return y0

    def record(self, carry: Any) -> Any:
        """Returns the record in which a program writes a row in a step, and reads none."""
        return ()

    def outcome(self, carry: Any, status: Int[Array, ""], packing: Packing) -> tuple[Int[Array, ""], Any]:
        """Returns the status at the end of a solve, and the switches as a :class:`Record` of states."""
        return status, None


class Switching(BetweenSteps):
    """Of a hybrid system; ``unpack`` takes the parameters of a solve apart, the first of which is a packing.

    ``capacity`` is how many switches are kept.
    """

    accuracy: Accuracy
    unpack: Any = eqx.field(static=True)
    capacity: int = eqx.field(static=True)

    jumps: ClassVar[bool] = True

    def init(self, t0, y0, length):
        # Where steps end is a choice: only the transition gives the time of an event its derivatives.
        t0, length = jax.lax.stop_gradient((t0, length))
        none, success = jnp.asarray(0), jnp.asarray(int(Status.SUCCESS))
        zero, never, bracket = jnp.zeros_like(t0), jnp.full_like(t0, jnp.inf), RootBracket.none(t0)
        rows = Rows.empty(self.capacity, y0)
        return HybridCarry(bracket, jnp.asarray(START), zero, never, length, never, y0, none, none, t0, success, rows)

    def count_moving(self, y0, args):
        packing = self._packing(args)
        kept = jax.tree.leaves(packing.system.kept_in_modes(packing.unravel(y0)))
        return y0.size - sum(leaf.size for leaf in kept)

    def goes_on(self, carry):
        return carry.status == int(Status.SUCCESS)

    def first(self, carry, y0):
        return carry.begun

    def record(self, carry):
        return carry.rows

    def outcome(self, carry, status, packing):
        def unpack_row(row: Rows) -> Record:
            finite = jnp.isfinite(row.times)
            t = jnp.where(finite, row.times, 0.0)
            before, after = (packing.unpack_where(finite, t, vector) for vector in (row.before, row.after))
            return Record(carry.switches, row.times, row.event, before, after, row.grazing)

        record = jax.lax.map(unpack_row, carry.rows)._replace(number=carry.switches)
        return jnp.where(carry.status == int(Status.SUCCESS), status, carry.status), record

    # Events.

    def with_event_if(self, counts, carry):
        return carry._replace(event=jnp.where(counts, carry.event, NONE))

    def apply_reset(self, carry, step, y, run, args, carry_out):
        # Its searches are loops of any length, which only have forward mode: reverse mode pulls it back by that.
        happened, transition = carry.event != NONE, functools.partial(_transition, self.unpack)
        operands = step.start, y, args, carry.event, self.accuracy
        pull = PullByForwardMode(transition, lambda operands: operands[3] != NONE)
        done = Transition(*carry_out(transition, pull, operands))

        def reset(carry: HybridCarry) -> _AfterReset:
            return self._reset(carry, done, run[1] - run[0], args)

        def go_on(carry: HybridCarry) -> _AfterReset:
            nothing = Rows(step.start, carry.event, y, y, jnp.asarray(False))
            return _AfterReset(carry, step.start, y, step.start, jnp.asarray(self.capacity), nothing)

        bare = carry._replace(rows=None)
        # The rows stay outside of the branch, which would copy all of them to write one.
        carry_after, t, y, earliest, row, switch = jax.lax.cond(happened, reset, go_on, bare)
        carry = carry_after._replace(rows=carry.rows.with_row(row, switch), due=self._due(t, y, args))
        end = jnp.minimum(jnp.maximum(step.end, earliest), jnp.minimum(carry.due, run[1]))
        return carry, step._replace(start=t, end=end), Reset(switch.before, y, happened)

    def _due(self, t: Float[Array, ""], y: Float[Array, " size"], args: Any) -> Float[Array, ""]:
        packing = self._packing(args)
        time = packing.system.time_event(t, packing.unpack(t, y))
        return jnp.where(time > t, time, jnp.inf)

    def _reset(self, carry: HybridCarry, done: Transition, run: Float[Array, ""], args: Any) -> "_AfterReset":
        """Returns the carry and the next step after an event that has been ``done``, in a run of the length ``run``."""
        t, after, switches, starts = done.t, done.after, done.switches, carry.event == START
        fixed = jax.lax.stop_gradient(t)
        # A mode that ends again and again in almost no time would take all steps of the run.
        crowded = switches & done.crowds & (fixed - carry.last <= CLOSE_SWITCHES * run)
        crowd = jnp.where(crowded, carry.crowd + 1, jnp.where(switches, 0, carry.crowd))
        status = jnp.where(crowd > TOO_MANY, int(Status.CHATTERED), carry.status)
        status = jnp.where(done.status == int(Status.SUCCESS), status, done.status)
        # The row behind the last one stands for none.
        row = jnp.where(switches, carry.switches, self.capacity)
        grazing = jnp.abs(done.slope) * carry.length <= GRAZING * carry.size
        switch = Rows(t, done.event, done.before, after, grazing)
        # The least length of the next step. After a pause it is that of the longest step before, because those just
        # before the pause were short only because of it.
        least = LEAST_LENGTH * float(jnp.finfo(fixed.dtype).eps) * jnp.abs(fixed)
        length = jnp.where(done.pauses, carry.length, least)
        kinks = jax.lax.stop_gradient(self._packing(args).system.driving_kinks())
        carry = carry._replace(
            event=jnp.asarray(NONE),
            begun=jnp.where(starts, after, carry.begun),
            switches=carry.switches + jnp.where(switches, 1, 0),
            crowd=crowd,
            last=jnp.where(switches, fixed, carry.last),
            status=status,
        )
        return _AfterReset(carry, t, after, before_kink(kinks, fixed, fixed + length), row, switch)

    # Detection.

    def detect(self, carry, taken, proposed, args):
        def look(carry: HybridCarry) -> _Detection:
            return self._detect(carry, taken, args)

        def pass_by(carry: HybridCarry) -> _Detection:
            no, end = jnp.zeros_like(taken.end, bool), taken.end
            return _Detection(carry._replace(bracket=RootBracket.none(end)), no, end, jnp.full_like(end, jnp.inf))

        bare = carry._replace(rows=None)
        # Guards cost several evaluations of the field, and those of a step that the controller rejects tell nothing.
        detection, rejected, target, longest = jax.lax.cond(proposed.keep, look, pass_by, bare)
        start = jnp.where(rejected, taken.start, proposed.start)
        end = jnp.where(longest < proposed.end - start, start + longest, proposed.end)
        following = NextStep(
            keep=proposed.keep & ~rejected,
            start=start,
            end=jnp.where(rejected, target, end),
            memory=select_tree(rejected, taken.memory, proposed.memory),
            exact=rejected,
        )
        return detection._replace(rows=carry.rows), following

    def _detect(self, carry: HybridCarry, attempt: Taken, args: Any) -> "_Detection":
        """Detects whether the step ends too late for an event, and else whether there is one at its end."""
        # Where a step ends is only looked for here: the transition gives the time of the event its derivatives.
        attempt, args, accuracy = without_derivatives((attempt, args, self.accuracy))
        start, end, span = attempt.start, attempt.end, attempt.span
        packing, bracket = self._packing(args), carry.bracket
        system = packing.system
        reference = system.step_reference(start, packing.unpack(start, attempt.before), accuracy)
        look = self._look(attempt, args, reference, bracket, carry.piece)
        rejected, following = bracket_zero(bracket, start, end, look)
        at_target = bracket.on & (end == bracket.target)
        quick = ~at_target & is_too_quick(look, span)
        zero = jnp.where(at_target & ~rejected, bracket.which, NONE)
        guards, state = jnp.stack([look.first, look.last], axis=1), packing.unpack(end, attempt.after)
        step = GuardedStep(start, end, state, reference, guards, look.size, zero, bracket.size, end == carry.due)
        event, longest = system.assess(step, accuracy)
        rejected |= quick
        carry = carry._replace(
            bracket=following,
            event=jnp.where(rejected, NONE, event),
            size=bracket.size,
            piece=jnp.where(rejected, carry.piece, look.piece),
            # A step that an event cut short says nothing about the scale of the motion.
            length=jnp.where(rejected | at_target, carry.length, jnp.maximum(carry.length, end - start)),
        )
        target = jnp.where(quick, start + SHORTER * (end - start), following.target)
        return _Detection(carry, rejected, target, jnp.where(rejected, jnp.inf, longest))

    def _look(self, attempt: Taken, args: Any, reference: Any, bracket: RootBracket, piece: Float[Array, ""]) -> Look:
        """Looks at the guards within a step, of which one is zero in a ``bracket``, after a ``piece`` of this length.

        ``reference``: what they refer to.
        """

        @jax.jit
        def guards_at(times: Float[Array, " n"], vectors: Float[Array, "n size"]) -> Float[Array, "n k"]:
            packing = self._packing(args)  # here, because a loop takes few operands faster than many

            def at(t: Float[Array, ""], x: Float[Array, " size"]) -> Float[Array, " k"]:
                return packing.system.guards_in_step(t, packing.unpack(t, x), reference)

            return without_derivatives(jax.vmap(at)(times, vectors))

        def along(vectors: Vectors) -> Functions:
            return lambda times: guards_at(times, attempt.between_ends(times, vectors(times)))

        count = jax.eval_shape(guards_at, attempt.start[None], attempt.before[None]).shape[1]
        sketch, exact = along(attempt.sketch), lambda asked: along(attempt.exact(asked))
        packing = self._packing(args)
        whole = packing.system.guards_follow_motion(attempt.start, packing.unravel(attempt.before), reference)
        return look_at(sketch, exact, attempt.span, bracket, piece, count, whole=whole)

    def _packing(self, args: Any) -> Packing:
        return self.unpack(args)[0]


def _transition(unpack: Callable[[Any], Any], operands: tuple[Array, Array, Any, Array, Accuracy]) -> list[Array]:
    """Computes the :class:`Transition` at an event, with vectors in the place of states; zeros if there is none."""

    @jax.jit
    def transition(t: Array, y: Array, args: Any, event: Array, accuracy: Accuracy) -> list[Array]:
        packing = unpack(args)[0]
        done = packing.system.transition(t, packing.unpack(t, y), event, accuracy)
        before, after = (packing.pack(done.t, state) for state in (done.before, done.after))
        return list(done._replace(before=before, after=after))

    def nothing(*operands: Any) -> list[Array]:
        return [jnp.zeros(x.shape, x.dtype) for x in jax.eval_shape(transition, *operands)]

    return jax.lax.cond(operands[3] != NONE, transition, nothing, *operands)


class _AfterReset(NamedTuple):
    """Where the next step begins, and the ``earliest`` end that it has, with a switch for a ``row``."""

    carry: HybridCarry
    t: Float[Array, ""]
    y: Float[Array, " size"]
    earliest: Float[Array, ""]
    row: Int[Array, ""]
    switch: Rows


class _Detection(NamedTuple):
    """The fate of a step that the controller would accept: ``rejected``, for one that ends at ``target``, or accepted.

    ``longest`` is the longest next step.
    """

    carry: HybridCarry
    rejected: Bool[Array, ""]
    target: Float[Array, ""]
    longest: Float[Array, ""]
