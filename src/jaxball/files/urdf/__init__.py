"""Robots in URDF, the files of ROS, read as scenarios: a ball with what links and joints carry in it.

Nothing is simulated here, and ROS itself is not needed.
"""

from ...interface.names import interface as _interface
from .reading import read_urdf as read_urdf
from .tree import URDFError as URDFError

__all__, __dir__ = _interface(globals())
