"""Scenario files: a run as a text that people can read, checked before anything is computed.

Scenarios that vary, in studies and problems of design, are read by :mod:`jaxball.sweep` and :mod:`jaxball.design`.
"""

from ..interface.names import interface as _interface
from .files import (
    load_scenario as load_scenario,
    read_document as read_document,
    read_scenario as read_scenario,
    scenario_text as scenario_text,
    write_scenario as write_scenario,
)
from .library import (
    builtin_scenarios as builtin_scenarios,
    builtin_text as builtin_text,
    builtin_title as builtin_title,
)
from .scenario import Scenario as Scenario
from .values import ScenarioError as ScenarioError

__all__, __dir__ = _interface(globals())
