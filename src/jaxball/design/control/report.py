"""The report of a problem of optimal control: all its numbers in Markdown, and figures."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes

from ... import plot
from ...interface.output import write_text
from ...interface.wording import all_of, counted
from ...scenario import Scenario, write_scenario
from ..report import REPORT, UNITS, along, figure_links, in_units, joint_figures, path_figure, table, violation
from ..result import Source, made
from ..search.design import SCENARIO
from .rolling import rolling
from .schedules import holding, places, scenario_of, schedules_of
from .solution import PLACES, Solution, means
from .solve import Controlled

DRAWN = 601
BRANCH = ("first weight", "last weight")  # of the paths that are drawn; "before" is the given scenario


def write_report(controlled: Controlled, title: str, saves: int, folder: Path, source: Source | None = None) -> Path:
    """Writes ``design.toml``, ``report.md`` and its figures into ``folder``; the path of the report.

    With a ``source`` the report names it, and a copy of the problem file is beside it.
    """
    scenario = write_design(controlled.solution, title, saves, folder)
    if source is not None:
        source.copy(folder)
    system = rolling(controlled.solution.problem).system
    lines = [f"# {title or 'An optimal control'}", "", _verdict(controlled), "", *_objectives(controlled), ""]
    run = scenario.simulate(dense=True, throw=True)
    lines += [*_constraints(controlled), *along(run), ""]
    figures = _figures(controlled) | joint_figures(run)
    lines += [*figure_links(figures, folder, system, title), "", *made(source, controlled.elapsed)]
    return write_text(folder / REPORT, "\n".join(lines))


def write_design(solution: Solution, title: str, saves: int, folder: Path) -> Scenario:
    """Writes ``design.toml``, the scenario of a solution, into ``folder``; the scenario."""
    folder.mkdir(parents=True, exist_ok=True)
    scenario = scenario_of(solution, title, saves)
    write_text(folder / SCENARIO, write_scenario(scenario))
    return scenario


def _verdict(controlled: Controlled) -> str:
    seen, errors = controlled.seen, controlled.solution.errors
    return (
        f"{'The motion is a solution' if controlled.good else 'The motion is not a solution'}: the least curvature of "
        f"the cost is {controlled.curvature:.3g}, positive at a minimum; the largest error of the {errors.size} "
        f"intervals is {np.max(errors):.1e}. Simulated again by a solver of another kind, the path differs by at most "
        f"{seen.apart:.1e} r; at the end the speed is {seen.speed:.1e}, the place is missed by {seen.missed:.1e} r, "
        f"and the centre of mass is {seen.away:.1e} r off the vertical through the contact point and {seen.below:.4g} "
        f"r below the geometric centre. {_holding(controlled)}`{SCENARIO}` is the scenario."
    )


def _holding(controlled: Controlled) -> str:
    """What the motors must do to hold the robot at the end, if it has motors."""
    values = [f"{value:.4g}" for value in holding(controlled.solution)]
    if not values:
        return ""
    return f"There {'its motors hold' if values[1:] else 'its motor holds'} it by {all_of(values)}, for as long again. "


def _objectives(controlled: Controlled) -> list[str]:
    first, last = means(controlled.first), means(controlled.solution)
    before, after = (rolling(one.problem).objectives for one in (controlled.first, controlled.solution))
    units, rows = objectives_in_units(controlled), []
    for name in last:
        numbers = (float(before[name].weight), first[name], float(after[name].weight), last[name])
        rows.append([name, *(f"{x:.6g}" for x in numbers), units[name]])
    header = ["objective", "first weight", "its mean", "weight", "its mean", "in units of the scenario"]
    return [*table(header, rows), "", UNITS]


def objectives_in_units(controlled: Controlled) -> dict[str, str]:
    """The lengths, angles and times that the means of objectives stand for, in units of the scenario."""
    problem = rolling(controlled.solution.problem)
    return in_units(problem.objectives, means(controlled.solution), problem.system)


def _constraints(controlled: Controlled) -> list[str]:
    violations, allowed = controlled.seen.violations, controlled.violation
    if not violations:
        return []
    rows = [[name, violation(by, allowed)] for name, by in violations.items()]
    evaluated = f"Evaluated {PLACES - 1} times on each of {counted(controlled.solution.errors.size, 'interval')}"
    return [*table(["constraint", ""], rows), "", f"{evaluated}; a violation of {allowed:g} is allowed.", ""]


def _figures(controlled: Controlled) -> dict[str, Axes]:
    solution, branch = controlled.solution, controlled.branch
    problem = rolling(solution.problem)
    times = np.linspace(float(problem.start), float(problem.end), DRAWN)
    requirements = [*problem.objectives.values(), *problem.constraints.values()]
    first, last = ((times, places(one, times)) for one in (controlled.first, solution))
    axes = {"path": path_figure(requirements, first, last, names=BRANCH)}
    masses = problem.system.driven
    if masses:
        schedules = schedules_of(solution)[: len(masses)]
        angles = np.stack([jax.vmap(schedule)(jnp.asarray(times)) for schedule in schedules], axis=1)
        axes["angles"] = plot.rail_angles(times, angles)
        axes["accelerations"] = plot.rail_accelerations(times, solution.path.inputs(times)[:, : len(masses)])
    weighed, least = branch[0].weights, branch[-1].weights
    for name in [name for name in weighed if 0 < weighed[name] != least[name] > 0][:1]:
        weights = np.asarray([point.weights[name] for point in branch])
        values = {one: np.asarray([point.means[one] for point in branch]) for one in branch[0].means}
        axes["branch"] = plot.branch(weights, values, f"weight of {name}", of="mean of each objective")
    return axes
