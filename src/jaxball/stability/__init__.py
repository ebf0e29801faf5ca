"""Steady and periodic motions and their linear stability.

No figures and no files: :mod:`jaxball.plot` draws the results.
"""

from ..interface.names import interface as _interface
from .chart import floquet_chart as floquet_chart
from .periodic import PeriodicMotion as PeriodicMotion, periodic_motion as periodic_motion
from .rolling import steady_rolling as steady_rolling
from .rotations import permanent_rotations as permanent_rotations
from .steady import SteadyMotion as SteadyMotion, stability as stability

__all__, __dir__ = _interface(globals())
