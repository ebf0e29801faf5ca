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
    HardStops as HardStops,
    Hinge as Hinge,
    JointFriction as JointFriction,
    MajdSimaanFriction as MajdSimaanFriction,
    Slider as Slider,
)
from .mechanism import (
    AbstractMechanism as AbstractMechanism,
    CarriedMass as CarriedMass,
    FunctionMechanism as FunctionMechanism,
    Mechanism as Mechanism,
)
from .robots import (
    double_pendulum as double_pendulum,
    gyroscopic_pendulum as gyroscopic_pendulum,
    mass_in_tube as mass_in_tube,
    planar_pendulum as planar_pendulum,
    rigid_body_masses as rigid_body_masses,
    ring_rotor as ring_rotor,
    spherical_pendulum as spherical_pendulum,
    turning_rail as turning_rail,
)
