"""Sensors on a body and on what it carries: their readings along a run, exact or with errors."""

from ..interface.names import interface as _interface
from .base import AbstractSensor as AbstractSensor
from .camera import Position as Position
from .errors import SensorErrors as SensorErrors
from .inertial import Accelerometer as Accelerometer, Gyroscope as Gyroscope
from .joints import Encoder as Encoder, Tachometer as Tachometer

__all__, __dir__ = _interface(globals())
