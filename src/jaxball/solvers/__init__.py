"""Solvers for diffrax: collocation of Radau and Gauss, mass matrices, trapezoidal rule, TR-BDF2, Adams methods, NDFs.

They are for any problem of diffrax, and contain nothing specific to mechanics.
"""

from ..interface.names import interface as _interface
from .adams import Adams as Adams
from .consistency import InitialValues as InitialValues, consistent_initial_values as consistent_initial_values
from .errors import (
    AbstractErrorEstimate as AbstractErrorEstimate,
    EmbeddedError as EmbeddedError,
    StepError as StepError,
    TailError as TailError,
)
from .fixed_point import FixedPoint as FixedPoint
from .gauss import Gauss as Gauss
from .kinks import StepToKinks as StepToKinks
from .mass import (
    AbstractMassTerm as AbstractMassTerm,
    MassMatrixTerm as MassMatrixTerm,
    SwitchingMassMatrixTerm as SwitchingMassMatrixTerm,
)
from .multistep_controller import AdamsController as AdamsController, NDFController as NDFController
from .ndf import NDF as NDF
from .newton import SimplifiedNewton as SimplifiedNewton
from .outcome import explain as explain
from .projection import Projected as Projected
from .radau import RadauIIA as RadauIIA
from .stages import AbstractStageIteration as AbstractStageIteration
from .tr_bdf2 import TRBDF2 as TRBDF2
from .trapezoidal import Trapezoidal as Trapezoidal
from .wrapping import AbstractWrappingSolver as AbstractWrappingSolver

__all__, __dir__ = _interface(globals())
