"""The robots that all engines simulate; their numbers are our own, but for those of the paper."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from ...physics.body import Ball
from ...physics.contact.law import Contact
from ...physics.contact.released import ReleasedState
from ...physics.ground import Ground
from ...physics.mechanisms import Motor, planar_pendulum
from ...physics.schedules import Sinusoids
from ...physics.state import BallState
from ...scenario import Scenario, load_scenario
from .contract import Case

SOLID: dict[str, Any] = {"mass": 1.0, "inertia": (0.016,) * 3, "radius": 0.2, "gravity": 9.81}  # 2/5 m r²


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
