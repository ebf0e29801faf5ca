"""The solver of a scenario file."""

import functools
from collections.abc import Callable, Mapping

import diffrax

from ..classical import NonholonomicParticle, VakonomicParticle
from ..physics.body import Disk
from ..physics.system import AbstractSystem
from ..simulation.simulate import DEFAULT_TOLERANCE
from ..solvers import TRBDF2, Gauss, RadauIIA, Trapezoidal
from .table import Key
from .values import POSITIVE, Choice, Flag, Integer, Numbers, ScenarioError

# Those of jaxball have their order in their name, as the codes of Hairer & Wanner do.
KNOW_MASS_MATRICES: Mapping[str, Callable[[], RadauIIA]] = {
    f"radau{2 * stages - 1}": functools.partial(RadauIIA, stages=stages) for stages in (3, 5, 7)
}
SOLVERS: Mapping[str, Callable[[], diffrax.AbstractAdaptiveSolver]] = {
    "dopri5": diffrax.Dopri5,
    "dopri8": diffrax.Dopri8,
    "tsit5": diffrax.Tsit5,
    "kvaerno3": diffrax.Kvaerno3,
    "kvaerno5": diffrax.Kvaerno5,
    **KNOW_MASS_MATRICES,
    "gauss16": functools.partial(Gauss, stages=8),
    "trapezoidal": Trapezoidal,
    "tr-bdf2": TRBDF2,
}

SOLVE = {
    "solver": Key(Choice(tuple(SOLVERS)), "dopri8"),
    "rtol": Key(Numbers(rule=POSITIVE), DEFAULT_TOLERANCE),
    "atol": Key(Numbers(rule=POSITIVE), DEFAULT_TOLERANCE),
    "max_steps": Key(Integer(1, 10**9), 16384),
    "step_to_times": Key(Flag(), False),
    "dae": Key(Flag(), False),
    "project": Key(Flag(), False),
}


def check_dae(system: AbstractSystem, solver: str, dae: bool, named: str = "Key `solve.solver`") -> None:
    """Raises a :class:`ScenarioError` where the differential-algebraic form is asked for and there is none.

    The message calls the solver as ``named``.
    """
    if dae and isinstance(system, Disk):
        raise ScenarioError(
            "Key `solve.dae` must be false for a disk, whose state holds no versor, but it is true; use a ball."
        )
    if dae and isinstance(system, NonholonomicParticle | VakonomicParticle):
        raise ScenarioError(
            "Key `solve.dae` must be false for a particle, whose state holds no versor, but it is true."
        )
    if dae and solver not in KNOW_MASS_MATRICES:
        names = ", ".join(f'"{name}"' for name in KNOW_MASS_MATRICES)
        raise ScenarioError(
            f"{named} must be one of {names} where `solve.dae` is true, because other solvers know no mass "
            f'matrix, but it is "{solver}".'
        )
