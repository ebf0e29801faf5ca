"""The paper's two runs reproduced: the figures of sections 4 and 5, and solvers against a 30-digit reference."""

from ...interface.names import interface as _interface
from .run import compare_solvers as compare_solvers, reproduce as reproduce

__all__, __dir__ = _interface(globals())
