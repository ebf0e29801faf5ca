"""The default scale of a number of a scenario, from its dimension.

Lengths are measured in radii r of the shell, times in √(r/g), and angles in radians.
"""

import math

from ..physics.body import System
from ..scenario.values import Dimension


def default_scale(dimension: Dimension | None, value: float, system: System) -> float:
    """The scale of a number of this ``dimension``; its own magnitude, or 1, if its key declares none."""
    if dimension is None:
        return abs(value) or 1.0
    r, g = float(system.radius), abs(float(system.gravity))
    time = math.sqrt(r / g) if g > 0 else 1.0
    return r**dimension.length * time**dimension.time
