"""Studies: a scenario run over and over, with other numbers in each row.

:mod:`jaxball.simulation.ensemble` solves the rows, and :mod:`jaxball.plot` draws them.
"""

from ...interface.names import interface as _interface
from .dataset import open_store as open_store
from .files import StoreError as StoreError, StudyError as StudyError, WorkerError as WorkerError
from .study import load_study as load_study, read_study as read_study

__all__, __dir__ = _interface(globals())
