"""Robots as environments in which policies are trained: ``reset`` and ``step`` as pure functions of arrays.

An :class:`Environment` holds a robot whose inputs are set at each sample, a goal, what is observed and what is
rewarded, and draws a start, parameters and a delay at each reset. A step is the exact flow over a sample, as in
:mod:`jaxball.control`, with derivatives. ``gymnasium_env``, ``gymnasium_vector_env`` and :class:`BraxEnvironment` are
adapters to what libraries of reinforcement learning take. No figures, no files and no algorithm of learning.
"""

from ..interface.names import interface as _interface
from ..programs.batches import in_lanes as in_lanes
from .adapters import (
    BraxEnvironment as BraxEnvironment,
    BraxState as BraxState,
    gymnasium_env as gymnasium_env,
    gymnasium_vector_env as gymnasium_vector_env,
)
from .environment import Environment as Environment, Episode as Episode, Transition as Transition
from .observations import (
    AbstractObservation as AbstractObservation,
    ObservedSensors as ObservedSensors,
    ObservedState as ObservedState,
)
from .randomisation import (
    AbstractDistribution as AbstractDistribution,
    Factor as Factor,
    Normal as Normal,
    Uniform as Uniform,
)
from .tasks import (
    AbstractGoal as AbstractGoal,
    AbstractReward as AbstractReward,
    FollowPath as FollowPath,
    HoldSpeed as HoldSpeed,
    Moment as Moment,
    QuadraticReward as QuadraticReward,
    ReachPoint as ReachPoint,
)

__all__, __dir__ = _interface(globals())
