"""``check_laws``, the entry point: from a scenario, or a system with times and a state, to a report of its laws."""

import concurrent.futures
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ...files.scenario.scenario import Scenario
from ...interface.arguments import require_flags
from ...interface.wording import did_you_mean
from ...numerics.arrays import Numbers
from ...physics.contact.released import ReleasedState
from ...physics.state import ReducedState, RotationState
from ...physics.system import AbstractState, AbstractSystem
from ...simulation.simulate import at_rest
from ...simulation.trajectory import Trajectory
from .balances import laws_along
from .case import Case, trust
from .comparisons import CHECKS, SLOW_COMPARISONS
from .laws import LAWS
from .report import Report, Row

BODIES_ONLY, NO_PLANE = "it is for a ball or a disk", "the system does not roll on a plane"
UNSAID = ("closed-form", "moving-energy", "saved")  # without a closed form, a turntable or a file, these have no row


def check_laws(
    system: Scenario | Trajectory[Any, Any] | AbstractSystem,
    times: Numbers | None = None,
    state: AbstractState | ReleasedState | None = None,
    *,
    laws: Sequence[str] | None = None,
    quick: bool = False,
    **settings: Any,
) -> Report:
    """Runs a scenario and checks every law of mechanics that applies to it.

    **Arguments:**

    - ``system``: a :class:`~jaxball.Scenario`; the trajectory of one, also as read by :func:`jaxball.load_run`, which
      is then compared with the run as well; or a system, in which case ``times`` and ``state`` are those of
      :func:`jaxball.simulate`, and ``settings`` are fields of a scenario, such as ``solver``, ``rtol`` and ``atol``.
    - ``laws``: the names of the laws to check, from :data:`LAWS` or a classical system's laws; all if not given. Where
      a law does not apply, its row says why.
    - ``quick``: whether to skip the laws for which another solver or another system must be compiled.

    If the solve fails, the report's ``failure`` says why.

    **Raises:** ``ValueError`` for an unknown law, and for a scenario with feedback or with an event that ends its run;
    ``TypeError`` for states without a position, and as :func:`jaxball.simulate`.
    """
    require_flags(quick=quick)
    saved_run = system if isinstance(system, Trajectory) else None
    case = Case(_scenario(system, times, state, settings), saved_run)
    _ = case.state  # raises for one with feedback, or with an event that ends it
    checks = {**laws_along(case.scenario), **CHECKS}
    chosen = (
        [name for name in checks if not (quick and name in SLOW_COMPARISONS)]
        if laws is None
        else _check_laws(laws, checks)
    )
    if not case.run.ok:
        return Report(case.scenario.title, (), failure=case.run.message)
    rows = _rows(case, chosen, checks)
    if laws is None:
        rows = tuple(row for row in rows if row.applies or row.law not in UNSAID)
    needs_trust = laws is None or any(name in CHECKS for name in chosen)
    times = case.samples.times if any(row.residuals is not None for row in rows) else None
    return Report(case.scenario.title, rows, trust(case) if needs_trust else None, times=times)


def _rows(case: Case, chosen: Sequence[str], checks: Mapping[str, Callable[[Case], Row]]) -> tuple[Row, ...]:
    """Computes the rows of the chosen laws. One core compiles the programs that they share, the other the programs of
    single rows.
    """
    slow = [name for name in chosen if name in SLOW_COMPARISONS and name in checks]
    if slow:
        _ = case.expected  # needed by several, so that two threads do not simulate it
    beside = concurrent.futures.ThreadPoolExecutor(1)
    try:
        later = {name: beside.submit(checks[name], case) for name in slow}
        rows = {name: checks[name](case) for name in chosen if name in checks and name not in later}
        rows |= {name: row.result() for name, row in later.items()}
    finally:
        beside.shutdown(wait=False, cancel_futures=True)  # Ctrl-C does not wait for what is being compiled
    return tuple(rows.get(name, Row(name, reason=NO_PLANE if name == "contact" else BODIES_ONLY)) for name in chosen)


def _scenario(
    system: Scenario | Trajectory[Any, Any] | AbstractSystem, times: Any, state: Any, settings: dict[str, Any]
) -> Scenario:
    if isinstance(system, Scenario | Trajectory):
        if times is not None or state is not None or settings:
            raise ValueError(
                "Arguments `times`, `state` and settings must be left out for a Scenario, which has them; use "
                "dataclasses.replace(scenario, rtol=...)."
            )
        scenario = system.scenario if isinstance(system, Trajectory) else system
        if scenario is None:
            raise ValueError(
                "Argument `system` must be the trajectory of a Scenario, which has its settings, but this one has "
                "none; give its system, times and state."
            )
        return scenario
    if times is None:
        raise ValueError("Argument `times` must be given for a system, two or more increasing numbers, but it is None.")
    state = at_rest(system) if state is None else state
    if isinstance(state, RotationState | ReducedState):
        raise TypeError(
            "Argument `state` must be a BallState, a DiskState or a state of another system, but it is a "
            f"{type(state).__name__}; a RotationState has `in_space`."
        )
    return Scenario("", system, state, np.asarray(times, dtype=float), **settings)


def _check_laws(laws: Sequence[str], checks: Mapping[str, Any]) -> list[str]:
    unknown = [name for name in laws if name not in checks and name not in LAWS]
    if unknown:
        hint = did_you_mean(unknown[0], checks, f"the laws here are {', '.join(checks)}")
        raise ValueError(f'Argument `laws` must contain names of laws, but it contains "{unknown[0]}"{hint}')
    return list(dict.fromkeys(laws))
