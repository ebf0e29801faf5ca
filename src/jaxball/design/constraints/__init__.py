"""Constraints that a design must fulfil."""

from .base import AbstractConstraint as AbstractConstraint, AbstractRunningConstraint as AbstractRunningConstraint
from .contact import (
    ClearOfObstacles as ClearOfObstacles,
    Friction as Friction,
    NormalForce as NormalForce,
    Within as Within,
)
from .function import (
    FunctionConstraint as FunctionConstraint,
    FunctionRunningConstraint as FunctionRunningConstraint,
)
from .masses import (
    AccelerationLimit as AccelerationLimit,
    ForceLimit as ForceLimit,
    JointEffortLimit as JointEffortLimit,
    MassesApart as MassesApart,
    SpeedLimit as SpeedLimit,
)
from .rails import RailsApart as RailsApart, RailsInside as RailsInside, RegularRails as RegularRails
