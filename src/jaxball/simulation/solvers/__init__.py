"""Solvers for diffrax: collocation of Radau and Gauss, mass matrices, trapezoidal rule, TR-BDF2, Adams methods, NDFs.

They are for any problem of diffrax, and contain nothing specific to mechanics.
"""

from ...interface.names import interface as _interface
from .adams import Adams as Adams
from .base import explain as explain
from .collocation import (
    EmbeddedError as EmbeddedError,
    Gauss as Gauss,
    RadauIIA as RadauIIA,
    StepError as StepError,
    TailError as TailError,
)
from .consistency import consistent_initial_values as consistent_initial_values
from .diagonal import TRBDF2 as TRBDF2, Trapezoidal as Trapezoidal
from .mass import MassMatrixTerm as MassMatrixTerm, SwitchingMassMatrixTerm as SwitchingMassMatrixTerm
from .multistep import AdamsController as AdamsController, NDFController as NDFController
from .ndf import NDF as NDF
from .stages import FixedPoint as FixedPoint, SimplifiedNewton as SimplifiedNewton
from .wrapping import Projected as Projected, StepToKinks as StepToKinks

__all__, __dir__ = _interface(globals())
