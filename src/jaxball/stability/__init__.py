"""Steady and periodic motions and their linear stability.

No figures and no files: :mod:`jaxball.plot` draws the results.
"""

from ..interface.names import interface as _interface
from .chart import floquet_chart as floquet_chart
from .periodic import PeriodicMotion as PeriodicMotion, periodic_motion as periodic_motion
from .steady import (
    SteadyMotion as SteadyMotion,
    permanent_rotations as permanent_rotations,
    stability as stability,
    steady_rolling as steady_rolling,
)

__all__, __dir__ = _interface(globals())
