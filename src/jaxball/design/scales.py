"""By how much a number of a scenario may change where no scale is given: from its dimension.

Lengths are counted in radii r of the shell, times in √(r/g), and angles in radians.
"""

import math

from ..physics.body import System
from ..scenario.values import Dimension


def default_scale(dimension: Dimension | None, value: float, system: System) -> float:
    """The scale of a number of this ``dimension``; its own size, or 1, where its key declares none."""
    if dimension is None:
        return abs(value) or 1.0
    r, g = float(system.radius), abs(float(system.gravity))
    time = math.sqrt(r / g) if g > 0 else 1.0
    return r**dimension.length * time**dimension.time
