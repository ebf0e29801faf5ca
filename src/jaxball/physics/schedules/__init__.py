"""Schedules θ(t): where a mass is on its rail, prescribed in closed form."""

from .base import AbstractSchedule as AbstractSchedule
from .function import FunctionSchedule as FunctionSchedule
from .harmonic import ConstantRate as ConstantRate, Sinusoids as Sinusoids
from .piecewise import PiecewiseAcceleration as PiecewiseAcceleration
from .pulse import Pulse as Pulse
from .waypoints import Waypoints as Waypoints
