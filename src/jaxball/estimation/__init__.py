"""What a robot knows of its state: filters and smoothers of what its sensors read.

``ErrorStateFilter`` estimates the state, and the biases of sensors, from readings with errors
(:class:`jaxball.sensors.SensorErrors`) and the exact flow of the simulation between them; ``OutputFeedback`` holds a
motion by such estimates. No figures and no files: :mod:`jaxball.plot` draws the results. Estimates of parameters from a
path are in :mod:`jaxball.design`.
"""

from ..interface.names import interface as _interface
from .estimate import Estimate as Estimate, chi2_bounds as chi2_bounds
from .filter import ErrorStateFilter as ErrorStateFilter
from .output_feedback import OutputFeedback as OutputFeedback

__all__, __dir__ = _interface(globals())
