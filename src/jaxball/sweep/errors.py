"""The errors of a sweep."""

from ..interface.output import OutputError
from ..scenario import ScenarioError


class StudyError(ScenarioError):
    """A study cannot be read; the message is one sentence that names the key or the row."""


class StoreError(OutputError):
    """A store cannot be written or does not belong to the study; the message is one sentence that names it."""


class WorkerError(RuntimeError):
    """A worker ended before its chunk did."""
