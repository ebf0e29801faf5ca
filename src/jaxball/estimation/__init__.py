"""What a robot knows of its state: filters and smoothers of its sensors' readings.

``ErrorStateFilter`` estimates the state, and the biases of sensors, from readings with errors
(:class:`jaxball.sensors.SensorErrors`) and the exact flow of the simulation between them; ``OutputFeedback`` holds a
motion by such estimates. ``fit`` finds parameters and the initial state from a log. No figures and no files:
:mod:`jaxball.plot` draws the results. Estimates of the parameters of a scenario from a path are in
:mod:`jaxball.design`.
"""

TYPE_CHECKING = False

if TYPE_CHECKING:  # for type checkers and editors, the same interface
    from .estimate import (
        AbstractEstimate as AbstractEstimate,
        Estimate as Estimate,
        LoopEstimate as LoopEstimate,
        chi2_bounds as chi2_bounds,
    )
    from .filter import ErrorStateFilter as ErrorStateFilter
    from .fitting import Fit as Fit, Log as Log, fit as fit
    from .output_feedback import OutputFeedback as OutputFeedback
else:
    from ..interface.names import lazy_interface

    __all__, __dir__, __getattr__ = lazy_interface(__name__)
