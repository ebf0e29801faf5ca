"""Many runs side by side, as sweeps are solved.

Runs are arrays here; :mod:`jaxball.studies.sweep` reads and writes them as files.
"""

from ...interface.names import interface as _interface
from .reductions import (
    REDUCTIONS as REDUCTIONS,
    AbstractReduction as AbstractReduction,
    Drift as Drift,
    Integral as Integral,
    Maximum as Maximum,
    Minimum as Minimum,
)
from .simulate import simulate_ensemble as simulate_ensemble

__all__, __dir__ = _interface(globals())
