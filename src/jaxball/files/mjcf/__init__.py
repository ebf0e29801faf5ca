"""Robots as MJCF, the files of MuJoCo: a ball or a disk with mechanisms, written and read.

Nothing is simulated here, and MuJoCo itself is not needed.
"""

from ...interface.names import interface as _interface
from .elements import MJCFError as MJCFError
from .reading import read_mjcf as read_mjcf
from .writing import to_mjcf as to_mjcf

__all__, __dir__ = _interface(globals())
