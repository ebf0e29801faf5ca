"""Classical systems of mechanics, those of the appendix of Putkaradze & Rogers (2018) and others, with their laws.

:class:`LagrangianSystem` makes one of a Lagrangian, with or without constraints.

:func:`jaxball.simulate` takes them like a ball, and also a user's own system: an :class:`AbstractClassicalSystem` with
an :class:`AbstractClassicalState`. No integrator, no figures and no files are imported here.
"""

from ..interface.names import interface as _interface
from .ellipsoid import (
    EllipsoidLaws as EllipsoidLaws,
    EllipsoidState as EllipsoidState,
    RollingEllipsoid as RollingEllipsoid,
)
from .from_functions import LagrangianSystem as LagrangianSystem
from .heavy_top import HeavyTop as HeavyTop, HeavyTopLaws as HeavyTopLaws
from .lagrangian import (
    AbstractLagrangianSystem as AbstractLagrangianSystem,
    HolonomicLaws as HolonomicLaws,
    LagrangianLaws as LagrangianLaws,
    LagrangianState as LagrangianState,
    NonholonomicLaws as NonholonomicLaws,
)
from .nonholonomic import (
    ChaplyginSleigh as ChaplyginSleigh,
    KnifeEdge as KnifeEdge,
    RollerRacer as RollerRacer,
    RollingCoin as RollingCoin,
    Snakeboard as Snakeboard,
)
from .particle import (
    NonholonomicParticle as NonholonomicParticle,
    ParticleLaws as ParticleLaws,
    VakonomicLaws as VakonomicLaws,
    VakonomicParticle as VakonomicParticle,
)
from .rigid_body import FreeBodyLaws as FreeBodyLaws, FreeRigidBody as FreeRigidBody
from .rows import DryFriction as DryFriction, UnilateralContact as UnilateralContact
from .state import (
    AbstractClassicalState as AbstractClassicalState,
    AbstractClassicalSystem as AbstractClassicalSystem,
    ParticleState as ParticleState,
    RigidBodyState as RigidBodyState,
    VakonomicState as VakonomicState,
)
from .suslov import (
    AbstractAxis as AbstractAxis,
    FunctionAxis as FunctionAxis,
    HarmonicAxis as HarmonicAxis,
    SuslovLaws as SuslovLaws,
    SuslovProblem as SuslovProblem,
)

__all__, __dir__ = _interface(globals())
