"""Design of rails, motions and parameters that make a ball do what is wanted, by gradients through the simulation.

``problem`` defines what is designed: a scenario with variables, whose runs have ``objectives`` and ``constraints``,
also for slightly perturbed balls. ``search`` solves it, and verifies the design by other means. ``optimal_control``
finds motions of any shape, by equations and their ``continuation``. ``files`` reads problems of both kinds, ``report``
describes what was found, and ``result`` loads it. ``identify`` finds a body's parameters from its path. Only the
command line uses this package.
"""

from ...interface.names import interface as _interface
from . import optimal_control as optimal_control
from .constraints import (
    AccelerationLimit as AccelerationLimit,
    ClearOfObstacles as ClearOfObstacles,
    ForceLimit as ForceLimit,
    Friction as Friction,
    FunctionConstraint as FunctionConstraint,
    FunctionRunningConstraint as FunctionRunningConstraint,
    JointEffortLimit as JointEffortLimit,
    MassesApart as MassesApart,
    NormalForce as NormalForce,
    OnGround as OnGround,
    RailsApart as RailsApart,
    RailsInside as RailsInside,
    RegularRails as RegularRails,
    SpeedLimit as SpeedLimit,
    Within as Within,
)
from .continuation import follow as follow
from .files import load_problem as load_problem, read_problem as read_problem
from .objectives import (
    AccelerationEffort as AccelerationEffort,
    AvoidObstacles as AvoidObstacles,
    Balanced as Balanced,
    Duration as Duration,
    FollowCurve as FollowCurve,
    FollowTrajectory as FollowTrajectory,
    ForceEffort as ForceEffort,
    FunctionObjective as FunctionObjective,
    FunctionRunningObjective as FunctionRunningObjective,
    GoFar as GoFar,
    JointEffort as JointEffort,
    LargestDistance as LargestDistance,
    MassesNearCentre as MassesNearCentre,
    PowerEffort as PowerEffort,
    ReachPlace as ReachPlace,
    ReachPose as ReachPose,
    StopAtRest as StopAtRest,
)
from .problem.problem import Perturbations as Perturbations, Problem as Problem
from .problem.requirements import (
    AbstractConstraint as AbstractConstraint,
    AbstractCurve as AbstractCurve,
    AbstractObjective as AbstractObjective,
    AbstractRunningConstraint as AbstractRunningConstraint,
    AbstractRunningObjective as AbstractRunningObjective,
    FigureEight as FigureEight,
    Sigmoid as Sigmoid,
    Through as Through,
)
from .problem.run import Solve as Solve
from .problem.space import DesignError as DesignError, DesignSpace as DesignSpace, Variable as Variable
from .result import load_result as load_result
from .search.program import Settings as Settings

__all__, __dir__ = _interface(globals(), "optimal_control")
