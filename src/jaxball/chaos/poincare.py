"""Poincaré maps: where a motion crosses a section of its phase space."""

from collections.abc import Callable
from typing import Any

import diffrax
import jax
import numpy as np
from jaxtyping import Array, Float

from ..interface.printing import Printed
from ..interface.status import Status
from ..numerics.arrays import Numbers
from ..physics.system import AbstractState, AbstractSystem
from ..simulation import DEFAULT_TOLERANCE
from ..simulation.events import Event
from ..simulation.simulate import simulate


class PoincareMap(Printed):
    """The crossings of a section, in the order of time: each is the image of the one before it.

    - ``times``: the times of the crossings, shape (n,).
    - ``state``: the states there; each of its arrays has n as leading axis.
    - ``count``: how many crossings there were; more than n if there was not enough room.
    - ``status``, ``reached``: how the run ended; ``ok`` and ``message`` read them.
    - ``end``: the time at which the run was to end.
    """

    times: Float[np.ndarray, " n"]
    state: Any
    count: int
    status: int
    reached: float
    end: float

    def __repr__(self) -> str:
        span = (
            f", the first at t = {self.times[0]:.6g}, the last at t = {self.times[-1]:.6g}" if self.times.size else ""
        )
        return f"Poincaré map of {len(self.times)} crossings{span}\n  {self.message}"

    @property
    def ok(self) -> bool:
        """Whether the run reached its end, and all crossings are kept."""
        return self.status == Status.SUCCESS and self.count == len(self.times)

    @property
    def message(self) -> str:
        """A sentence on how the run ended, and one on how many crossings were kept."""
        summary = f"Of {self.count} crossings {len(self.times)} were kept"
        more = "; raise `capacity` to keep them all." if self.count > len(self.times) else "."
        return f"{Status(self.status).sentence(self.reached, self.end, alone=True)} {summary}{more}"


def poincare_map(
    system: AbstractSystem,
    section: Callable[[Any, Float[Array, ""], Any], Any],
    times: Numbers,
    state: AbstractState | None = None,
    *,
    direction: int = 1,
    capacity: int = 1024,
    solver: diffrax.AbstractAdaptiveSolver | None = None,
    rtol: Numbers = DEFAULT_TOLERANCE,
    atol: Numbers = DEFAULT_TOLERANCE,
    max_steps: int = 16384,
) -> PoincareMap:
    """Finds the states at which the motion of ``system`` crosses a section, located to the accuracy of the solve.

    For masses driven periodically, the stroboscopic map consists of the states at multiples of the period, which
    :func:`jaxball.simulate` saves; a section is for autonomous motions.

    **Arguments:**

    - ``section``: a function of (system, t, state) that is zero on the section, as for :class:`jaxball.Event`.
    - ``times``: the start and the end.
    - ``state``: the state at the start. A :class:`~jaxball.ReducedState` is the smallest for a ball.
    - ``direction``: 1 for crossings at which ``section`` rises, −1 where it falls, 0 for both.
    - ``capacity``: how many crossings are kept.
    - ``solver``, ``rtol``, ``atol``, ``max_steps``: as for :func:`jaxball.simulate`.

    **Raises:** as :func:`jaxball.simulate` and :class:`jaxball.Event` do.
    """
    trajectory = simulate(
        system,
        times,
        state,
        solver=solver,
        rtol=rtol,
        atol=atol,
        max_steps=max_steps,
        events={"section": Event(of=section, direction=direction, capacity=capacity)},  # pyright: ignore[reportCallIssue]
    )
    crossings = trajectory.events["section"]
    count = int(crossings.count)
    # There may have been more than there was room for.
    rows = slice(0, min(count, capacity))
    return PoincareMap(
        times=np.asarray(crossings.times)[rows],
        state=jax.tree.map(lambda leaf: np.asarray(leaf)[rows], crossings.state),
        count=count,
        status=int(trajectory.status),
        reached=float(trajectory.reached),
        end=float(np.asarray(times)[-1]),
    )
