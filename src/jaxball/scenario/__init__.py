"""Scenario files: a run as human-readable text, checked before anything is computed.

Users, the command line and the packages that take or write whole scenarios use these names. :mod:`jaxball.sweep` and
:mod:`jaxball.design`, which read scenarios that vary, use its modules as well.
"""

TYPE_CHECKING = False

if TYPE_CHECKING:  # for type checkers and editors, the same interface
    from .errors import ScenarioError as ScenarioError
    from .feedback import (
        AbstractFeedbackSettings as AbstractFeedbackSettings,
        EstimatorSettings as EstimatorSettings,
        FeedforwardSettings as FeedforwardSettings,
        PredictiveSettings as PredictiveSettings,
        RegulatorSettings as RegulatorSettings,
    )
    from .files import (
        load_scenario as load_scenario,
        read_document as read_document,
        read_scenario as read_scenario,
        write_scenario as write_scenario,
    )
    from .logs import LogError as LogError, RecordedColumn as RecordedColumn, load_log as load_log
    from .scenario import Scenario as Scenario
    from .sources import (
        builtin_scenarios as builtin_scenarios,
        builtin_text as builtin_text,
        builtin_title as builtin_title,
        scenario_text as scenario_text,
    )
    from .units import Units as Units
else:
    from ..interface.names import lazy_interface

    __all__, __dir__, __getattr__ = lazy_interface(__name__)
