"""Scenario files: a run as human-readable text, checked before anything is computed.

Users, the command line and the packages that take or write whole scenarios use these names.
:mod:`jaxball.studies.sweep` and :mod:`jaxball.studies.design`, which read scenarios that vary, use its modules as well.
"""

TYPE_CHECKING = False

if TYPE_CHECKING:  # for type checkers and editors, the same interface
    from .feedback import (
        AbstractFeedbackSettings as AbstractFeedbackSettings,
        EstimatorSettings as EstimatorSettings,
        FeedforwardSettings as FeedforwardSettings,
        PredictiveSettings as PredictiveSettings,
        RegulatorSettings as RegulatorSettings,
    )
    from .files import read_document as read_document
    from .logs import LogError as LogError, load_log as load_log
    from .sources import builtin_scenarios as builtin_scenarios
    from .units import Units as Units
else:
    from ...interface.names import lazy_interface

    __all__, __dir__, __getattr__ = lazy_interface(__name__)
