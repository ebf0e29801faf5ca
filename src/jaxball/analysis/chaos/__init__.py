"""Measures of chaos: Lyapunov exponents of any system or flow, charts of them, and Poincaré maps.

No figures and no files: :mod:`jaxball.plot` draws the results.
"""

from ...interface.names import interface as _interface
from .chart import chart as chart
from .poincare import chaplygin_top as chaplygin_top, poincare_map as poincare_map, rolling_robot as rolling_robot
from .spectrum import lyapunov_spectrum as lyapunov_spectrum, lyapunov_spectrum_of as lyapunov_spectrum_of

__all__, __dir__ = _interface(globals())
