"""By how much a number of a scenario may change where no scale is given: from its dimension.

Lengths are counted in radii r of the shell, times in √(r/g), and angles in radians.
"""

import math
import re

from ..physics.body import System

_LENGTHS = r"radius|semi_axes|half_extents|half_width|centre|cosine|sine|points|position|offset|z"
_ANGLES = r"theta|angles|phase|phi|angle|azimuth|elevation"
_RATES = r"rate|end_rates|Omega|phidot|thetadot|frequency"
_TIMES = r"start|hold|end|times"


def default_scale(path: str, value: float, system: System) -> float:
    """The scale of the number at ``path``; its own size, or 1, where its dimension is not known."""
    r, g = float(system.radius), abs(float(system.gravity))
    time = math.sqrt(r / g) if g > 0 else 1.0
    scales = {_LENGTHS: r, _ANGLES: 1.0, _RATES: 1 / time, _TIMES: time, "height|accelerations": 1 / time**2}
    name = re.sub(r"\[\d+\]", "", path.rpartition(".")[2])
    for names, scale in scales.items():
        if re.fullmatch(names, name):
            return scale
    return abs(value) or 1.0
