"""What a file of jaxball's own keeps of a scenario beside the robot: the save times, and controls that vary over them.

MJCF has no place for them but ``<custom>``, whose numbers MuJoCo keeps and does not heed.
"""

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from ..physics.prescribed.recorded import RecordedSignal
from ..physics.prescribed.schedules import ConstantRate, Waypoints
from ..physics.prescribed.signals import AbstractSignal, ConstantSignal
from .drives import Control, control_values
from .elements import MJCFError, add, numbers

TIMES = "jaxball.times"
CONTROL = "jaxball.control "  # and the name of the actuator


class Recording(NamedTuple):
    """The control of an actuator: its values at some times, or a single one that it keeps."""

    times: Float[np.ndarray, " T"]
    values: Float[np.ndarray, " T"]

    @classmethod
    def constant(cls, value: float) -> "Recording":
        return cls(np.zeros(1), np.full(1, value))

    @property
    def varies(self) -> bool:
        return len(self.values) > 1

    def scale(self, by: float) -> "Recording":
        return Recording(self.times, by * self.values)

    def clip(self, low: float, high: float) -> "Recording":
        return Recording(self.times, np.clip(self.values, low, high))

    def signal(self) -> AbstractSignal:
        """Returns the control as a signal: linear between the times, because it may jump, and held outside of them."""
        if not self.varies:
            return ConstantSignal(float(self.values[0]))
        return RecordedSignal(self.times, self.values, outside="hold")

    def target(self, lag: float) -> ConstantRate | Waypoints:
        """Computes the schedule θ of which the control is θ + ``lag`` θ̇, as that of a servo is."""
        if not self.varies:
            return ConstantRate(float(self.values[0]))
        if lag <= 0:
            return Waypoints(self.times, self.values, _end_rates(CubicSpline(self.times, self.values)))
        theta = _follow(CubicSpline(self.times, self.values), lag)
        rates = (self.values - theta) / lag
        return Waypoints(self.times, theta, rates[[0, -1]])

    def integral(self) -> ConstantRate | Waypoints:
        """Computes the schedule whose rate is the control, 0 at the start."""
        if not self.varies:
            return ConstantRate(0.0, rate=float(self.values[0]))
        theta = CubicSpline(self.times, self.values).antiderivative()(self.times)
        return Waypoints(self.times, theta, self.values[[0, -1]])


def _end_rates(spline: CubicSpline) -> Float[np.ndarray, "2"]:
    return spline(spline.x[[0, -1]], 1)


def _follow(spline: CubicSpline, lag: float) -> Float[np.ndarray, " T"]:
    """Computes θ with θ + ``lag`` θ̇ = u at the knots of the spline u, without what dies out from the start on.

    On each piece θ is a cubic polynomial, u − lag u̇ + lag² ü − lag³ u⃛, and an exponential that makes it continuous
    where u⃛ jumps.
    """
    slow = sum((-lag) ** order * spline(spline.x, order) for order in range(4))
    # At its end a piece has the third derivative of the one after it in `slow`, but for the last.
    third = spline.c[0] * 6
    jumps = np.append(np.diff(third), 0.0) * lag**3
    theta, rest = np.array(slow), 0.0
    for index, (step, jump) in enumerate(zip(np.diff(spline.x), jumps, strict=True)):
        rest = rest * np.exp(-step / lag) + jump
        theta[index + 1] += rest
    return theta


def write_recordings(root: ET.Element, times: Float[np.ndarray, " T"], controls: Sequence[Control]) -> None:
    """Adds the save times to a file, and the controls that vary over them."""
    custom = ET.SubElement(root, "custom")
    add(custom, "numeric", name=TIMES, data=times)
    for control, values in zip(controls, control_values(controls, times).T, strict=True):
        if np.any(values != values[0]):
            add(custom, "numeric", name=f"{CONTROL}{control.actuator}", data=values)


def read_recordings(root: ET.Element) -> Mapping[str, Recording]:
    """Reads the controls that a file has of all save times, by the names of the actuators.

    The times themselves have the name :data:`TIMES`, if the file has any.

    **Raises:** :class:`MJCFError` for times that do not increase, and for controls of other times.
    """
    numeric = {element.get("name", ""): element for element in root.findall("custom/numeric")}
    if TIMES not in numeric:
        return {}
    times = numbers(numeric[TIMES], "data")
    if len(times) < 1 or np.any(np.diff(times) <= 0):
        raise MJCFError(
            f'The numbers of <numeric name="{TIMES}"> must increase, because they are the save times, but they do not; '
            "leave the element out, and give `times`."
        )
    recordings = {TIMES: Recording(times, times)}
    for name, element in numeric.items():
        if name.startswith(CONTROL):
            values = numbers(element, "data", count=len(times))
            recordings[name.removeprefix(CONTROL)] = Recording(times, values)
    return recordings
