"""Rails ζ(θ): the curves, fixed in the ball, along which point masses move."""

from .base import AbstractRail as AbstractRail
from .fourier import FourierRail as FourierRail
from .function import FunctionRail as FunctionRail
from .planar import (
    AbstractPlanarRail as AbstractPlanarRail,
    BernoulliEight as BernoulliEight,
    Circle as Circle,
    Ellipse as Ellipse,
    GeronoEight as GeronoEight,
)
from .spline import SplineRail as SplineRail
from .tube import Tube as Tube
