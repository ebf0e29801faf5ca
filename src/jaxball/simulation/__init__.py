"""From a system and times to its motion: the solve, its trajectory, events, extremes and equilibria.

Single runs; many at once are in ``ensemble``, and the implicit methods in ``solvers``.
"""

TYPE_CHECKING = False

if TYPE_CHECKING:  # for type checkers and editors, the same interface
    from ..interface.status import KinkWarning as KinkWarning
    from . import ensemble as ensemble, solvers as solvers
    from .arguments import PrecisionError as PrecisionError
    from .equilibrium import with_angles as with_angles
    from .events import AbstractEvent as AbstractEvent
    from .global_error import estimate_error_of as estimate_error_of
else:
    from ..interface.names import lazy_interface

    __all__, __dir__, __getattr__ = lazy_interface(__name__)

DEFAULT_TOLERANCE = 1e-10
MOST_STEPS = 10**9  # which take days, and which a counter of 32 bits holds
