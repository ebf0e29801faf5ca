"""Mechanisms of joints and masses inside the body, and the forces that drive them."""

from .forces import (
    AbstractJointForce as AbstractJointForce,
    Damper as Damper,
    EndStops as EndStops,
    FunctionJointForce as FunctionJointForce,
    JointForces as JointForces,
    Motor as Motor,
    PDServo as PDServo,
    SpeedLimitedMotor as SpeedLimitedMotor,
    Spring as Spring,
)
from .joints import (
    AbstractJoint as AbstractJoint,
    Accelerated as Accelerated,
    Carriage as Carriage,
    Drive as Drive,
    Hinge as Hinge,
    Slider as Slider,
)
from .mechanism import (
    AbstractMechanism as AbstractMechanism,
    CarriedMass as CarriedMass,
    FunctionMechanism as FunctionMechanism,
    Mechanism as Mechanism,
)
