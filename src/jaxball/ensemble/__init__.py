"""Many runs side by side: the way in which sweeps are solved."""

from .ensemble import Ensemble as Ensemble
from .simulate import simulate_ensemble as simulate_ensemble
