"""Every system that can be simulated, and every state of one; for type checkers a ball or a disk by default."""

from typing import TYPE_CHECKING, Any

from typing_extensions import TypeVar

from ..classical import AbstractClassicalState, AbstractClassicalSystem
from ..interface.arguments import a, refusal
from .body import System
from .state import State

SimulableSystem = System | AbstractClassicalSystem
SimulableState = State | AbstractClassicalState
if TYPE_CHECKING:
    AnySimulableSystem = TypeVar("AnySimulableSystem", bound=SimulableSystem, default=System)
    AnySimulableState = TypeVar("AnySimulableState", bound=SimulableState, default=State)
else:  # from Python 3.13 on, beartype takes a default for all that a value may be
    AnySimulableSystem = TypeVar("AnySimulableSystem", bound=SimulableSystem)
    AnySimulableState = TypeVar("AnySimulableState", bound=SimulableState)


def require_system(system: Any) -> None:
    """Raises a ``TypeError`` unless the argument ``system`` is one that can be simulated."""
    if isinstance(system, SimulableSystem):
        return
    inner = type(getattr(system, "system", None))
    remedy = f"its `system` is {a(inner.__name__)}" if issubclass(inner, SimulableSystem) else ""
    must = "a Ball, a Disk or one of jaxball.classical"
    raise refusal("system", must, system, remedy)
