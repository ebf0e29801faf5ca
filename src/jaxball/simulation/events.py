"""What may happen along a motion, such as that the ball slips, or a function crosses zero, and when it happened."""

import abc
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, cast

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..interface.arguments import require_callable, require_flags, traceable
from ..interface.printing import Printed, is_single, shown
from ..interface.status import Status
from ..numerics.arrays import Numbers, is_traced, numbers


class Occurrences(Printed):
    """The occurrences of one event in a run, in the order of time.

    - ``count``: how many there were.
    - ``times``: when, shape (room,); NaN where there are fewer.
    - ``state``: the states then; each of its arrays has ``room`` as leading axis.
    - ``least``, ``largest``: the extreme values of the event's function, where the solve evaluated it.

    Times and states are differentiable, ``least`` and ``largest`` are not.
    """

    count: Int[Array, "*batch"]
    times: Float[Array, "*batch room"]
    state: Any
    least: Float[Array, "*batch"]
    largest: Float[Array, "*batch"]

    def __repr__(self) -> str:
        return f"Occurrences: {self.message}" if is_single(self.count) else shown(self)

    @property
    def message(self) -> str:
        """A sentence on how often it happened. For one trajectory, not for a batch."""
        count, room = int(self.count), self.times.shape[-1]
        span = f"its function was between {float(self.least):.6g} and {float(self.largest):.6g}"
        if count == 0:
            return f"It never happened: {span}, and did not cross zero in the direction asked for."
        first = f"first at t = {float(np.asarray(self.times)[0]):.10g}"
        if count == 1:
            return f"It happened once, at t = {float(np.asarray(self.times)[0]):.10g}."
        if count <= room:
            return f"It happened {count} times, {first}."
        return f"It happened {count} times, {first}; the first {room} are kept, and a larger `room` would keep more."


UP, DOWN, EITHER = 1, -1, 0


class AbstractEvent(Printed):
    """Something that happens where a function of time and state crosses zero.

    - ``direction``: 1 if it happens only where the function rises, −1 if only where it falls, 0 for both.
    - ``terminal``: whether it ends the run.
    - ``from_start``: whether it counts as having happened in a run that starts beyond zero.
    - ``room``: how many of its times and states are kept; all are counted.
    - ``status``: the status of a run that it ended.
    """

    if TYPE_CHECKING:  # to a type checker, fields declared here would come before `of` among the arguments
        direction, terminal, room = cast(int, None), cast(bool, None), cast(int, None)
    else:
        direction: eqx.AbstractVar[int]
        terminal: eqx.AbstractVar[bool]
        room: eqx.AbstractVar[int]
    from_start: ClassVar[bool]
    status: ClassVar[Status]

    def __check_init__(self):
        require_flags(terminal=self.terminal)
        if self.direction not in (UP, DOWN, EITHER):
            raise ValueError(f"Argument `direction` must be 1, -1 or 0, but it is {self.direction}.")
        if self.room < 1:
            raise ValueError(f"Argument `room` must be 1 or more, but it is {self.room}.")

    @abc.abstractmethod
    def value(self, system: Any, t: Float[Array, ""], state: Any) -> Float[Array, ""]:
        """The function that crosses zero."""


class Event(AbstractEvent):
    """A position reached, an angle at a bound, a Poincaré section: wherever ``of(system, t, state)`` crosses zero.

    **Arguments:**

    - ``of``: a scalar function, written with ``jax.numpy``. A named function, rather than a new ``lambda`` at each
      call, avoids compiling again.
    - ``direction``: 1 for upward crossings only, −1 for downward ones, 0 for both.
    - ``terminal``: whether the first crossing ends the run.
    - ``room``: how many crossings are kept; all are counted.

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
    """

    of: Callable[[Any, Float[Array, ""], Any], Float[Array, ""]] = eqx.field(static=True)
    direction: int = eqx.field(static=True, default=EITHER)
    terminal: bool = eqx.field(static=True, default=False)
    room: int = eqx.field(static=True, default=64)
    from_start: ClassVar[bool] = False
    status: ClassVar[Status] = Status.EVENT

    def __check_init__(self):
        require_callable("of", self.of, "system", "t", "state")

    def value(self, system, t, state):
        with traceable("of", self.of):
            value = jnp.asarray(self.of(system, t, state))
        if value.shape != () or not jnp.issubdtype(value.dtype, jnp.floating):
            raise TypeError(
                "Argument `of` must be a function whose value is one real number that crosses zero, but it gives "
                f"{value.dtype} of shape {value.shape}."
            )
        return value


class Detachment(AbstractEvent):
    """The normal force N falls to zero, and the ball would leave the plane. Ends the run.

    **Arguments:**

    - ``terminal``: whether it ends the run.
    - ``room``: how many of its times and states are kept; all are counted.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Detachment, Disk, DiskState, Fixed, PointMass
    >>> disk = Disk(mass=1.0, inertia=0.5, masses=[PointMass(0.5, Fixed((0.0, 0.0, 0.5)))])
    >>> float(Detachment().value(disk, jnp.array(0.0), DiskState(phidot=3.0)))  # N = M g − ½ · 0.5 φ̇²
    -0.75
    """

    terminal: bool = eqx.field(static=True, default=True)
    room: int = eqx.field(static=True, default=8)
    direction: int = eqx.field(static=True, default=DOWN, init=False)
    from_start: ClassVar[bool] = True
    status: ClassVar[Status] = Status.DETACHED

    def value(self, system, t, state):
        return system.plane_reaction(t, state).normal


class Slip(AbstractEvent):
    """The friction |f| rises to μN, the most that a plane with the coefficient of friction μ can give. Ends the run.

    **Arguments:**

    - ``friction``: μ, dimensionless.
    - ``terminal``: whether it ends the run.
    - ``room``: how many of its times and states are kept; all are counted.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Disk, DiskState, Fixed, PointMass, Slip
    >>> disk = Disk(mass=1.0, inertia=0.5, masses=[PointMass(0.5, Fixed((0.5, 0.0, 0.0)))])
    >>> [bool(Slip(friction).value(disk, jnp.array(0.0), DiskState()) < 0) for friction in (0.1, 0.2)]
    [True, False]
    """

    friction: Float[Array, ""] = eqx.field(converter=numbers("friction"))
    terminal: bool = eqx.field(static=True)
    room: int = eqx.field(static=True)
    direction: int = eqx.field(static=True)
    from_start: ClassVar[bool] = True
    status: ClassVar[Status] = Status.SLIPPED

    def __init__(self, friction: Numbers, terminal: bool = True, room: int = 8):
        self.friction, self.terminal, self.room, self.direction = numbers("friction")(friction), terminal, room, DOWN
        if not is_traced(self.friction) and not 0 < self.friction < jnp.inf:
            raise ValueError(f"Argument `friction` must be a positive number, but it is {float(self.friction):g}.")

    def value(self, system, t, state):
        """μ²N|N| − |f|², which is smooth where f is zero, as μN − |f| is not."""
        force = system.plane_reaction(t, state)
        return self.friction**2 * force.normal * jnp.abs(force.normal) - force.friction_squared
