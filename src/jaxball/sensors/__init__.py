"""Sensors on a body and on what it carries: their readings along a run, exact or with errors."""

from ..interface.names import interface as _interface
from .base import AbstractSensor as AbstractSensor
from .errors import SensorErrors as SensorErrors
from .joints import Encoder as Encoder, Tachometer as Tachometer
from .mounted import Accelerometer as Accelerometer, Gyroscope as Gyroscope, Position as Position

__all__, __dir__ = _interface(globals())
