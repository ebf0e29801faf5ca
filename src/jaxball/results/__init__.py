"""Result files: a trajectory as a labelled data set, and saved."""

from .._interface import interface as _interface
from ..output import (
    OutputError as OutputError,
    check_destination as check_destination,
    replacing as replacing,
)
from .dataset import to_dataset as to_dataset
from .save import SUFFIXES as SUFFIXES, save as save

__all__, __dir__ = _interface(globals())
