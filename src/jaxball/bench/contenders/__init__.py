"""The solvers of the benchmark, one file for each package."""

from .base import (
    MAX_STEPS as MAX_STEPS,
    Contender as Contender,
    Family as Family,
    Outcome as Outcome,
    Program as Program,
    Run as Run,
    Work as Work,
)
from .catalogue import ALL as ALL, FAMILIES as FAMILIES
