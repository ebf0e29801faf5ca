"""Putkaradze & Rogers (2018): their disk and ball, 30-digit solutions, and their figures reproduced.

``reference`` contains the solutions; ``reproduce`` draws the figures and measures the solvers.
"""

TYPE_CHECKING = False

if TYPE_CHECKING:  # for type checkers and editors, the same interface
    from . import reference as reference, reproduce as reproduce
    from .systems import BALL_TOLERANCE as BALL_TOLERANCE, DISK_TOLERANCE as DISK_TOLERANCE, ball as ball, disk as disk
else:
    from ..interface.names import lazy_interface

    __all__, __dir__, __getattr__ = lazy_interface(__name__)
