"""Robots as environments in which policies are trained: ``reset`` and ``step`` as pure functions of arrays.

An :class:`Environment` holds a robot whose inputs are set at each sample, a goal, what is observed and what is
rewarded, and draws a start, parameters and a delay at each reset. A step is the exact flow over a sample, as in
:mod:`jaxball.control`, with derivatives. Its ``gymnasium``, ``gymnasium_vector`` and ``brax`` are what
libraries of reinforcement learning take. No figures, no files and no algorithm of learning.
"""

from ...interface.names import interface as _interface
from ...programs.batches import in_lanes as in_lanes
from .environment import Environment as Environment
from .observations import (
    AbstractObservation as AbstractObservation,
    ObservedSensors as ObservedSensors,
    ObservedState as ObservedState,
)
from .tasks import (
    AbstractDistribution as AbstractDistribution,
    AbstractGoal as AbstractGoal,
    AbstractReward as AbstractReward,
    Factor as Factor,
    FollowPath as FollowPath,
    HoldSpeed as HoldSpeed,
    Normal as Normal,
    QuadraticReward as QuadraticReward,
    ReachPoint as ReachPoint,
    Uniform as Uniform,
)

__all__, __dir__ = _interface(globals())
