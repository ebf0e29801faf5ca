"""What engines simulate and give: cases, the settings of an engine, motions; and the robots that are the cases.

The numbers of the robots are our own, but for those of the paper.
"""

import dataclasses
import functools
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from jaxball import Scenario, load_scenario
from jaxball.physics.body import Ball
from jaxball.physics.contact.law import Contact
from jaxball.physics.contact.released import ReleasedState
from jaxball.physics.grounds.ground import Ground
from jaxball.physics.mechanisms import Motor, planar_pendulum
from jaxball.physics.prescribed.schedules import Sinusoids
from jaxball.physics.state import BallState

from ..contenders import Family

SOLID: dict[str, Any] = {"mass": 1.0, "inertia": (0.016,) * 3, "radius": 0.2, "gravity": 9.81}  # 2/5 m r²


@dataclass(frozen=True)
class Case:
    """A robot that every engine simulates from the same state.

    - ``name``, ``title``: for files and figures.
    - ``scenario``: the robot, its start and the times at which motions are compared; called only when needed.
    - ``why``: what it shows.
    - ``friction``: the coefficient with which engines hold a body that always rolls: more than it needs.
    """

    name: str
    title: str
    why: str
    scenario: Callable[[], Scenario]
    friction: float = 1.0


@dataclass(frozen=True)
class Setting:
    """One way to use an engine, by its documentation.

    - ``name``: for tables and figures.
    - ``source``: where its documentation recommends it, or what is varied.
    - ``values``: what the engine's file makes of it.
    """

    name: str
    source: str
    values: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Engine:
    """An engine: the family that says whether it is installed, and its settings.

    The module of the family, in this folder, has ``run(case, setting, timestep) -> Motion``, which raises a
    ``ValueError`` with a sentence for a robot that the engine cannot express.
    """

    family: Family
    settings: tuple[Setting, ...]


class Motion(NamedTuple):
    """A motion at the times of a case, the processor time in seconds that the engine's steps took, and their number.

    Orientation q, scalar first; Ω in body axes; the geometric centre and its velocity in space, the height that above
    the plane; and θ and θ̇ of the scenario's coordinates. ``steps`` is None where an engine does not count them.
    """

    q: Float[np.ndarray, "T 4"]
    Omega: Float[np.ndarray, "T 3"]
    centre: Float[np.ndarray, "T 3"]
    V: Float[np.ndarray, "T 3"]
    theta: Float[np.ndarray, "T n"]
    thetadot: Float[np.ndarray, "T n"]
    seconds: float
    steps: int | None = None


class Derivative(NamedTuple):
    """The derivative of a final place, and the processor time in seconds that compiling and one evaluation took."""

    value: Float[np.ndarray, "2"]
    compiling: float
    seconds: float


def time_calls(program: Callable[[], Any], repeats: int) -> tuple[np.ndarray, list[float]]:
    """Returns a program's value, and processor times of its first call, which compiles, and of ``repeats`` others."""
    calls = []
    for _ in range(repeats):
        begin = time.process_time()
        jax.block_until_ready(program())
        calls.append(time.process_time() - begin)
    begin = time.process_time()
    value = np.asarray(program())
    return value, [*calls, time.process_time() - begin]


Row = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # of a motion, at one time


def motion_of(rows: Sequence[Row], seconds: float, steps: int | None = None) -> Motion:
    """The motion whose arrays have these rows."""
    q, Omega, centre, V, theta, thetadot = (np.stack(column) for column in zip(*rows, strict=True))
    return Motion(q, Omega, centre, V, theta, thetadot, seconds, steps)


@functools.cache
def _slope() -> Scenario:
    ball = Ball(**SOLID, ground=Ground(angle=0.2))
    start = BallState(Omega=(-5.0, 0.0, 1.0))
    return Scenario("slope", ball, start, np.linspace(0.0, 3.0, 31), rtol=1e-12, atol=1e-12)


@functools.cache
def _slide() -> Scenario:
    start = ReleasedState(BallState(Omega=(0.0, -10.0, 0.0)), V=(3.0, 0.5, 0.0))
    return Scenario(
        "slide", Ball(**SOLID), start, np.linspace(0.0, 3.0, 31), rtol=1e-12, atol=1e-12, contact=Contact(0.2)
    )


def pendulum_robot(scale: Any = 1.0) -> Ball:
    """A ball with a pendulum, driven by ``scale`` times its torque."""
    torque = Motor(Sinusoids(0.0, amplitude=[0.25 * scale], frequency=[2.0]))
    shell: dict[str, Any] = SOLID | {"inertia": (0.02, 0.024, 0.022)}
    return Ball(**shell, mechanisms=[planar_pendulum(0.5, 0.1, drive=torque)])


@functools.cache
def _pendulum() -> Scenario:
    start = BallState(Omega=(0.5, 2.0, 0.3), theta=(0.3,), thetadot=(0.0,))
    return Scenario("pendulum", pendulum_robot(), start, np.linspace(0.0, 5.0, 51), rtol=1e-12, atol=1e-12)


def _builtin(name: str) -> Callable[[], Scenario]:
    return functools.cache(lambda: dataclasses.replace(load_scenario(name), rtol=1e-12, atol=1e-12))


_ALL = (
    Case("slope", "a ball on a slope", "rolling alone, with a closed form", _slope),
    Case("slide", "a ball that slides, then rolls", "friction at its limit, and where slipping ends", _slide),
    Case("turntable", "Earnshaw's ball on a turntable", "a circle only if it rolls", _builtin("turntable"), 3.0),
    Case("pendulum", "a ball driven by a pendulum and a torque", "a robot", _pendulum),
    Case("ball", "the paper's ball: three prescribed masses", "masses that move by schedules", _builtin("ball")),
    Case("disk", "the paper's disk: four masses on circles", "the planar case", _builtin("disk")),
)
CASES = {case.name: case for case in _ALL}
