"""Result files: a trajectory as a labelled data set, saved, and read back.

Nothing is solved or drawn here.
"""

from ..interface.names import interface as _interface
from ..interface.output import (
    OutputError as OutputError,
    check_destination as check_destination,
    replacing as replacing,
)
from .load import RunError as RunError, load_run as load_run, saved_scenario as saved_scenario
from .save import SUFFIXES as SUFFIXES, save as save, to_dataset as to_dataset

__all__, __dir__ = _interface(globals())
