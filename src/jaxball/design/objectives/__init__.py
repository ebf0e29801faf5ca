"""Objectives that a design minimises."""

from .actuation import (
    AccelerationEffort as AccelerationEffort,
    ForceEffort as ForceEffort,
    JointEffort as JointEffort,
    MassesNearCentre as MassesNearCentre,
    PowerEffort as PowerEffort,
)
from .base import (
    AbstractObjective as AbstractObjective,
    AbstractRunningObjective as AbstractRunningObjective,
)
from .ends import (
    Balanced as Balanced,
    Duration as Duration,
    GoFar as GoFar,
    ReachPlace as ReachPlace,
    ReachPose as ReachPose,
    StopAtRest as StopAtRest,
)
from .function import (
    FunctionObjective as FunctionObjective,
    FunctionRunningObjective as FunctionRunningObjective,
)
from .paths import (
    AvoidObstacles as AvoidObstacles,
    FollowCurve as FollowCurve,
    FollowTrajectory as FollowTrajectory,
    LargestDistance as LargestDistance,
)
