"""The contract of the engines: a case, the settings of an engine, and the motion that it computes."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from ...scenario import Scenario
from ..contenders import Family


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
    """A motion at the times of a case, and the processor time in seconds that the engine's steps took.

    Orientation q, scalar first; Ω in body axes; the geometric centre and its velocity in space, the height that above
    the plane; and θ and θ̇ of the scenario's coordinates.
    """

    q: Float[np.ndarray, "T 4"]
    Omega: Float[np.ndarray, "T 3"]
    centre: Float[np.ndarray, "T 3"]
    V: Float[np.ndarray, "T 3"]
    theta: Float[np.ndarray, "T n"]
    thetadot: Float[np.ndarray, "T n"]
    seconds: float


class Derivative(NamedTuple):
    """The derivative of a final place, and the processor time in seconds that compiling and one evaluation took."""

    value: Float[np.ndarray, "2"]
    compiling: float
    seconds: float


def timed(program: Callable[[], Any], repeats: int) -> tuple[np.ndarray, list[float]]:
    """The value of a program, and the processor times of its first call, which compiles, and of ``repeats`` others."""
    calls = []
    for _ in range(repeats):
        begin = time.process_time()
        jax.block_until_ready(program())
        calls.append(time.process_time() - begin)
    begin = time.process_time()
    value = np.asarray(program())
    return value, [*calls, time.process_time() - begin]


Row = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # of a motion, at one time


def motion_of(rows: Sequence[Row], seconds: float) -> Motion:
    """The motion whose arrays have these rows."""
    q, Omega, centre, V, theta, thetadot = (np.stack(column) for column in zip(*rows, strict=True))
    return Motion(q, Omega, centre, V, theta, thetadot, seconds)
