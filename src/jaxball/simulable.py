"""Every system that can be simulated, and every state of one; for type checkers a ball or a disk by default."""

from typing_extensions import TypeVar

from .body import System
from .classical import AbstractClassicalState, AbstractClassicalSystem
from .state import State

SimulableSystem = System | AbstractClassicalSystem
SimulableState = State | AbstractClassicalState
AnySimulableSystem = TypeVar("AnySimulableSystem", bound=SimulableSystem, default=System)
AnySimulableState = TypeVar("AnySimulableState", bound=SimulableState, default=State)
