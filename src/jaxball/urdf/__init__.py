"""Robots in URDF, the files of ROS, read as scenarios: a ball with what links and joints carry in it.

Nothing is simulated here, and ROS itself is not needed.
"""

from ..interface.names import interface as _interface
from .elements import URDFError as URDFError
from .reading import from_urdf as from_urdf, read_urdf as read_urdf

__all__, __dir__ = _interface(globals())
