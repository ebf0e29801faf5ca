"""Objectives: what a design makes small."""

from .base import (
    AbstractObjective as AbstractObjective,
    AbstractRunningObjective as AbstractRunningObjective,
)
from .effort import (
    AccelerationEffort as AccelerationEffort,
    ForceEffort as ForceEffort,
    PowerEffort as PowerEffort,
)
from .ends import (
    Balanced as Balanced,
    Duration as Duration,
    GoFar as GoFar,
    ReachPlace as ReachPlace,
    ReachPose as ReachPose,
    StopAtRest as StopAtRest,
)
from .masses import MassesNearCentre as MassesNearCentre
from .obstacles import AvoidObstacles as AvoidObstacles
from .paths import (
    FollowCurve as FollowCurve,
    FollowTrajectory as FollowTrajectory,
    LargestDistance as LargestDistance,
)
