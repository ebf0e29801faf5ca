"""What a robot knows of its state: filters and smoothers of its sensors' readings.

``ErrorStateFilter`` estimates the state, and the biases of sensors, from readings with errors
(:class:`jaxball.physics.sensors.SensorErrors`) and the exact flow of the simulation between them; ``OutputFeedback``
holds a motion by such estimates. ``fit`` of a ``Log`` finds parameters and the initial state. No figures and no files:
an estimate's ``plot`` draws it. Estimates of the parameters of a scenario from a path are in
:mod:`jaxball.studies.design`.
"""

TYPE_CHECKING = False

if TYPE_CHECKING:  # for type checkers and editors, the same interface
    from .estimate import chi2_bounds as chi2_bounds
    from .filter import ErrorStateFilter as ErrorStateFilter
    from .fitting import Log as Log
    from .output_feedback import OutputFeedback as OutputFeedback
else:
    from ...interface.names import lazy_interface

    __all__, __dir__, __getattr__ = lazy_interface(__name__)
