"""Solvers."""
from .errors import EmbeddedError, StepError, TailError
from .fixed_point import FixedPoint
from .gauss import Gauss
from .mass import MassMatrixTerm, SwitchingMassMatrixTerm
from .newton import SimplifiedNewton
from .radau import RadauIIA
