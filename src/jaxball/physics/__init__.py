"""The mechanics: the parts of systems, their equations of motion, and the observables of their states.

Pure functions of arrays: no integrator, no figures and no files are imported here. The names here are those that
``jaxball`` itself has not: further rails, grounds, joints and forces, states of parts of a motion, and the contracts of
what users write themselves.
"""

TYPE_CHECKING = False

if TYPE_CHECKING:  # for type checkers and editors, the same interface
    from . import classical as classical, sensors as sensors
    from .contact.law import (
        AbstractFriction as AbstractFriction,
        LimitSurface as LimitSurface,
        SmoothedCoulomb as SmoothedCoulomb,
    )
    from .contact.modes import Mode as Mode, SwitchCause as SwitchCause
    from .contact.released import ReleasedState as ReleasedState
    from .forces.force import (
        AbstractForce as AbstractForce,
        AbstractWrench as AbstractWrench,
        BodyMotion as BodyMotion,
        HarmonicForce as HarmonicForce,
    )
    from .forces.resistance import AbstractResistance as AbstractResistance
    from .grounds import (
        AbstractSurface as AbstractSurface,
        Cylinder as Cylinder,
        MovingFrame as MovingFrame,
        Paraboloid as Paraboloid,
        ParametricSurface as ParametricSurface,
        SignedDistance as SignedDistance,
        SphereOutside as SphereOutside,
        TiltingPlane as TiltingPlane,
        Turn as Turn,
        Washboard as Washboard,
    )
    from .mechanisms import (
        AbstractJointForce as AbstractJointForce,
        FunctionJointForce as FunctionJointForce,
        FunctionMechanism as FunctionMechanism,
        JointForces as JointForces,
        MajdSimaanFriction as MajdSimaanFriction,
        SpeedLimitedMotor as SpeedLimitedMotor,
        double_pendulum as double_pendulum,
        gyroscopic_pendulum as gyroscopic_pendulum,
        mass_in_tube as mass_in_tube,
        turning_rail as turning_rail,
    )
    from .own_states import OwnStates as OwnStates, odometer as odometer
    from .prescribed.frames import AbstractFrame as AbstractFrame, VersorFrame as VersorFrame
    from .prescribed.rails import BernoulliEight as BernoulliEight, GeronoEight as GeronoEight
    from .prescribed.signals import (
        AbstractSignal as AbstractSignal,
    )
    from .rolling import AbstractRollingSystem as AbstractRollingSystem, Reaction as Reaction
    from .shape import Ellipsoid as Ellipsoid, SupportFunction as SupportFunction
    from .state import ReducedState as ReducedState, RotationState as RotationState
    from .system import AbstractState as AbstractState, vector_field as vector_field
else:
    from ..interface.names import lazy_interface

    __all__, __dir__, __getattr__ = lazy_interface(__name__)
