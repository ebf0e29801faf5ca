"""The solver of a scenario file."""

from dataclasses import dataclass
from typing import Any

from ..classical import NonholonomicParticle, VakonomicParticle
from ..physics.body import Disk
from ..physics.contact_law import Contact
from ..physics.system import AbstractSystem
from ..simulation.defaults import DEFAULT_TOLERANCE
from .imports import is_python_name
from .solvers import KNOW_MASS_MATRICES, SOLVERS, own_solver
from .table import Key
from .values import POSITIVE, Choice, Flag, Integer, Numbers, ScenarioError


@dataclass(frozen=True)
class _Solver(Choice):
    """The name of a solver, or of a user's class of solvers."""

    def read(self, value: Any, path: str) -> str:
        if is_python_name(value):
            own_solver(value, path)
            return value
        return super().read(value, path)


SOLVE = {
    "solver": Key(_Solver(tuple(SOLVERS)), "dopri8"),
    "rtol": Key(Numbers(rule=POSITIVE), DEFAULT_TOLERANCE),
    "atol": Key(Numbers(rule=POSITIVE), DEFAULT_TOLERANCE),
    "max_steps": Key(Integer(1, 10**9), 16384),
    "step_to_times": Key(Flag(), False),
    "dae": Key(Flag(), False),
    "project": Key(Flag(), False),
}


def check_dae(
    system: AbstractSystem, contact: Contact | None, solver: str, dae: bool, named: str = "Key `solve.solver`"
) -> None:
    """Raises a :class:`ScenarioError` where the differential-algebraic form is asked for but does not exist.

    The message calls the solver as ``named``.
    """
    if dae and isinstance(system, Disk):
        raise ScenarioError(
            "Key `solve.dae` must be false for a disk, whose state has no versor, but it is true; use a ball."
        )
    if dae and isinstance(system, NonholonomicParticle | VakonomicParticle):
        raise ScenarioError("Key `solve.dae` must be false for a particle, whose state has no versor, but it is true.")
    if dae and contact is not None:
        raise ScenarioError(
            "Key `solve.dae` must be false with `contact`, whose modes are differential equations, but it is true."
        )
    if dae and solver not in KNOW_MASS_MATRICES:
        names = ", ".join(f'"{name}"' for name in KNOW_MASS_MATRICES)
        raise ScenarioError(
            f"{named} must be one of {names} where `solve.dae` is true, because other solvers do not support a mass "
            f'matrix, but it is "{solver}".'
        )
