"""Studies: a scenario run over and over, with other numbers in each row.

:mod:`jaxball.ensemble` solves the rows, and :mod:`jaxball.plot` draws them.
"""

from ..interface.names import interface as _interface
from .batch import Batch as Batch, Engine as Engine, Wanted as Wanted
from .chosen import row_events as row_events, row_scenarios as row_scenarios
from .dataset import open_dataset as open_dataset, open_grid as open_grid
from .engine import solve_in_lanes as solve_in_lanes
from .errors import StoreError as StoreError, StudyError as StudyError, WorkerError as WorkerError
from .estimate import Estimate as Estimate, estimate as estimate
from .run import Outcome as Outcome, sweep as sweep
from .state import describe as describe
from .study import Study as Study, load_study as load_study, read_study as read_study

__all__, __dir__ = _interface(globals())
