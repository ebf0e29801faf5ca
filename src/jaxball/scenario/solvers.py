"""The solvers that a scenario can name. Their packages are imported only when a solver is made."""

import functools
import importlib
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import diffrax


def _made(package: str, solver: str, **settings: Any) -> Any:
    return getattr(importlib.import_module(package), solver)(**settings)


def _of_diffrax(solver: str) -> Callable[[], Any]:
    return functools.partial(_made, "diffrax", solver)


def _of_jaxball(solver: str, **settings: Any) -> Callable[[], Any]:
    return functools.partial(_made, "jaxball.solvers", solver, **settings)


# The order of Radau IIA is part of its name, as in the codes of Hairer & Wanner.
KNOW_MASS_MATRICES: "Mapping[str, Callable[[], diffrax.AbstractAdaptiveSolver]]" = {
    f"radau{2 * stages - 1}": _of_jaxball("RadauIIA", stages=stages) for stages in (3, 5, 7)
} | {"ndf": _of_jaxball("NDF")}
SOLVERS: "Mapping[str, Callable[[], diffrax.AbstractAdaptiveSolver]]" = {
    "dopri5": _of_diffrax("Dopri5"),
    "dopri8": _of_diffrax("Dopri8"),
    "tsit5": _of_diffrax("Tsit5"),
    "kvaerno3": _of_diffrax("Kvaerno3"),
    "kvaerno5": _of_diffrax("Kvaerno5"),
    "adams": _of_jaxball("Adams"),
    **KNOW_MASS_MATRICES,
    "gauss16": _of_jaxball("Gauss", stages=8),
    "trapezoidal": _of_jaxball("Trapezoidal"),
    "tr-bdf2": _of_jaxball("TRBDF2"),
}
