"""The solvers that a scenario can name. Their packages are imported only when a solver is made."""

import functools
import importlib
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from .imports import is_python_name

if TYPE_CHECKING:
    import diffrax


def _make_solver(package: str, solver: str, **settings: Any) -> Any:
    return getattr(importlib.import_module(package), solver)(**settings)


def _of_diffrax(solver: str) -> Callable[[], Any]:
    return functools.partial(_make_solver, "diffrax", solver)


def _of_jaxball(solver: str, **settings: Any) -> Callable[[], Any]:
    return functools.partial(_make_solver, "jaxball.simulation.solvers", solver, **settings)


def own_solver(named: str, path: str) -> "diffrax.AbstractAdaptiveSolver":
    """Makes the solver of a user's class "module:Class", without arguments.

    **Raises:** a ``ScenarioError`` that names the key at ``path`` where there is none.
    """
    import diffrax

    from .own import own_class, trying_class

    kind = own_class(named, path, diffrax.AbstractAdaptiveSolver)
    with trying_class(path, named):
        return kind()


class _Solvers(dict[str, Callable[[], "diffrax.AbstractAdaptiveSolver"]]):
    """Those below, and users' by the names of their classes."""

    def __contains__(self, name: object) -> bool:
        return super().__contains__(name) or is_python_name(name)

    def __missing__(self, named: str) -> Callable[[], "diffrax.AbstractAdaptiveSolver"]:
        if not is_python_name(named):
            raise KeyError(named)
        return functools.partial(own_solver, named, "solve.solver")


# The order of Radau IIA is part of its name, as in the codes of Hairer & Wanner.
KNOW_MASS_MATRICES: "Mapping[str, Callable[[], diffrax.AbstractAdaptiveSolver]]" = {
    f"radau{2 * stages - 1}": _of_jaxball("RadauIIA", stages=stages) for stages in (3, 5, 7)
} | {"ndf": _of_jaxball("NDF"), "trapezoidal": _of_jaxball("Trapezoidal"), "tr-bdf2": _of_jaxball("TRBDF2")}
SOLVERS: "Mapping[str, Callable[[], diffrax.AbstractAdaptiveSolver]]" = _Solvers(
    {
        "dopri5": _of_diffrax("Dopri5"),
        "dopri8": _of_diffrax("Dopri8"),
        "tsit5": _of_diffrax("Tsit5"),
        "kvaerno3": _of_diffrax("Kvaerno3"),
        "kvaerno5": _of_diffrax("Kvaerno5"),
        "adams": _of_jaxball("Adams"),
        **KNOW_MASS_MATRICES,
        "gauss16": _of_jaxball("Gauss", stages=8),
    }
)
