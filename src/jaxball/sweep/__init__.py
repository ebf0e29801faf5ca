"""Studies: a scenario run over and over, with other numbers in each row.

:mod:`jaxball.ensemble` solves the rows, and :mod:`jaxball.plot` draws them.
"""

from ..interface.names import interface as _interface
from .dataset import (
    open_dataset as open_dataset,
    open_grid as open_grid,
    row_events as row_events,
    row_scenarios as row_scenarios,
)
from .engine import solve_in_lanes as solve_in_lanes
from .errors import StoreError as StoreError, StudyError as StudyError, WorkerError as WorkerError
from .progress import describe as describe
from .rows import Batch as Batch, Engine as Engine, Request as Request
from .run import Estimate as Estimate, Outcome as Outcome, estimate as estimate, sweep as sweep
from .study import Study as Study, load_study as load_study, read_study as read_study

__all__, __dir__ = _interface(globals())
