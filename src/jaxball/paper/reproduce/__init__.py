"""The paper's two runs reproduced: the figures of sections 4 and 5, and solvers against a 30-digit reference."""

from ...interface.names import interface as _interface
from .compare import Comparison as Comparison, compare_solvers as compare_solvers
from .experiments import (
    SOLVERS as SOLVERS,
    Experiment as Experiment,
    Measurement as Measurement,
    ball_experiment as ball_experiment,
    disk_experiment as disk_experiment,
)
from .run import reproduce as reproduce

__all__, __dir__ = _interface(globals())
