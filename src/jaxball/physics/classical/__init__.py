"""Classical systems of mechanics, those of the appendix of Putkaradze & Rogers (2018) and others, with their laws.

:class:`LagrangianSystem` makes one of a Lagrangian, with or without constraints.

:func:`jaxball.simulate` takes them like a ball, and also a user's own system: an :class:`AbstractClassicalSystem` with
an :class:`AbstractClassicalState`. No integrator, no figures and no files are imported here.
"""

from ...interface.names import interface as _interface
from .ellipsoid import EllipsoidState as EllipsoidState, RollingEllipsoid as RollingEllipsoid
from .from_functions import LagrangianSystem as LagrangianSystem
from .lagrangian import AbstractLagrangianSystem as AbstractLagrangianSystem, LagrangianState as LagrangianState
from .nonholonomic import (
    ChaplyginSleigh as ChaplyginSleigh,
    KnifeEdge as KnifeEdge,
    RollerRacer as RollerRacer,
    RollingCoin as RollingCoin,
    Snakeboard as Snakeboard,
)
from .particle import NonholonomicParticle as NonholonomicParticle, VakonomicParticle as VakonomicParticle
from .rigid_body import (
    AbstractAxis as AbstractAxis,
    FreeRigidBody as FreeRigidBody,
    FunctionAxis as FunctionAxis,
    HarmonicAxis as HarmonicAxis,
    HeavyTop as HeavyTop,
    SuslovProblem as SuslovProblem,
)
from .rows import DryFriction as DryFriction, UnilateralContact as UnilateralContact
from .state import (
    AbstractClassicalState as AbstractClassicalState,
    AbstractClassicalSystem as AbstractClassicalSystem,
    ParticleState as ParticleState,
    RigidBodyState as RigidBodyState,
    VakonomicState as VakonomicState,
)

__all__, __dir__ = _interface(globals())
