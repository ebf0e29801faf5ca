"""The events that a run looks for, such as that the ball slips or a function crosses zero, and their occurrences.

``watch`` finds them in the loop of a solve.
"""

import abc
import inspect
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, cast

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..interface.arguments import require, require_callable, require_flags, traceable
from ..interface.compat import is_traced
from ..interface.printing import Printed, format_value, is_single
from ..interface.status import Status
from ..numerics.declare import number
from ..physics.contact.body_on_plane import has_contact
from ..physics.contact.modes import ContactState, Mode
from ..physics.dynamics.footing import room_on_ground
from ..physics.limits.confinement import clearance_of_all
from ..physics.rolling import AbstractRollingSystem, Reaction
from ..physics.system import AbstractSystem
from ..programs.derivatives.differentiation import without_derivatives
from .quantities import observables_of, quantity


class Occurrences(Printed):
    """The occurrences of one event in a run, in the order of time.

    - ``count``: how many there were.
    - ``times``: when, shape (capacity,); NaN where there are fewer.
    - ``state``: the states then; each of its arrays has ``capacity`` as leading axis.
    - ``least``, ``largest``: the extreme values of the event's function, where the solve evaluated it.
    - ``unresolved``: in how many parts of steps the function changed too quickly to be followed, in each of which
      occurrences may have been missed.

    Times and states are differentiable, the others are not.
    """

    count: Int[Array, "*batch"]
    times: Float[Array, "*batch capacity"]
    state: Any
    least: Float[Array, "*batch"]
    largest: Float[Array, "*batch"]
    unresolved: Int[Array, "*batch"]

    def __repr__(self) -> str:
        return f"Occurrences: {self.message}" if is_single(self.count) else format_value(self)

    @property
    def message(self) -> str:
        """A sentence on how often it happened. For one trajectory, not for a batch."""
        count, capacity, unresolved = int(self.count), self.times.shape[-1], int(self.unresolved)
        span = f"was between {float(self.least):.6g} and {float(self.largest):.6g}"
        if unresolved:
            places = "one part of a step" if unresolved == 1 else f"{unresolved} parts of steps"
            how_often = "once" if count == 1 else f"{count} times"
            return (
                f"It was seen {how_often}, but more may have been missed: its function, which {span}, changed too "
                f"quickly in {places} to be followed."
            )
        if count == 0:
            # Of one that has both signs, the crossings were in the other direction.
            which = " in the direction asked for" if float(self.least) < 0 < float(self.largest) else ""
            return f"It never happened: its function {span}, and did not cross zero{which}."
        first = f"first at t = {float(np.asarray(self.times)[0]):.10g}"
        if count == 1:
            return f"It happened once, at t = {float(np.asarray(self.times)[0]):.10g}."
        if count <= capacity:
            return f"It happened {count} times, {first}."
        note = f"the first {capacity} are kept, and a larger `capacity` would keep more"
        return f"It happened {count} times, {first}; {note}."


UP, DOWN, EITHER = 1, -1, 0


class AbstractEvent(Printed):
    """Something that happens where a function of time and state crosses zero.

    - ``direction``: 1 if it happens only where the function rises, −1 if only where it falls, 0 for both.
    - ``terminal``: whether it ends the run.
    - ``from_start``: whether it counts as having happened in a run that starts beyond zero.
    - ``capacity``: how many of its times and states are kept; all are counted.
    - ``status``: the status of a run that it ended.
    """

    if TYPE_CHECKING:  # to a type checker, fields declared here would come before `of` among the arguments
        direction, terminal, capacity = cast(int, None), cast(bool, None), cast(int, None)
    else:
        direction: eqx.AbstractVar[int]
        terminal: eqx.AbstractVar[bool]
        capacity: eqx.AbstractVar[int]
    from_start: ClassVar[bool]
    status: ClassVar[Status]

    def __check_init__(self):
        require_flags(terminal=self.terminal)
        if self.direction not in (UP, DOWN, EITHER):
            raise ValueError(f"Argument `direction` must be 1, -1 or 0, but it is {self.direction}.")
        if self.capacity < 1:
            raise ValueError(f"Argument `capacity` must be 1 or more, but it is {self.capacity}.")

    @abc.abstractmethod
    def value(self, system: Any, t: Float[Array, ""], state: Any) -> Float[Array, ""]:
        """Evaluates the function that crosses zero."""

    def value_in_solve(self, system: Any, t: Float[Array, ""], state: Any) -> Float[Array, ""]:
        """Evaluates the event's function for a system and its state as they are solved, with modes if the system has
        any.
        """
        return self.value(system.shown, t, system.state_to_show(state))


class Event(AbstractEvent):
    """A position reached, an angle at a bound, a Poincaré section: wherever ``of(system, t, state)`` crosses a level.

    **Arguments:**

    - ``of``: a scalar function, written with ``jax.numpy``. If it has a fourth parameter that is called
      ``observables``, it is given those of that time, as ``run.observables`` has them. One that is written
      anew at each call compiles again unless it only uses equal numbers. Or the name of a number of the run: an
      observable, such as ``"normal_force"``, a component of the state, such as ``"z[0]"``, or of another system one of
      its laws.
    - ``direction``: 1 for upward crossings only, −1 for downward ones, 0 for both.
    - ``terminal``: whether the first crossing ends the run.
    - ``capacity``: how many crossings are kept; all are counted.
    - ``level``: the value that is crossed, in the units of the function.

    **Raises:** ``ValueError`` for the name of no number of the run, when it is solved.

    **Example:**

    >>> from jaxball import Disk, DiskState, Event, simulate
    >>> def post(disk, t, state):
    ...     return state.z - 1.5
    >>> disk, start = Disk(mass=1.0, inertia=0.5), DiskState(phidot=-1.0)
    >>> run = simulate(disk, [0.0, 1.0, 2.0], start, events={"post": Event(post, terminal=True)})
    >>> run.events["post"]
    Occurrences: It happened once, at t = 1.5.
    >>> run.message
    'The run ended at t = 1.5 before t = 2, where an event ended it.'
    >>> run = simulate(disk, [0.0, 1.0, 2.0], start, events={"near": Event("z", level=0.5)})
    >>> run.events["near"]
    Occurrences: It happened once, at t = 0.5.
    """

    of: Callable[..., Float[Array, ""]] | str = eqx.field(static=True)
    direction: int = eqx.field(static=True, default=EITHER)
    terminal: bool = eqx.field(static=True, default=False)
    capacity: int = eqx.field(static=True, default=64)
    level: Float[Array, ""] = eqx.field(converter=number(), default=0.0)
    from_start: ClassVar[bool] = False
    status: ClassVar[Status] = Status.EVENT

    def __check_init__(self):
        if not isinstance(self.of, str):
            more = ("observables",) if self._takes_observables else ()
            require_callable("of", self.of, "system", "t", "state", *more)

    @property
    def _takes_observables(self) -> bool:
        try:
            return "observables" in inspect.signature(self.of).parameters  # pyright: ignore[reportArgumentType]
        except (TypeError, ValueError):  # a name, or a function written in another language
            return False

    def value(self, system, t, state):
        return self.value_in_solve(system, t, state)

    def value_in_solve(self, system, t, state):
        if isinstance(self.of, str):
            return self._above_level(quantity(self.of, system, t, state))
        arguments = system.shown, t, system.state_to_show(state)
        with traceable("of", self.of):
            observables = {"observables": observables_of(system, t, state)} if self._takes_observables else {}
            return self._above_level(self.of(*arguments, **observables))

    def _above_level(self, value: Any) -> Float[Array, ""]:
        value = jnp.asarray(value)
        if value.shape != () or not jnp.issubdtype(value.dtype, jnp.floating):
            raise TypeError(
                "Argument `of` must be a function whose value is one real number that crosses zero, but it gives "
                f"{value.dtype} of shape {value.shape}."
            )
        return value - self.level.astype(value.dtype)


class Detachment(AbstractEvent):
    """The normal force N falls to zero, and the ball would leave the plane. Ends the run.

    With a law of contact it does leave it then. The function of the event is −1 in flight: in a run that begins there
    it happens at the start. A bounce does not count.

    **Arguments:**

    - ``terminal``: whether it ends the run.
    - ``capacity``: how many of its times and states are kept; all are counted.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Detachment, Disk, DiskState, Fixed, PointMass
    >>> disk = Disk(mass=1.0, inertia=0.5, masses=[PointMass(0.5, Fixed((0.0, 0.0, 0.5)))])
    >>> float(Detachment().value(disk, jnp.array(0.0), DiskState(phidot=3.0)))  # N = M g − ½ · 0.5 φ̇²
    -0.75
    """

    terminal: bool = eqx.field(static=True, default=True)
    capacity: int = eqx.field(static=True, default=8)
    direction: int = eqx.field(static=True, default=DOWN, init=False)
    from_start: ClassVar[bool] = True
    status: ClassVar[Status] = Status.DETACHED

    def value(self, system, t, state):
        return system.plane_reaction(t, state).normal

    def value_in_solve(self, system, t, state):
        if not has_contact(system):
            return super().value_in_solve(system, t, state)
        # N is below 0 by the error of the time at which a mode ends: the event is to be the switch to flight itself.
        N = jnp.maximum(system.plane_reaction(t, state).normal, 0.0)
        return jnp.where(state.is_in(Mode.FLIGHT), -1.0, N)


class Slip(AbstractEvent):
    """The friction |f| rises to μN, the most that a plane with the coefficient of friction μ can give. Ends the run.

    With a law of contact the body also slips, or lands with a slip, by that law: this is the event, too, where μ is not
    more than the ``static_friction`` of the law. Its function is then −1, and in flight 1.

    **Arguments:**

    - ``friction``: μ, the coefficient of friction, dimensionless.
    - ``terminal``: whether it ends the run.
    - ``capacity``: how many of its times and states are kept; all are counted.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Disk, DiskState, Fixed, PointMass, Slip
    >>> disk = Disk(mass=1.0, inertia=0.5, masses=[PointMass(0.5, Fixed((0.5, 0.0, 0.0)))])
    >>> [bool(Slip(friction).value(disk, jnp.array(0.0), DiskState()) < 0) for friction in (0.1, 0.2)]
    [True, False]
    """

    friction: Float[Array, ""] = eqx.field(converter=number())
    terminal: bool = eqx.field(static=True, default=True)
    capacity: int = eqx.field(static=True, default=8)
    direction: int = eqx.field(static=True, default=DOWN, init=False)
    from_start: ClassVar[bool] = True
    status: ClassVar[Status] = Status.SLIPPED

    def __check_init__(self):
        if not is_traced(self.friction) and not 0 < self.friction < jnp.inf:
            raise ValueError(f"Argument `friction` must be a positive number, but it is {float(self.friction):g}.")

    def value(self, system, t, state):
        return self._spare(system.plane_reaction(t, state))

    def value_in_solve(self, system, t, state):
        if not has_contact(system):
            return super().value_in_solve(system, t, state)
        spare, static = self._spare(system.plane_reaction(t, state)), system.law.static_friction
        # Likewise it is below 0 by the error of the time at which rolling ends.
        held = jnp.where(self.friction < static, spare, jnp.maximum(spare, 0.0))
        slides, flies = state.is_in(Mode.SLIDING), state.is_in(Mode.FLIGHT)
        return jnp.where(flies, 1.0, jnp.where(slides & (self.friction <= static), -1.0, held))

    def _spare(self, force: Reaction) -> Float[Array, ""]:
        """Computes μ²N|N| − |f|², which is smooth where f is zero, as μN − |f| is not."""
        return self.friction**2 * force.normal * jnp.abs(force.normal) - force.friction_squared


class Leaving(AbstractEvent):
    """Something leaves the inside of the system whose place only the state tells: what ``clearance`` says, or
    ``clearance_of_all`` for what is ``swinging``.

    Where masses leave a shell the run goes on, because its equations do not depend on the shell; else it ends.
    """

    status: Status = eqx.field(static=True)  # pyright: ignore[reportIncompatibleVariableOverride]
    swinging: bool = eqx.field(static=True)
    direction: int = eqx.field(static=True, default=DOWN, init=False)
    capacity: int = eqx.field(static=True, default=1, init=False)
    from_start: ClassVar[bool] = False

    @property
    def terminal(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.status != Status.LEFT_SHELL

    def value(self, system, t, state):
        clearance = self.clearance(system, t, state)
        assert clearance is not None
        return clearance

    def value_in_solve(self, system, t, state):
        return self.value(system, t, state)

    def clearance(self, system: AbstractSystem, t: Float[Array, ""], state: Any) -> Float[Array, ""] | None:
        """Returns the number that is positive while nothing leaves; None where nothing can."""
        return clearance_of_all(system, t, state) if self.swinging else system.clearance(t, state)


class EndOfGround(AbstractEvent):
    """The surface under a body does not let it go on: it is curved too much, or ends.

    Its ``status`` says which.
    """

    status: Status = eqx.field(static=True)  # pyright: ignore[reportIncompatibleVariableOverride]
    direction: int = eqx.field(static=True, default=DOWN, init=False)
    terminal: bool = eqx.field(static=True, default=True, init=False)
    capacity: int = eqx.field(static=True, default=1, init=False)
    from_start: ClassVar[bool] = False

    def value(self, system, t, state):
        # Where a run ends has no derivatives: beyond, there is no motion.
        system, t, state = without_derivatives((system, t, state))
        fit, way = room_on_ground(system, t, state)
        return fit if self.status == Status.WEDGED else way

    def value_in_solve(self, system, t, state):
        value = super().value_in_solve(system, t, state)
        # In flight a body needs no ground.
        return jnp.where(state.is_in(Mode.FLIGHT), 1.0, value) if isinstance(state, ContactState) else value


def prefix_of_event(name: str) -> str:
    """Returns the beginning of the names of an event's variables in a file; a slash would make a group of a netCDF
    file.
    """
    return f"event_{name.replace('/', '_')}"


def check_events(system: AbstractSystem, events: Mapping[str, AbstractEvent] | None) -> dict[str, AbstractEvent]:
    """Checks the events to look for, of the ``system`` that is solved, and returns them.

    **Raises:** ``TypeError`` for anything but an event, and for one that cannot happen to such a system.
    """
    events = {} if events is None else events
    require("events", events, Mapping, 'a dictionary of events by name, such as {"lift": Detachment()}')
    for name, event in events.items():
        if not isinstance(name, str):
            raise TypeError(f"Argument `events` must have names as keys, but one is {name!r}.")
        remedy = "Event(function) is one" if inspect.isfunction(event) else ""
        require(f"events[{name!r}]", event, AbstractEvent, "an event, such as Detachment()", remedy)
    by_prefix: dict[str, str] = {}
    for name in events:
        if (other := by_prefix.setdefault(prefix_of_event(name), name)) != name:
            raise ValueError(
                f"Argument `events` must have names that differ in files, where {other!r} and {name!r} are both "
                f"{prefix_of_event(name)}; rename one of them."
            )
    touching = [name for name, event in events.items() if isinstance(event, Detachment | Slip)]
    if touching and not isinstance(system.shown, AbstractRollingSystem):
        raise TypeError(
            f"Argument `events` must not hold a Detachment or a Slip for a {type(system.shown).__name__}, which "
            f'does not roll on a plane, but "{touching[0]}" is one.'
        )
    return dict(events)
