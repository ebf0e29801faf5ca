"""Solvers compared at equal achieved error: ``python -m benchmarks``.

A compared package is imported only when it takes part.
"""

from jaxball.interface.names import interface as _interface

from .measure import Measured as Measured, Row as Row, Settings as Settings
from .problem import Problem as Problem
from .run import (
    FULL as FULL,
    QUICK as QUICK,
    Bench as Bench,
    Plan as Plan,
    SelectionError as SelectionError,
    compare as compare,
    listing as listing,
    plan as plan,
    select_contenders as select_contenders,
    select_problems as select_problems,
)

__all__, __dir__ = _interface(globals())
