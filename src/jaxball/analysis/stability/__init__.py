"""Steady and periodic motions and their linear stability.

No figures and no files: :mod:`jaxball.plot` draws the results.
"""

from ...interface.names import interface as _interface
from .periodic import floquet_chart as floquet_chart, periodic_motion as periodic_motion
from .steady import (
    permanent_rotations as permanent_rotations,
    steady_motion as steady_motion,
    steady_rolling as steady_rolling,
)

__all__, __dir__ = _interface(globals())
