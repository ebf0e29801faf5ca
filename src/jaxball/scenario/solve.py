"""The solver of a scenario file."""

import diffrax

from ..simulation import DEFAULT_TOLERANCE
from .table import Key
from .values import POSITIVE, Choice, Flag, Integer, Numbers

SOLVERS = {
    "dopri5": diffrax.Dopri5,
    "dopri8": diffrax.Dopri8,
    "tsit5": diffrax.Tsit5,
    "kvaerno3": diffrax.Kvaerno3,
    "kvaerno5": diffrax.Kvaerno5,
}

SOLVE = {
    "solver": Key(Choice(tuple(SOLVERS)), "dopri8"),
    "rtol": Key(Numbers(rule=POSITIVE), DEFAULT_TOLERANCE),
    "atol": Key(Numbers(rule=POSITIVE), DEFAULT_TOLERANCE),
    "max_steps": Key(Integer(1, 10**9), 16384),
    "step_to_times": Key(Flag(), False),
}
