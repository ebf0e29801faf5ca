"""The times and the solver of a scenario file."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ...numerics.declare import INCREASING, POSITIVE, TIME
from ...physics.body import Disk
from ...physics.classical import AbstractLagrangianSystem, NonholonomicParticle, VakonomicParticle
from ...physics.contact.law import Contact
from ...physics.system import AbstractSystem
from ...simulation import DEFAULT_TOLERANCE, MOST_STEPS
from .errors import ScenarioError, key_error
from .imports import is_python_name
from .solvers import KNOW_MASS_MATRICES, SOLVERS, own_solver
from .table import Key, read_one_of
from .values import Choice, Flag, Integer, Numbers, namespace, number, require

MOST_SAVES = 10_000_000
ROUNDINGS_APART = 4 * float(np.finfo(float).eps)  # times further apart than this share of the later differ when rounded
_SPAN = {
    "start": Key(Numbers(dimension=TIME), says="the first time"),
    "end": Key(Numbers(dimension=TIME), says="the last time, after `start`"),
}
TIMES = {
    "saves": {**_SPAN, "saves": Key(Integer(2, MOST_SAVES), says="how many times, both ends included")},
    "step": {
        **_SPAN,
        "step": Key(
            Numbers(rule=POSITIVE, dimension=TIME), says="the interval between times, which must divide the span"
        ),
    },
    "at": {"at": Key(Numbers((None,), INCREASING, TIME), says="the times themselves, two or more")},
}


class SaveTimes(NamedTuple):
    """The save times of a run: ``count`` of them from ``start`` to ``end``, equally spaced or else ``listed``.

    Each is a number, or an array, that may be traced, and may have a leading axis of runs.
    """

    start: Any
    end: Any
    count: Any
    listed: Any = None

    def array(self, count: int) -> Any:
        """Returns the ``count`` times."""
        if self.listed is not None:
            return self.listed
        xp = namespace(self.start, self.end)
        return xp.linspace(self.start, self.end, count, axis=-1)


def read_times(values: Any, path: str) -> SaveTimes:
    """Reads the save times, given by their number, by the step between them, or one by one."""
    choice, table = read_one_of(values, path, TIMES)
    if choice == "at":
        save_times = table["at"]
        if save_times.size < 2:
            raise key_error(f"{path}.at", "a list of two times or more", str(save_times.tolist()))
        start, end = number(save_times[0]), number(save_times[-1])
        _check_span(start, end, f"{path}.at")
        return SaveTimes(start, end, save_times.size, save_times)
    start, end = table["start"], table["end"]
    require(end > start, f"{path}.end", f"later than `start` = {start!r}", lambda: repr(end))
    _check_span(start, end, f"{path}.end")
    if choice == "saves":
        saves, xp = table["saves"], namespace(start, end)
        # Times that differ by less are equal when they are computed from their number.
        apart = end - start > (saves - 1) * ROUNDINGS_APART * xp.maximum(abs(start), abs(end))
        require(apart, f"{path}.saves", "few enough for the times to differ", lambda: repr(saves))
        return SaveTimes(start, end, saves)
    return SaveTimes(start, end, _intervals(start, end, table["step"], f"{path}.step") + 1)


def _intervals(start: Any, end: Any, step: Any, path: str) -> Any:
    """Counts the steps from ``start`` to ``end``."""
    xp = namespace(start, end, step)
    intervals = (end - start) / step
    whole = xp.rint(intervals)
    # A step such as 0.1 is rounded, and does not divide the span exactly.
    require(
        (intervals <= MOST_SAVES) & (whole >= 1) & (abs(intervals - whole) <= 1e-9 * intervals),
        path,
        f"the span from {start!r} to {end!r} divided by a whole number of at most {MOST_SAVES}",
        lambda: repr(step),
    )
    return whole if xp is not np else int(whole)


def _check_span(start: Any, end: Any, path: str) -> None:
    finite = namespace(start, end).isfinite(end - start)
    require(finite, path, "times whose differences are finite numbers", lambda: f"from {start!r} to {end!r}")


def write_times(times: np.ndarray) -> dict[str, Any]:
    """Returns the table [time]: the number of equally spaced times, or else every time."""
    even = np.linspace(times[0], times[-1], times.size)
    # Only if the reader computes these very times from their number.
    if np.array_equal(times, even):
        return {"start": float(times[0]), "end": float(times[-1]), "saves": int(times.size)}
    return {"at": times.tolist()}


@dataclass(frozen=True)
class _Solver(Choice):
    """The name of a solver, or of a user's class of solvers."""

    def read(self, value: Any, path: str) -> str:
        if is_python_name(value):
            own_solver(value, path)
            return value
        return super().read(value, path)


SOLVE = {
    "solver": Key(_Solver(tuple(SOLVERS)), "dopri8", says="the method"),
    "rtol": Key(Numbers(rule=POSITIVE), DEFAULT_TOLERANCE, says="the relative tolerance"),
    "atol": Key(Numbers(rule=POSITIVE), DEFAULT_TOLERANCE, says="the absolute tolerance, in units of the state"),
    "max_steps": Key(Integer(1, MOST_STEPS), 16384, says="the number of steps after which a solve ends as failed"),
    "max_step": Key(
        Numbers(rule=POSITIVE, dimension=TIME), None, says="the longest step of the solver; no limit if not given"
    ),
    "step_to_times": Key(
        Flag(), False, says="whether steps end at the save times; otherwise states there are interpolated"
    ),
    "dae": Key(Flag(), False, says="whether to solve the paper's differential-algebraic form"),
    "project": Key(Flag(), False, says="whether to normalise the versor after each step"),
}


def check_dae(
    system: AbstractSystem, contact: Contact | None, solver: str, dae: bool, named: str = "Key `solve.solver`"
) -> None:
    """Raises a :class:`ScenarioError` where the differential-algebraic form is asked for but does not exist.

    The message calls the solver as ``named``.
    """
    if not dae:
        return
    from ...simulation.arguments import system_to_solve  # here, because most files ask for no such form

    if isinstance(system, Disk):
        raise key_error("solve.dae", "false for a disk, whose state has no versor", "true; use a ball")
    if isinstance(system, NonholonomicParticle | VakonomicParticle | AbstractLagrangianSystem):
        named = "system with a Lagrangian" if isinstance(system, AbstractLagrangianSystem) else "particle"
        raise key_error("solve.dae", f"false for a {named}, whose state has no versor", "true")
    if (solved := system_to_solve(system, contact)).is_hybrid:
        raise key_error("solve.dae", f"false for a {solved.title}, whose modes are differential equations", "true")
    if not _knows_mass_matrices(solver):
        names = ", ".join(f'"{name}"' for name in KNOW_MASS_MATRICES)
        raise ScenarioError(
            f"{named} must be one of {names} where `solve.dae` is true, because other solvers do not support a mass "
            f'matrix, but it is "{solver}".'
        )


def _knows_mass_matrices(solver: str) -> bool:
    if solver in KNOW_MASS_MATRICES or not is_python_name(solver):
        return solver in KNOW_MASS_MATRICES
    from ...simulation import arguments  # here, as above

    return isinstance(SOLVERS[solver](), arguments.KNOW_MASS_MATRICES)


def check_projection(system: AbstractSystem, contact: Contact | None, state: Any, project: bool) -> None:
    """Raises a :class:`ScenarioError` where steps are to end on constraints, but the system has none."""
    if not project:
        return
    from ...simulation.arguments import has_projection, system_to_solve  # here, as above

    if not has_projection(system_to_solve(system, contact), state):
        raise ScenarioError(
            f"Key `solve.project` must be false for a {system.title}, whose state has nothing to normalise, but it is "
            "true; leave it out."
        )
