"""The interface between a solve and a system with modes: steps within a mode, transitions, and the switches of a run.

In the terms of hybrid systems (R. Goebel, R. G. Sanfelice, A. R. Teel, Hybrid dynamical systems, Princeton University
Press 2012), the state flows along a field while all guards are positive. Where one of them falls to zero there is an
event, and a reset map takes the state before it to the state after it. The time of an event is a function of the start
and of all parameters, and has their derivatives, so that later derivatives are those of the saltation matrix.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..interface.printing import Printed, format_value, is_single
from ..numerics.arrays import entry
from ..numerics.calculus import move, move_to_zero, rates_along, with_second_derivatives
from ..numerics.kinks import after
from ..programs.derivatives.differentiation import without_derivatives

# Events that no guard stands for. Those of guards, and the causes that a system gives them, are 0 and more.
NONE = -1  # no event
START = -2  # the start of a run
WINDOW = -3  # the end of the time for which a system knew beforehand how it begins to move
ZERO_GUARD = 1e-6  # a guard below this part of its size in a step is zero
SOON = 16  # in units of rounding of the time: only the shortest of steps ends so soon after a kink
MOST_SWITCHES_SHOWN = 8  # switches in a summary; `lines` of the switches has all


class Accuracy(NamedTuple):
    """How accurate a solve is: its tolerances, and the ``order`` of the errors that its method sees.

    Close to a singularity of the solution, such as the end of a slip, a step takes at most the part ``approach`` of the
    time that is left.
    """

    rtol: Float[Array, ""]
    atol: Float[Array, ""]
    order: float
    approach: float

    @property
    def tolerance(self) -> Float[Array, ""]:
        """The larger of the tolerances."""
        return jnp.maximum(self.rtol, self.atol)


class GuardedStep(NamedTuple):
    """A step within a mode, as a solve has just taken it.

    - ``start``, ``end``: the times.
    - ``state``: the state at its end.
    - ``reference``: the result of ``step_reference`` at its start.
    - ``guards``: at its start and at its end; ``largest``: the largest size of each within it.
    - ``zero``: the guard that is zero at the end, or ``NONE``; ``size``: the size of that guard in the step.
    - ``timed``: whether it ends at a time event.
    """

    start: Float[Array, ""]
    end: Float[Array, ""]
    state: Any
    reference: Any
    guards: Float[Array, "k ends"]
    largest: Float[Array, " k"]
    zero: Int[Array, ""]
    size: Float[Array, ""]
    timed: Bool[Array, ""]

    @property
    def has_fallen(self) -> Bool[Array, ""]:
        """Whether that guard is zero, which an interpolation may only seem to show, or below, where it has jumped, as
        at the start of a push.
        """
        return (self.zero != NONE) & (entry(self.zero, self.guards[:, -1]) <= ZERO_GUARD * self.size)


class Assessment(NamedTuple):
    """The ``event`` at the end of a step, or ``NONE``, and the ``longest`` next step."""

    event: Int[Array, ""]
    longest: Float[Array, ""]


class Transition(NamedTuple):
    """What happens at an event: its time, the states before and after it.

    - ``event``: as it is recorded.
    - ``slope``: the rate of the guard, by which it is seen whether that touches zero rather than crossing it; infinite
      without a guard.
    - ``switches``: whether it counts as a switch. ``crowds``: whether too many of these in a row in almost no time end
      the run.
    - ``pauses``: whether the steps before it were short because of it, and say nothing about the next.
    - ``status``: a ``Status``, ``SUCCESS`` unless nothing can follow.
    """

    t: Float[Array, ""]
    before: Any
    after: Any
    event: Int[Array, ""]
    slope: Float[Array, ""]
    switches: Bool[Array, ""]
    crowds: Bool[Array, ""]
    pauses: Bool[Array, ""]
    status: Int[Array, ""]


def at_zero(
    guards: Callable[..., Float[Array, " k"]],
    system: Any,
    t: Float[Array, ""],
    state: Any,
    which: Int[Array, ""],
    applies: Bool[Array, ""] | bool = True,
    reference: tuple[Any, ...] = (),
) -> tuple[Float[Array, ""], Any, Float[Array, ""]]:
    """Computes the time and the state at the zero of guard ``which`` that is next to nothing away, and the rate of the
    guard.

    By one step of Newton's method along the field of the system, which changes next to nothing, but has the first
    derivatives of the zero; its second ones are those of two steps. Where it does not apply or there is no such guard,
    time and state are unchanged. Just after a kink, where the guard has jumped, the time has the derivative of the
    kink, and the rate is infinite.

    - ``guards``: of the system, time, state, and what else the ``reference`` holds, which has no derivatives.
    """
    # The length of the step is zero up to rounding, so derivatives of the rates, which it multiplies, would not matter.
    still, t0, x0 = without_derivatives((system, t, state))
    rates = still.field(t0, x0)
    _, slopes = rates_along(lambda t, state: guards(still, t, state, *reference), t0, x0, rates)
    values, slope = guards(system, t, state, *reference), entry(which, slopes)
    applies &= (which >= 0) & (which < values.shape[0])
    jumped, late = _after_kink(system.driving_kinks().astype(t.dtype), t0)
    crosses = applies & ~jumped & (slope != 0)
    shift = jnp.where(crosses, -entry(which, values) / jnp.where(crosses, slope, 1.0), 0.0)
    moved = move(t, state, rates, jnp.where(applies & jumped, late, shift))
    crossing = _Crossing(which, jnp.where(crosses, slope, 0.0), applies & jumped)
    operands = guards, system, t, state, reference, crossing
    moved = with_second_derivatives(moved, "runs whose modes change", _at_zero, *operands)
    return *moved, jnp.where(applies & ~jumped, slope, jnp.inf)


class _Crossing(NamedTuple):
    """How the guard ``which`` falls to zero: with a ``slope``, 0 if it does not, or because it has ``jumped``."""

    which: Int[Array, ""]
    slope: Float[Array, ""]
    jumped: Bool[Array, ""]


def _at_zero(
    guards: Callable[..., Float[Array, " k"]],
    system: Any,
    t: Float[Array, ""],
    state: Any,
    reference: tuple[Any, ...],
    crossing: _Crossing,
) -> tuple[Float[Array, ""], Any]:
    """Computes the time and the state of :func:`at_zero` with their second derivatives."""

    def value(t: Float[Array, ""], state: Any) -> Float[Array, ""]:
        return entry(crossing.which, guards(system, t, state, *reference))

    _, late = _after_kink(system.driving_kinks().astype(t.dtype), jax.lax.stop_gradient(t))
    return move_to_zero(system.field, value, t, state, crossing.slope, jnp.where(crossing.jumped, late, 0.0))


def _after_kink(kinks: Float[Array, " kinks"], t: Float[Array, ""]) -> tuple[Bool[Array, ""], Float[Array, ""]]:
    """Returns whether a time follows a kink as closely as a step can end, and a zero with the derivative of
    that kink.
    """
    if not kinks.size:
        return jnp.zeros_like(t, bool), jnp.zeros_like(t)
    fixed = jax.lax.stop_gradient(kinks)
    here = (fixed <= t) & (t <= after(fixed) + SOON * float(jnp.finfo(t.dtype).eps) * jnp.abs(t))
    number = jnp.sum(jnp.where(here, 1.0, 0.0))
    # ``kinks − fixed`` is zero, with the derivatives of the kinks; of several at the same time, the mean is taken.
    return jnp.any(here), jnp.sum(jnp.where(here, kinks - fixed, 0.0)) / jnp.maximum(number, 1.0)


class Record(NamedTuple):
    """The switches of a run as a solve keeps them, the first ones in the order of time; unused rows have the time NaN.

    ``number`` is how many there were, and ``grazing`` says that a guard touched zero rather than crossing it.
    """

    number: Int[Array, ""]
    times: Float[Array, "*switches"]
    event: Int[Array, "*switches"]
    before: Any
    after: Any
    grazing: Bool[Array, "*switches"]


STIFF = (
    "where friction all but holds a body its direction turns in a time that shrinks with its speed; an implicit solver "
    "follows it, RadauIIA(3) of jaxball.simulation.solvers, which is `radau5` in files."
)
SLOW_ROLLING = f"The body moves against exact dry resistance. Slow rolling is stiff: {STIFF}"


class AbstractHistory(Printed):
    """What a run records besides its states at the saved times: the switches from mode to mode.

    An implementer supplies ``switches``, with at least ``count``, ``times``, ``before``, ``after`` and ``grazing``. All
    else has a default, that of a system without quantities of its own. Files, figures, views and studies ask for these
    and do not depend on the kind of a history. ``described`` says what the modes are, after "with", ``restarts``
    whether the motion after any saved time follows from the state there, and ``always_rolls`` that there is no mode but
    rolling.
    """

    described: ClassVar[str] = "modes"
    restarts: ClassVar[bool] = True
    always_rolls: ClassVar[bool] = False

    if TYPE_CHECKING:  # to a type checker, a field declared here would be an argument of all
        switches = cast(Any, None)
    else:
        switches: eqx.AbstractVar[Any]

    @property
    def of_body(self) -> "AbstractHistory":
        """The history of the body's own modes, which others have beside what they record."""
        return self

    @property
    def over_time(self) -> dict[str, Array]:
        """Quantities at the saved times, by name, with the times as leading axis."""
        return {}

    @property
    def coefficients(self) -> dict[str, Array]:
        """The coefficients ``friction`` and ``static_friction`` between a body and its plane, if a law has them."""
        return {}

    @property
    def lines(self) -> list[str]:
        """The history in words, of one trajectory."""
        return []

    @property
    def advice(self) -> str:
        """A sentence on what is slow in a run that had no steps left, and what helps, of one trajectory; or empty."""
        return ""

    def at_rows(self, rows: slice) -> "AbstractHistory":
        """Returns the history at some of the saved times, with all switches."""
        return self


class Switches(Printed):
    """The events of a run at which the mode of a system changed, in the order of time.

    - ``count``: how many there were. The arrays hold the first ``max_switches`` of the system; where there are fewer,
      the rest is NaN or −1.
    - ``times``: when, shape (max_switches,).
    - ``event``: the index of the guard that fell to zero, or the number of guards for a time event,
      shape (max_switches,).
    - ``before``, ``after``: the states before and after the reset, with a leading axis.
    - ``grazing``: whether the guard touched zero rather than crossing it, so that derivatives mean little,
      shape (max_switches,).

    Times and states are differentiable.
    """

    count: Int[Array, "*batch"]
    times: Float[Array, "*batch switches"]
    event: Int[Array, "*batch switches"]
    before: Any
    after: Any
    grazing: Bool[Array, "*batch switches"]

    @classmethod
    def of(cls, record: Record, **others: Any) -> Any:
        """Returns the switches of one run, or of several as a leading axis; ``others`` are further fields, by name."""
        is_switch = jnp.isfinite(record.times)
        fields = {"before": record.before, "after": record.after} | others
        event = jnp.where(is_switch, record.event, NONE)
        return cls(count=record.number, times=record.times, event=event, grazing=record.grazing & is_switch, **fields)

    def __repr__(self) -> str:
        return (
            "\n".join(["Switches", *(f"  {line}" for line in self.lines)])
            if is_single(self.count)
            else format_value(self)
        )

    @property
    def lines(self) -> list[str]:
        """A line for each switch that was kept. For one trajectory, not for a batch."""
        count, capacity = int(self.count), self.times.shape[-1]
        times, grazing = (np.asarray(column)[:count] for column in (self.times, self.grazing))
        lines = [
            f"t = {float(t):.10g}: {self.words(k)}{', grazing' if grazing[k] else ''}" for k, t in enumerate(times)
        ]
        return [*lines, *([f"{count - capacity} more, {self.remedy}"] if count > capacity else [])] or ["none"]

    @property
    def first_lines(self) -> list[str]:
        """The first of ``lines``, indented, and how many more there are; none without a switch."""
        count, lines = int(self.count), self.lines
        shown = lines[:MOST_SWITCHES_SHOWN] if count else []
        more = [f"and {count - len(shown):,} more"] if count > len(shown) else []
        return [f"  {line}" for line in (*shown, *more)]

    @property
    def how_often(self) -> str:
        """``once``, ``12 times``."""
        count = int(self.count)
        return "once" if count == 1 else f"{count:,} times"

    def words(self, k: int) -> str:
        """Describes the event at switch ``k``."""
        return f"event {int(np.asarray(self.event)[k])}"

    @property
    def remedy(self) -> str:
        """How to keep more of them."""
        return "which a larger `max_switches` of the system would keep"


class History(AbstractHistory):
    """The history of a system with guards: its ``switches``."""

    switches: Switches

    @property
    def lines(self) -> list[str]:
        changed = f"switched {self.switches.how_often}" if int(self.switches.count) else "never switched"
        return [f"its mode {changed}", *self.switches.first_lines]


class NoHistory(AbstractHistory):
    """The history of a system without modes."""

    always_rolls: ClassVar[bool] = True

    @property
    def switches(self) -> Switches:
        none, no = jnp.zeros((0,)), jnp.zeros((0,), bool)
        return Switches(jnp.asarray(0), none, none.astype(int), None, None, no)


NO_HISTORY = NoHistory()
