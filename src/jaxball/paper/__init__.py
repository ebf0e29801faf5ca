"""Putkaradze & Rogers (2018): their disk and ball, 30-digit solutions, and their figures reproduced.

``reference`` contains the solutions; ``reproduce`` draws the figures and measures the solvers.
"""

from ..interface.names import interface as _interface
from .systems import (
    BALL_RAIL_DIRECTIONS as BALL_RAIL_DIRECTIONS,
    BALL_RAIL_RADII as BALL_RAIL_RADII,
    BALL_THETA as BALL_THETA,
    BALL_TOLERANCE as BALL_TOLERANCE,
    DISK_RAIL_RADII as DISK_RAIL_RADII,
    DISK_THETA as DISK_THETA,
    DISK_TOLERANCE as DISK_TOLERANCE,
    PAPER_END as PAPER_END,
    PAPER_START as PAPER_START,
    ball as ball,
    disk as disk,
)

__all__, __dir__ = _interface(globals(), "reference", "reproduce")
