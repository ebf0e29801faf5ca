"""The cases in the engines, and by jaxball itself: errors and times, written to a folder."""

import dataclasses
import datetime
import importlib
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from jaxball import Scenario
from jaxball.interface.output import write_text

from ..measure import Echo, machine, power, versions
from ..run import SelectionError
from . import CASES, ENGINES, Case, Engine, Setting
from .errors import Errors, Exact, errors, exact, of_run

TIMESTEPS = (0.02, 0.01, 0.005, 0.002, 0.001, 0.0005)
QUICK_TIMESTEPS = (0.01, 0.002)
QUICK_CASES = ("slope", "disk")
TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-9)
SECONDS = 1.0  # s of processor time for a run
PACKAGES = ("jaxball", "jax", "numpy", "mujoco", "drake", "pybullet")
ABOUT = "Robots in general engines beside the exact solution; processor time in seconds per unit of simulated time."


@dataclass(frozen=True)
class Row:
    """One run: its engine, setting and time step (for jaxball, its tolerance), its errors and its time.

    ``time`` is processor time per unit of simulated time; None, as are the errors, for a run with a ``failure``.
    """

    case: str
    engine: str
    setting: str
    step: float
    path: float | None = None
    slip: float | None = None
    energy: float | None = None
    time: float | None = None
    failure: str = ""


class Plan(NamedTuple):
    """The cases, engines and time steps to measure."""

    cases: list[Case]
    engines: list[Engine]
    timesteps: tuple[float, ...]


def plan(case_names: Sequence[str] = (), engine_names: Sequence[str] = (), *, quick: bool = False) -> Plan:
    """The cases and engines of these names; without names all, or the few that are ``quick``.

    **Raises:** :class:`~comparison.SelectionError` for a name that none has.
    """
    cases = _select("problems", case_names or (QUICK_CASES if quick else ()), CASES)
    engines = _select("solvers", engine_names, ENGINES)
    return Plan(cases, engines, QUICK_TIMESTEPS if quick else TIMESTEPS)


def _select(argument: str, names: Sequence[str], known: dict[str, Any]) -> list[Any]:
    by_name = {name.lower(): value for name, value in known.items()}
    for name in names:
        if name.lower() not in by_name:
            raise SelectionError(
                f"Argument `{argument}` must contain {', '.join(known)} after `engines`, but it contains {name!r}."
            )
    return [value for name, value in by_name.items() if not names or name in map(str.lower, names)]


def listing() -> str:
    """A line for each case and for each engine, with the reason if one cannot take part here."""
    width = max(map(len, (*CASES, *ENGINES)))
    lines = ["Robots", *(f"  {case.name:{width}}  {case.title}: {case.why}" for case in CASES.values()), "Engines"]
    for name, engine in ENGINES.items():
        reason = engine.family.missing()
        note = "" if reason is None else f", left out because {reason}; {engine.family.remedy}"
        lines.append(f"  {name:{width}}  {', '.join(setting.name for setting in engine.settings)}{note}")
    return "\n".join(lines)


def measure(plan: Plan, out: Path, echo: Echo = print) -> list[Row]:
    """Runs the plan, and writes ``engines.json``, ``engines.md`` and a diagram for each case to the folder ``out``.

    ``echo`` is called with each line of progress.

    **Raises:** :class:`~jaxball.files.results.OutputError` when a file cannot be written.
    """
    from . import report  # here, because matplotlib takes longer to import than to list names

    out.mkdir(parents=True, exist_ok=True)
    present = []
    for engine in plan.engines:
        reason = engine.family.missing()
        if reason is None:
            present.append(engine)
        else:
            echo(f"Left out: {engine.family.name}, because {reason}; {engine.family.remedy}.")
    rows: list[Row] = []
    for case in plan.cases:
        echo(case.title)
        found = measure_case(case, present, plan.timesteps, echo)
        rows += found
        report.draw(case, found, out)
        _write(out, plan, rows)
    echo(f"In {out}: engines.json, engines.md and a diagram for each robot.")
    return rows


def measure_case(case: Case, engines: Sequence[Engine], timesteps: Sequence[float], echo: Echo = print) -> list[Row]:
    """The runs of one case, by jaxball and in the engines, all of which must be installed."""
    scenario = case.scenario()
    true = exact(scenario)
    rows = [_own(case, scenario, true, tolerance) for tolerance in TOLERANCES]
    for engine in engines:
        for setting in engine.settings:
            found = _of_setting(case, scenario, true, engine, setting, timesteps)
            rows += found
            echo(f"  {engine.family.name}, {setting.name}: {found[-1].failure or power(found[-1].path or 0.0)}")
    return rows


def _own(case: Case, scenario: Scenario, true: Exact, tolerance: float) -> Row:
    scenario.simulate(rtol=tolerance, atol=tolerance)  # compiles
    begin = time.process_time()
    run = scenario.simulate(rtol=tolerance, atol=tolerance, throw=True)
    seconds = time.process_time() - begin
    return _row(case, "jaxball", "Dopri8", tolerance, of_run(run, true), seconds, scenario)


def _of_setting(
    case: Case, scenario: Scenario, true: Exact, engine: Engine, setting: Setting, timesteps: Sequence[float]
) -> list[Row]:
    """The runs with decreasing time steps, as long as they are expected to stay below the limit of time."""
    module = importlib.import_module(f".{engine.family.module}", __package__)
    rows: list[Row] = []
    last, seconds = timesteps[0], 0.0
    for timestep in timesteps:
        if seconds * last / timestep > SECONDS:
            break
        try:
            motion = module.run(case, setting, timestep)
        except (ValueError, RuntimeError) as error:
            failure = str(error).splitlines()[0]
            return [*rows, Row(case.name, engine.family.name, setting.name, timestep, failure=failure)]
        last, seconds = timestep, motion.seconds
        found = errors(scenario, motion, true)
        rows.append(_row(case, engine.family.name, setting.name, timestep, found, seconds, scenario))
    return rows


def _row(case: Case, engine: str, setting: str, step: float, found: Errors, seconds: float, scenario: Scenario) -> Row:
    duration = float(scenario.times[-1] - scenario.times[0])
    return Row(case.name, engine, setting, step, *found, time=seconds / duration)


def _write(out: Path, plan: Plan, rows: Sequence[Row]) -> None:
    from . import report  # here, as above

    settings = {
        engine.family.name: {setting.name: {"source": setting.source, **setting.values} for setting in engine.settings}
        for engine in plan.engines
    }
    content = {
        "about": ABOUT,
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "machine": machine(),
        "versions": versions(PACKAGES),
        "settings": settings,
    }
    head = json.dumps(content, indent=1).removesuffix("\n}")
    lines = ",\n".join(f"  {json.dumps(dataclasses.asdict(row))}" for row in rows)
    write_text(out / "engines.json", f'{head},\n "rows": [\n{lines}\n ]\n}}\n')
    write_text(out / "engines.md", report.markdown(plan.cases, rows))
