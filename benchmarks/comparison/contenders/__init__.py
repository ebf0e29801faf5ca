"""The solvers of the benchmark, one file for each package, and their contract.

Nothing here imports a contender's package: a contender imports it when it builds a problem.
"""

import abc
import importlib
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxball.interface.wording import pip_install

from ..problem import Problem

MAX_STEPS_OF_BENCH = 200_000


@dataclass(frozen=True)
class Work:
    """The counts of a solve; None for what a package does not report.

    - ``steps``, ``rejected``: accepted steps, and attempts whose error was too large.
    - ``evaluations``: of the right-hand side, including those for finite-difference Jacobians; where a package
      differentiates exactly, a Jacobian is counted as the package does.
    - ``jacobians``, ``decompositions``: of the iteration of an implicit method.
    """

    steps: int | None = None
    rejected: int | None = None
    evaluations: int | None = None
    jacobians: int | None = None
    decompositions: int | None = None

    def __add__(self, other: "Work") -> "Work":
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return Work(*(None if a is None or b is None else a + b for a, b in pairs))


NO_WORK = Work(0, 0, 0, 0, 0)


@dataclass(frozen=True)
class Outcome:
    """How a solve ended: the state at the end, and a sentence that is empty if the solver reports success."""

    state: Float[np.ndarray, " n"]
    failure: str
    work: Work


class Run(abc.ABC):
    """One problem with one contender at one tolerance."""

    @abc.abstractmethod
    def solve(self) -> Any:
        """The solve from the initial state to the final one only: this is timed."""

    @abc.abstractmethod
    def outcome(self) -> Outcome:
        """The outcome and the work of the same solve; not timed."""


@dataclass(frozen=True)
class Program:
    """One problem, built or compiled for one contender.

    - ``build_time``: how long that took, in seconds, or would have taken if another contender had not done part of it.
    - ``run``: from a relative tolerance to the solve with it; builds whatever depends on the tolerance.
    """

    build_time: float
    run: Callable[[float], Run]


@dataclass(frozen=True)
class Family:
    """The contenders of one package.

    - ``module``: the file beside this one that holds ``program(method, problem) -> Program``.
    - ``packages``: what must be installed besides jaxball.
    - ``extra``: the extra of jaxball that installs them.
    """

    name: str
    module: str
    packages: tuple[str, ...] = ()
    extra: str = "bench"

    def missing(self) -> str | None:
        """Why the family cannot take part here, in a few words; None if it can."""
        absent = [package for package in self.packages if importlib.util.find_spec(package) is None]
        return f"{' and '.join(absent)} {'is' if len(absent) == 1 else 'are'} not installed" if absent else None

    @property
    def remedy(self) -> str:
        """The command that installs what is missing."""
        return pip_install(self.extra)


@dataclass(frozen=True)
class Contender:
    """A solver under the name that figures and tables show.

    - ``method``: its name in the family's module.
    - ``explicit``: left out of stiff problems, where stability rather than accuracy would determine its steps.
    - ``odes``, ``daes``: which problems it can solve.
    """

    name: str
    family: Family
    method: str
    explicit: bool = False
    odes: bool = True
    daes: bool = False

    def refusal(self, problem: Problem) -> str | None:
        """Why the contender does not take part in ``problem``, in a few words; None if it does."""
        dae = problem.constraint is not None
        if dae and not self.daes:
            return "unable to solve DAEs"
        if not dae and not self.odes:
            return "for DAEs only"
        if problem.stiff and self.explicit:
            return "explicit on a stiff problem"
        return None

    def program(self, problem: Problem) -> Program:
        """``problem`` built for this contender; imports the family's packages."""
        module = importlib.import_module(f"{__name__}.{self.family.module}")
        return module.program(self.method, problem)


JAXBALL = Family("jaxball", "diffrax_")
DIFFRAX = Family("diffrax", "diffrax_")
SCIPY = Family("SciPy", "scipy_", ("scipy", "numba"))
NUMBALSODA = Family("numbalsoda", "numbalsoda_", ("numba", "numbalsoda"), extra="numbalsoda")
HEYOKA = Family("heyoka", "heyoka_", ("heyoka",))
CASADI = Family("CasADi", "casadi_", ("casadi",))
FAMILIES = (JAXBALL, DIFFRAX, SCIPY, NUMBALSODA, HEYOKA, CASADI)


def _ours(method: str, *, explicit: bool = False, daes: bool = False) -> Contender:
    return Contender(method, JAXBALL, method, explicit=explicit, daes=daes)


def _theirs(family: Family, method: str, *, explicit: bool = False, daes: bool = False) -> Contender:
    return Contender(f"{family.name} {method}", family, method, explicit=explicit, daes=daes)


# A fixed-point iteration limits the step like an explicit method's stability.
ALL: dict[str, Contender] = {
    contender.name: contender
    for contender in (
        _ours("Adams", explicit=True),
        _ours("Gauss", explicit=True),
        _ours("NDF", daes=True),
        _ours("RadauIIA 3", daes=True),
        _ours("RadauIIA 5", daes=True),
        _ours("RadauIIA 7", daes=True),
        _ours("RadauIIA 7 fixed-point", explicit=True),
        _ours("Trapezoidal", daes=True),
        _ours("TRBDF2", daes=True),
        _theirs(DIFFRAX, "Tsit5", explicit=True),
        _theirs(DIFFRAX, "Dopri5", explicit=True),
        _theirs(DIFFRAX, "Dopri8", explicit=True),
        _theirs(DIFFRAX, "Kvaerno5"),
        _theirs(SCIPY, "RK45", explicit=True),
        _theirs(SCIPY, "DOP853", explicit=True),
        _theirs(SCIPY, "LSODA"),
        _theirs(SCIPY, "Radau"),
        _theirs(SCIPY, "BDF"),
        _theirs(NUMBALSODA, "LSODA"),
        _theirs(NUMBALSODA, "DOP853", explicit=True),
        _theirs(HEYOKA, "Taylor", explicit=True),
        _theirs(CASADI, "CVODES Adams", explicit=True),
        _theirs(CASADI, "CVODES BDF"),
        _theirs(CASADI, "IDAS", daes=True),
    )
}
