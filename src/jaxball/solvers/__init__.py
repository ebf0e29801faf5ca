"""Solvers for diffrax: collocation of Radau and Gauss, mass matrices, trapezoidal rule, TR-BDF2, Adams methods, NDFs.

They are for any problem of diffrax, and contain nothing specific to mechanics.
"""

from ..interface.names import interface as _interface
from .adams import Adams as Adams
from .base import explain as explain
from .collocation import (
    AbstractErrorEstimate as AbstractErrorEstimate,
    EmbeddedError as EmbeddedError,
    Gauss as Gauss,
    RadauIIA as RadauIIA,
    StepError as StepError,
    TailError as TailError,
)
from .consistency import InitialValues as InitialValues, consistent_initial_values as consistent_initial_values
from .diagonal import TRBDF2 as TRBDF2, Trapezoidal as Trapezoidal
from .kinks import StepToKinks as StepToKinks
from .mass import (
    AbstractMassTerm as AbstractMassTerm,
    MassMatrixTerm as MassMatrixTerm,
    SwitchingMassMatrixTerm as SwitchingMassMatrixTerm,
)
from .multistep import AdamsController as AdamsController, NDFController as NDFController
from .ndf import NDF as NDF
from .stages import (
    AbstractStageIteration as AbstractStageIteration,
    FixedPoint as FixedPoint,
    SimplifiedNewton as SimplifiedNewton,
)
from .wrapping import (
    AbstractWrappingSolver as AbstractWrappingSolver,
    Projected as Projected,
    ProjectedSteps as ProjectedSteps,
)

__all__, __dir__ = _interface(globals())
