"""The report of a problem of optimal control: all its numbers in Markdown, and figures."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from ... import plot
from ...interface.output import replacing
from ...interface.wording import counted
from ...physics.body import Disk
from ...plot.report import write_figure
from ...scenario import Scenario, write_scenario
from ...simulation.extremes import contact_extremes
from ..cells import in_units, violation
from ..source import Source, made
from ..wanted import curve_and_discs, places_in_time
from .inequalities import PLACES
from .means import means
from .refine import Solution
from .rolling import Rolling, rolling
from .schedules import places, scenario_of, schedules_of
from .solve import Controlled

SCENARIO, REPORT = "design.toml", "report.md"
DRAWN = 601


def write_report(found: Controlled, title: str, saves: int, folder: Path, source: Source | None = None) -> Path:
    """Writes ``design.toml``, ``report.md`` and its figures into ``folder``; the path of the report.

    With a ``source`` the report names it, and a copy of the problem file is beside it.
    """
    scenario = write_design(found.solution, title, saves, folder)
    if source is not None:
        source.copy(folder)
    contact = contact_extremes(scenario.simulate(dense=True, throw=True))
    lines = [f"# {title or 'An optimal control'}", "", _verdict(found), "", *_objectives(found), ""]
    lines += _constraints(found)
    lines += [f"Along the run: {'; '.join(str(contact).splitlines())}.", "", *_figures(found, title, folder), ""]
    lines += made(source, found.elapsed)
    with replacing(folder / REPORT) as beside:
        beside.write_text("\n".join(lines), encoding="utf-8")
    return folder / REPORT


def write_design(solution: Solution, title: str, saves: int, folder: Path) -> Scenario:
    """Writes ``design.toml``, the scenario of a solution, into ``folder``; the scenario."""
    folder.mkdir(parents=True, exist_ok=True)
    scenario = scenario_of(solution, title, saves)
    with replacing(folder / SCENARIO) as beside:
        beside.write_text(write_scenario(scenario), encoding="utf-8")
    return scenario


def _verdict(found: Controlled) -> str:
    seen, errors = found.seen, found.solution.errors
    return (
        f"{'The masses can be moved so' if found.good else 'This is not what was asked for'}: the least curvature of "
        f"the cost is {found.curvature:.3g}, positive at a minimum; no interval of {errors.size} has an error above "
        f"{np.max(errors):.1e}. Simulated again by a solver of another kind, the path is {seen.apart:.1e} r away at "
        f"most; at the end the speed is {seen.speed:.1e}, the place is missed by {seen.missed:.1e} r, and the centre "
        f"of mass is {seen.away:.1e} r beside the geometric centre and {seen.below:.4g} r below it. `{SCENARIO}` is "
        "the scenario."
    )


def _objectives(found: Controlled) -> list[str]:
    first, last = means(found.first), means(found.solution)
    before, after = (rolling(one.problem).objectives for one in (found.first, found.solution))
    rows = [
        "| objective | first weight | its mean | weight | its mean | in units of the scenario |",
        "|" + "---|" * 6,
    ]
    meant = objectives_in_units(found)
    for name in last:
        numbers = (float(before[name].weight), first[name], float(after[name].weight), last[name])
        rows.append(f"| {name} | " + " | ".join(f"{x:.6g}" for x in numbers) + f" | {meant[name]} |")
    return [*rows, "", "Objectives are dimensionless: lengths over r, times over √(r/g), forces over M g."]


def objectives_in_units(found: Controlled) -> dict[str, str]:
    """The lengths, angles and times that the means of objectives stand for, in units of the scenario."""
    problem = rolling(found.solution.problem)
    return in_units(problem.objectives, means(found.solution), problem.system)


def _constraints(found: Controlled) -> list[str]:
    violations = found.seen.violations
    if not violations:
        return []
    rows = ["| constraint | |", "|" + "---|" * 2]
    rows += [f"| {name} | {violation(by, found.violation)} |" for name, by in violations.items()]
    looked = f"Looked at {PLACES - 1} times on each of {counted(found.solution.errors.size, 'interval')}"
    return [*rows, "", f"{looked}; a violation of {found.violation:g} is allowed.", ""]


def _figures(found: Controlled, title: str, folder: Path) -> list[str]:
    problem = rolling(found.solution.problem)
    times = np.linspace(float(problem.start), float(problem.end), DRAWN)
    axes = {
        "path": _path(found, problem, times),
        "angles": plot.rail_angles(times, _angles(found, times)),
        "accelerations": plot.rail_accelerations(times, found.solution.path.inputs(times)),
    }
    branch, first, last = found.branch, found.branch[0].weights, found.branch[-1].weights
    for name in [name for name in first if 0 < first[name] != last[name] > 0][:1]:
        weights = np.asarray([point.weights[name] for point in branch])
        values = {one: np.asarray([point.means[one] for point in branch]) for one in branch[0].means}
        axes["branch"] = plot.branch(weights, values, f"weight of {name}", of="mean of each objective")
    for label, ax in axes.items():
        write_figure(ax, folder / f"{label}.png", problem.system, title)
    return [f"![{label}]({label}.png)" for label in axes]


def _angles(found: Controlled, times: Float[np.ndarray, " t"]) -> Float[np.ndarray, "t m"]:
    return np.stack([jax.vmap(one)(jnp.asarray(times)) for one in schedules_of(found.solution)], axis=1)


def _path(found: Controlled, problem: Rolling, times: Float[np.ndarray, " t"]) -> Axes:
    before, after = (places(one, times) for one in (found.first, found.solution))
    if not isinstance(problem.system, Disk):
        wanted = [*problem.objectives.values(), *problem.constraints.values()]
        return plot.designed_path(before, after, *curve_and_discs(wanted))
    wanted = places_in_time(problem.objectives.values(), times)
    found_in_time = {"before": (times, before), "after": (times, after)}
    return plot.place_in_time(found_in_time, None if wanted is None else (times, wanted[:, 0]))
