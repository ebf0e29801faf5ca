"""Rails, motions and parameters that make a ball do what is wanted, found by gradients through the simulation."""

from ..interface.names import interface as _interface
from .bounds import Bounds as Bounds
from .check import GradientCheck as GradientCheck, check_gradient as check_gradient, require_good as require_good
from .constraints import (
    AbstractConstraint as AbstractConstraint,
    AccelerationLimit as AccelerationLimit,
    ClearOfObstacles as ClearOfObstacles,
    ForceLimit as ForceLimit,
    Friction as Friction,
    MassesApart as MassesApart,
    NormalForce as NormalForce,
    RailsApart as RailsApart,
    RailsInside as RailsInside,
    RegularRails as RegularRails,
    SpeedLimit as SpeedLimit,
    Within as Within,
)
from .continuation import Branch as Branch, Fold as Fold, follow as follow
from .curves import (
    AbstractCurve as AbstractCurve,
    FigureEight as FigureEight,
    Sigmoid as Sigmoid,
    Through as Through,
)
from .equations import AbstractEquations as AbstractEquations, FunctionEquations as FunctionEquations
from .errors import DesignError as DesignError
from .files import load_problem as load_problem, read_problem as read_problem
from .identify import Identification as Identification, identify as identify
from .objectives import (
    AbstractObjective as AbstractObjective,
    AccelerationEffort as AccelerationEffort,
    AvoidObstacles as AvoidObstacles,
    Balanced as Balanced,
    Duration as Duration,
    FollowCurve as FollowCurve,
    FollowTrajectory as FollowTrajectory,
    ForceEffort as ForceEffort,
    GoFar as GoFar,
    LargestDistance as LargestDistance,
    MassesNearCentre as MassesNearCentre,
    PowerEffort as PowerEffort,
    ReachPlace as ReachPlace,
    ReachPose as ReachPose,
    StopAtRest as StopAtRest,
)
from .optimise import Optimiser as Optimiser
from .perturbations import Perturbations as Perturbations
from .places import Places as Places
from .problem import Evaluation as Evaluation, Problem as Problem
from .program import AbstractProgram as AbstractProgram
from .run import Run as Run, Solve as Solve, run_of as run_of
from .search import Design as Design, design as design
from .settings import Settings as Settings
from .shooting import Shooting as Shooting
from .space import Candidate as Candidate, DesignSpace as DesignSpace
from .state import Progress as Progress, Worth as Worth
from .variables import Variable as Variable
from .verify import Verified as Verified, perturbed as perturbed, verify as verify

__all__, __dir__ = _interface(globals(), "control")
