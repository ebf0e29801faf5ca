"""Sensors on a body and on what it carries: their exact readings at a moment of a run."""

from ..interface.names import interface as _interface
from .base import AbstractSensor as AbstractSensor
from .inertial import Accelerometer as Accelerometer, Gyroscope as Gyroscope
from .joints import Encoder as Encoder, Tachometer as Tachometer

__all__, __dir__ = _interface(globals())
