"""Poincaré maps, and two bodies whose chaotic rolling has been studied with them."""

import math
from collections.abc import Callable
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ... import programs
from ...interface.printing import Printed
from ...interface.status import Status
from ...numerics.arrays import Numbers, select_tree, to_array
from ...physics.body import Ball
from ...physics.contact.law import Contact
from ...physics.contact.released import ReleasedState
from ...physics.dynamics.parameters import PointMass
from ...physics.hybrid import SOON
from ...physics.prescribed.motion import OnRail
from ...physics.prescribed.rails import Circle
from ...physics.prescribed.schedules import ConstantRate
from ...physics.system import AbstractState, AbstractSystem
from ...programs.batches import map_rows
from ...simulation import DEFAULT_TOLERANCE
from ...simulation.events import Event
from ...simulation.simulate import simulate
from ...simulation.trajectory import Interpolant


class PoincareMap(Printed):
    """The crossings of a section, in the order of time: each is the image of the one before it.

    - ``times``: the times of the crossings, shape (n,).
    - ``state``: the states there; each of its arrays has n as leading axis. With a law of contact they are
      :class:`~jaxball.physics.ReleasedState`.
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
    section: Callable[..., Any] | str,
    times: Numbers,
    state: AbstractState | ReleasedState | None = None,
    *,
    contact: Contact | None = None,
    level: Numbers = 0.0,
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

    - ``section``: a function of (system, t, state) that is zero on the section, or the name of a number that is, as
      for :class:`jaxball.Event`. With a law of contact ``"V[2]"`` falls through 0 where the body is highest, and rises
      through 0 where it rebounds.
    - ``times``: the start and the end.
    - ``state``: the state at the start. A :class:`~jaxball.physics.ReducedState` is the smallest for a ball.
    - ``contact``: a :class:`~jaxball.Contact`, as for :func:`jaxball.simulate`. A jump across the section, as in an
      impact, counts as a crossing, and the state is that after it.
    - ``level``: the value of ``section`` on the section.
    - ``direction``: 1 for crossings at which ``section`` rises, −1 where it falls, 0 for both.
    - ``capacity``: how many crossings are kept.
    - ``solver``, ``rtol``, ``atol``, ``max_steps``: as for :func:`jaxball.simulate`.

    **Raises:** as :func:`jaxball.simulate` and :class:`jaxball.Event` do.
    """
    trajectory = simulate(
        system,
        times,
        state,
        contact=contact,
        dense=contact is not None,  # events keep the state of the body, and not how it moves on its ground
        solver=solver,
        rtol=rtol,
        atol=atol,
        max_steps=max_steps,
        events={"section": Event(of=section, direction=direction, capacity=capacity, level=level)},  # pyright: ignore[reportCallIssue]
    )
    crossings = trajectory.events["section"]
    count = int(crossings.count)
    # There may have been more than there was room for.
    rows = slice(0, min(count, capacity))
    crossed, states = np.asarray(crossings.times)[rows], crossings.state
    if trajectory.interpolant is not None and crossed.size:
        at = to_array(np.nan_to_num(np.asarray(crossings.times), nan=crossed[-1]))
        states = _motions(trajectory.interpolant, at, trajectory.reached, trajectory.switches)
    return PoincareMap(
        times=crossed,
        state=jax.tree.map(lambda leaf: np.asarray(leaf)[rows], states),
        count=count,
        status=int(trajectory.status),
        reached=float(trajectory.reached),
        end=float(np.asarray(times)[-1]),
    )


@programs.filter_jit
def _motions(
    interpolant: Interpolant[Any], times: Float[Array, " n"], reached: Float[Array, ""], switches: Any
) -> ReleasedState:
    """Returns the states of a body with a law of contact, between the saved times; after a jump that is there."""

    def motion(t: Float[Array, ""]) -> ReleasedState:
        soon = SOON * float(jnp.finfo(t.dtype).eps) * jnp.abs(t)
        within = interpolant.packing.unpack(t, interpolant.vector(jnp.minimum(t + soon, reached))).motion
        # Of a jump with which the run ends there is nothing after it but what the last switch has.
        jumps = (jnp.abs(switches.times - t) <= soon) & (t + soon >= reached)
        last = switches.times.size - 1 - jnp.argmax(jumps[::-1])
        return select_tree(jnp.any(jumps), jax.tree.map(lambda leaf: leaf[last], switches.after), within)

    return map_rows(motion, times)


def rolling_robot(
    orbit: Numbers = 0.6, *, rate: Numbers = 1.5, mass: Numbers = 1.0, inertia: Numbers = 2 / 3, gravity: Numbers = 1.0
) -> Ball:
    """Builds the rolling robot of Ilin, Moffatt & Vladimirov (2017, PNAS 114, 12858): a point mass driven around in a
    shell.

    The shell has mass 1 and radius 1. The mass moves on the circle of radius ``orbit`` about the centre, in the plane
    of E1 and E3, at the constant ``rate``, and starts at −E3. These four numbers and the choice of the unit of time are
    the paper's four dimensionless parameters.

    **Arguments:**

    - ``orbit``: the radius of the orbit, in radii of the shell.
    - ``rate``: θ̇, in rad per time.
    - ``mass``: of the point mass, in masses of the shell.
    - ``inertia``: d1 = d2 = d3 of the shell; 2/3 for a thin shell.
    - ``gravity``: g; with 1, times are in √(r/g).

    **Example:**

    >>> from jaxball.analysis.chaos import rolling_robot
    >>> robot = rolling_robot(orbit=0.5)
    >>> robot.point_masses[0].motion.rail
    Circle(radius=0.5, centre=(0.0, 0.0, 0.0), frame=MatrixFrame())
    """
    moment = to_array(inertia)
    circle = OnRail(Circle(radius=orbit), ConstantRate(-math.pi / 2, rate))
    return Ball(mass=1.0, inertia=jnp.stack([moment] * 3), gravity=gravity, masses=[PointMass(mass, circle)])


def chaplygin_top(
    offset: Numbers = (0.2, 0.3, 0.4), *, inertia: Numbers = (0.2, 0.6, 0.7), gravity: Numbers = 1.0
) -> Ball:
    """Builds Chaplygin's top: a ball with unequal moments whose centre of mass is off the centre and off all axes.

    It has mass 1 and radius 1. Energy is its only integral, and much of its motion is chaotic (Borisov, Kazakov &
    Sataev 2014, Regular and Chaotic Dynamics 19, 718).

    **Arguments:**

    - ``offset``: from the geometric centre to the centre of mass, in radii.
    - ``inertia``: d1, d2, d3 about the centre of mass.
    - ``gravity``: g; with 1, times are in √(r/g).

    **Example:**

    >>> from jaxball.analysis.chaos import chaplygin_top
    >>> chaplygin_top()
    Ball(mass=1.0, inertia=(0.2, 0.6, 0.7), radius=1.0, offset=(0.2, 0.3, 0.4), gravity=1.0)
    """
    return Ball(mass=1.0, inertia=inertia, offset=offset, gravity=gravity)
