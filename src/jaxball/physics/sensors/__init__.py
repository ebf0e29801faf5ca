"""Sensors on a body and on what it carries: their readings along a run, exact or with errors."""

from ...interface.names import interface as _interface
from .base import AbstractSensor as AbstractSensor, SensorErrors as SensorErrors
from .mounted import (
    Accelerometer as Accelerometer,
    Encoder as Encoder,
    Gyroscope as Gyroscope,
    Position as Position,
    Tachometer as Tachometer,
)

__all__, __dir__ = _interface(globals())
