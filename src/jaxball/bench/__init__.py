"""Solvers compared at equal achieved error: ``jaxball bench``.

A compared package is imported only when it takes part. No other package of jaxball needs this one.
"""

from ..interface.names import interface as _interface
from .measure import Measured as Measured, Row as Row, Settings as Settings
from .plan import (
    FULL as FULL,
    QUICK as QUICK,
    Plan as Plan,
    SelectionError as SelectionError,
    listing as listing,
    plan as plan,
    select_contenders as select_contenders,
    select_problems as select_problems,
)
from .problem import Problem as Problem
from .run import Bench as Bench, bench as bench

__all__, __dir__ = _interface(globals())
