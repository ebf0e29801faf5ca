"""Many runs side by side: the way in which sweeps are solved."""

from .ensemble import Ensemble as Ensemble
from .quantities import REDUCTIONS as REDUCTIONS
from .reductions import (
    AbstractReduction as AbstractReduction,
    Drift as Drift,
    Integral as Integral,
    Maximum as Maximum,
    Minimum as Minimum,
)
from .simulate import simulate_ensemble as simulate_ensemble
