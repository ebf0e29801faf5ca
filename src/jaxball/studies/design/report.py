"""Writes the reports of ``jaxball design``, of a search or of optimal control: numbers in Markdown, and figures."""

import dataclasses
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tomli_w
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ... import plot, programs
from ...files.scenario import Units
from ...files.scenario.errors import ScenarioError
from ...files.scenario.files import write_scenario
from ...files.scenario.scenario import Scenario
from ...interface.output import write_text
from ...interface.wording import all_of, number_of
from ...physics.dynamics.footing import has_end
from ...plot.report import write_figure
from ...simulation.extremes import contact_extremes
from ...simulation.trajectory import Trajectory
from .constraints import discs_to_avoid
from .objectives import FollowCurve, FollowTrajectory, LargestDistance, target_path
from .optimal_control.rolling import Rolling, rolling
from .optimal_control.solution import POINTS_OF_INTERVAL, Solution
from .optimal_control.solve import Controlled
from .problem.problem import worst
from .problem.requirements import Requirement
from .problem.run import RAIL_SAMPLES, Run
from .result import REPORT, Source, provenance
from .search.design import SCENARIO, Design, warnings
from .search.verify import FINER, as_built

UNITS = "Objectives are dimensionless: lengths over r, times over √(r/g), forces over M g."
# Anything less is rounding and is not drawn.
SMALLEST_FRICTION = 1e-9
SAVES_DRAWN = 601
# Names of the paths that are drawn, where "before" is the given scenario: of two weights, of two barriers with the same
# weights, and of one path, which a legend has once.
OF_WEIGHTS, OF_BARRIERS, OF_ONE = ("first weight", "last weight"), ("far from its constraints", "found"), ("_", "found")


@programs.compile_quickly()
def write_report(design: Design, title: str, folder: Path, source: Source | None = None) -> Path:
    """Writes ``design.toml``, ``report.md`` and its figures into ``folder``; the path of the report.

    With a ``source`` the report names it, and a copy of the problem file is beside it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if source is not None:
        source.copy(folder)
    write_text(folder / SCENARIO, tomli_w.dumps(design.document))
    space = design.problem.space
    parts = [[f"# {title or 'A design'}"], [_verdict(design)], *([warning] for warning in warnings(design))]
    parts += [_objectives(design), _constraints(design), _variables(design), *_checks(design)]
    try:
        before, after = (
            space.scenario_of(numbers).simulate(dense=True) for numbers in (space.values(space.start), design.numbers)
        )
        parts += [*_distances(design, before, after), _along(after)]
        parts.append(_figure_links(_figures(design, before, after), folder, space.scenario, title))
    except ScenarioError as error:
        parts.append([f"The scenario cannot be run by `jaxball simulate`: {error}"])
    return _write(folder, [*parts, *provenance(source, design.progress.elapsed, resumed=design.check is None)])


@programs.compile_quickly()
def write_control_report(
    controlled: Controlled, title: str, saves: int, folder: Path, source: Source | None = None
) -> Path:
    """Writes the scenario, ``report.md`` and its figures for a solution of optimal control, whose scenario has
    ``saves`` times.
    """
    system = rolling(controlled.solution.problem).system
    scenario = write_design(controlled.solution, title, saves, folder, controlled.units)
    if source is not None:
        source.copy(folder)
    run = scenario.simulate(dense=True, throw=True)
    figures = _control_figures(controlled) | _joint_figures(run)
    on_ground = {"ground": run.snapshot()} if has_end(system) else {}
    links = _figure_links({**figures, **on_ground}, folder, scenario, title)
    parts = [[f"# {title or 'An optimal control'}"], [_control_verdict(controlled)], _control_objectives(controlled)]
    parts += [*_control_constraints(controlled), _along(run), links]
    return _write(folder, [*parts, *provenance(source, controlled.elapsed)])


def write_design(solution: Solution, title: str, saves: int, folder: Path, units: Units | None = None) -> Scenario:
    """Writes ``design.toml``, the scenario of a solution of optimal control, into ``folder``; the scenario."""
    folder.mkdir(parents=True, exist_ok=True)
    scenario = dataclasses.replace(solution.scenario(title, saves), units=units)
    write_text(folder / SCENARIO, write_scenario(scenario))
    return scenario


def objectives_in_units(found: Design | Controlled) -> dict[str, str]:
    """Returns the length, the angle or the time that the value of each objective stands for, in units of the scenario.

    The values are the verified ones; empty where a value stands for none of them, or is not finite.
    """
    if isinstance(found, Controlled):
        problem, units = rolling(found.solution.problem), found.units
        objectives, values = problem.objectives, found.solution.means()
        length, gravity = problem.system.radius, problem.system.gravity
    else:
        objectives, units = found.problem.objectives, found.problem.space.scenario.units
        length, gravity = found.problem.space.units(found.numbers)
        values = dict(zip(objectives, np.asarray(found.verified.finer.terms).tolist(), strict=True))
    length, gravity = float(length), abs(float(gravity))
    time = math.sqrt(length / gravity) if gravity > 0 else math.inf
    return {
        name: with_unit(objective.in_units(values[name], length, time), units) if math.isfinite(values[name]) else ""
        for name, objective in objectives.items()
    }


def with_unit(text: str, units: Units | None) -> str:
    """Adds its unit to a length or a time in words, such as ``"distance 0.4"``, if the scenario states units."""
    words = text.split()
    if units is None or units.is_dimensionless or not words or not re.fullmatch(r"-?[\d.]+(e[+-]?\d+)?", words[-1]):
        return text
    unit = units.time if "time" in words else units.length if "distance" in words else ""
    return f"{text} {unit}".rstrip()


def violation(by: float, allowed: float) -> str:
    """Says whether a constraint holds, from its largest signed violation and the tolerance."""
    if math.isnan(by):
        return "not known"
    if by == -math.inf:
        return "nothing to check"
    if by > allowed:
        return f"violated by {by:.2e}"
    return f"holds to within {by:.1e}" if by > 0 else f"holds, margin {abs(by):.2e}"


def bounds(lower: float, upper: float) -> str:
    """Formats the bounds of a variable, as text."""
    if lower == -math.inf:
        return "free" if upper == math.inf else f"at most {upper:g}"
    return f"at least {lower:g}" if upper == math.inf else f"{lower:g} to {upper:g}"


def _write(folder: Path, parts: Iterable[Sequence[str]]) -> Path:
    """Writes a report of these parts, each of some lines, with an empty line after each."""
    return write_text(folder / REPORT, "\n".join(line for part in parts if part for line in (*part, "")))


def _table(header: Sequence[str], rows: Iterable[Sequence[str]], legend: str = "") -> list[str]:
    """Returns the lines of a table in Markdown, with its legend."""
    first, *lines = ["| " + " | ".join(row) + " |" for row in (header, *rows)]
    return [first, "|" + "---|" * len(header), *lines, *(["", legend] if legend else [])]


def _in_table(header: Sequence[str], numbers: Mapping[str, Sequence[float]], units: Mapping[str, str]) -> list[str]:
    """Formats the numbers of each objective as a table, with the fourth also in units of the scenario."""
    rows = []
    for name, values in numbers.items():
        cells = [f"{x:.6g}" for x in values]
        rows.append([name, *cells[:4], units[name], *cells[4:]])
    return _table([*header[:5], "in units of the scenario", *header[5:]], rows, UNITS)


def _along(trajectory: Trajectory[Any, Any]) -> list[str]:
    """Describes the contact force along a run."""
    return [f"Along the run: {'; '.join(str(contact_extremes(trajectory)).splitlines())}."]


def _figure_links(axes: Mapping[str, Axes | Figure], folder: Path, scenario: Scenario, title: str) -> list[str]:
    """Writes figures, by name, and links to them."""
    for name, ax in axes.items():
        write_figure(ax, folder / f"{name}.png", scenario.system, title, scenario.units)
    return [f"![{name}]({name}.png)" for name in axes]


def _path_figure(
    requirements: Sequence[Requirement],
    before: tuple[np.ndarray, np.ndarray],
    after: tuple[np.ndarray, np.ndarray],
    *,
    names: tuple[str, str] = ("before", "after"),
) -> Axes:
    """Draws the paths before and after, each with its times, and their targets; for a disk, positions over time."""
    times, path = after
    if path.ndim == 1:
        targets = [item.targets(jnp.asarray(times)) for item in requirements if isinstance(item, FollowTrajectory)]
        target = (times, np.asarray(targets[0])[:, 0]) if targets else None
        return plot.place_in_time(dict(zip(names, (before, after), strict=True)), target)
    return plot.designed_path(before[1], path, target_path(requirements), discs_to_avoid(requirements), names=names)


def _joint_figures(trajectory: Trajectory[Any, Any]) -> dict[str, Axes]:
    """Draws angles and efforts of the joints of mechanisms, if there are any."""
    if not trajectory.system.mechanisms:
        return {}
    return {"joint-angles": trajectory.plot("joint_angles"), "joint-efforts": trajectory.plot("joint_efforts")}


def _verdict(design: Design) -> str:
    merit, verified = design.merit, design.verified
    ends = (
        "All constraints hold"
        if design.feasible
        else f"The largest violation is {verified.violation:.3g}; not all hold"
    )
    objective = verified.designed.terms @ design.problem.weights
    asked = design.settings.stationary
    # Ten times as much still ends the search.
    how = "" if merit.gradient <= asked else "nearly " if merit.gradient <= 10 * asked else "not "
    return (
        f"{ends}, to {design.settings.tolerance:g}, at the samples and at nine times between each two of them. The "
        f"objective is {objective:.6g}. The gradient of the Lagrangian is {merit.gradient:.1e}, where "
        f"{asked:.1e} is asked: the design is {how}stationary. `{SCENARIO}` is the scenario."
    )


def _objectives(design: Design) -> list[str]:
    columns = (
        design.problem.weights,
        design.before.terms,
        design.verified.designed.terms,
        design.verified.finer.terms,
        np.median(design.perturbed.terms, axis=0),
        np.max(design.perturbed.terms, axis=0),
    )
    numbers = dict(zip(design.problem.objectives, zip(*columns, strict=True), strict=True))
    header = ["objective", "weight", "before", "after", "verified", "perturbed, median", "worst"]
    return _in_table(header, numbers, objectives_in_units(design))


def _constraints(design: Design) -> list[str]:
    if not design.problem.constraints:
        return ["There are no constraints except bounds."]
    layout = design.problem.layout
    before = layout.by_constraint(np.asarray(design.before.violations))
    perturbed = [layout.by_constraint(np.asarray(row)) for row in design.perturbed.violations]
    rows = []
    for name, (coarse, fine) in design.verified.violations.items():
        violations = worst(before[name]), coarse, fine, worst([worst(ball[name]) for ball in perturbed])
        rows.append([name, *(violation(by, design.settings.tolerance) for by in violations)])
    header = ["constraint", "before", "after", "verified, between samples too", "perturbed, worst"]
    legend = (
        "Each value is that of the largest violation or the smallest margin; violations and margins are dimensionless. "
        f"The verified ones are nearer to the truth: at {FINER} times as many times, and with rails as polygons of "
        f"{FINER * RAIL_SAMPLES} chords, where the others have {RAIL_SAMPLES}, as the search has. A margin between "
        "rails may be smaller for fewer chords, which cut their curves short."
    )
    return _table(header, rows, legend)


def _variables(design: Design) -> list[str]:
    space = design.problem.space
    rows = [
        [
            ", ".join(f"`{path}`" for path in entry.paths),
            f"{old:.8g}{space.unit_of[entry.name]}",
            f"{new:.12g}{space.unit_of[entry.name]}",
            bounds(entry.lower, entry.upper),
        ]
        for entry, old, new in zip(space.variables, space.values(space.start), design.numbers, strict=True)
    ]
    return _table(["variable", "start", "found", "bounds"], rows)


def _checks(design: Design) -> list[list[str]]:
    verified, built = design.verified, as_built(design.problem)
    differs = (
        f"Simulated again by {verified.solver} at the tolerance {verified.rtol:.0e}, the path differs by at most "
        f"{verified.apart:.1e} radii. The {built.count} perturbed balls have errors of up to {built.masses:.1%} in "
        f"masses and up to {built.offset:.1%} of the radius in the centre of mass along each axis."
    )
    if design.check is None:
        return [[differs]]
    words = "The gradient at the start, along a random direction, relative to its length:"
    return [[differs], [words], ["```", str(design.check), "```"]]


def _run(trajectory: Trajectory[Any, Any]) -> Run:
    return Run(trajectory.system, jnp.asarray(trajectory.times), trajectory.state, trajectory.status)


@programs.filter_jit
def _evaluate(quantity: Callable[..., Any], *arguments: Any) -> Any:
    return quantity(*arguments)


def _distances(design: Design, before: Trajectory[Any, Any], after: Trajectory[Any, Any]) -> list[list[str]]:
    lines = []
    for name, item in design.problem.objectives.items():
        if isinstance(item, FollowTrajectory | FollowCurve) and not isinstance(item, LargestDistance):
            old, new = (float(_evaluate(type(item).farthest, item, _run(trajectory))) for trajectory in (before, after))
            lines.append([f"The largest distance of {name} is {new:.3g} radii; before, it was {old:.3g}."])
    return lines


def _figures(design: Design, before: Trajectory[Any, Any], after: Trajectory[Any, Any]) -> dict[str, Axes]:
    history, problem = np.asarray(design.progress.history), design.problem
    requirements = [*problem.objectives.values(), *problem.constraints.values()]
    axes = {
        "path": _path_figure(requirements, _path(before), _path(after)),
        "rails": after.plot("configuration"),
        "contact": after.plot("contact_force"),
        "convergence": plot.convergence(*history[:, 2:5].T, polish=int(np.sum(history[:, 0] == 0))),
    }
    if float(after.friction_needed) > SMALLEST_FRICTION:
        axes["friction"] = after.plot("friction_ratio")
    if after.system.n_masses:
        theta = np.asarray(_evaluate(lambda run: run.on_rails.theta, _run(after)))
        axes["angles"] = plot.rail_angles(np.asarray(after.times), theta)
    return axes | _joint_figures(after)


def _path(trajectory: Trajectory[Any, Any]) -> tuple[Float[np.ndarray, " t"], Float[np.ndarray, "t *d"]]:
    z = np.asarray(_evaluate(lambda run: run.z, _run(trajectory)))
    return np.asarray(trajectory.times), z[:, 0] if trajectory.system.planar else z


def _control_verdict(controlled: Controlled) -> str:
    seen, errors = controlled.seen, controlled.solution.errors
    below = round(float(seen.below), 12) + 0.0  # no -0, where there are no masses
    return (
        f"{'The motion is a solution' if controlled.ok else 'The motion is not a solution'}: the least curvature of "
        f"the cost is {controlled.curvature:.3g}, positive at a minimum; the largest error of the {errors.size} "
        f"intervals is {np.max(errors):.1e}. Simulated again by a solver of another kind, the path differs by at most "
        f"{seen.apart:.1e} r; at the end the speed is {seen.speed:.1e}, the place is missed by {seen.missed:.1e} r, "
        f"and the centre of mass is {seen.away:.1e} r off the vertical through the contact point and {below:.4g} "
        f"r below the geometric centre. {_free_end(controlled)}{_holding(controlled)}`{SCENARIO}` is the scenario."
    )


def _free_end(controlled: Controlled) -> str:
    """Says when the motion ends, if that was to be found."""
    if controlled.free_end_time is None:
        return ""
    shortest, longest, _ = controlled.free_end_time
    end = with_unit(f"time {controlled.solution.path.mesh[-1]:.8g}", controlled.units)
    return f"The end is at the {end}, found between {shortest:g} and {longest:g}. "


def _holding(controlled: Controlled) -> str:
    """Says what the motors must do to hold the robot at the end, if it has motors."""
    values = [f"{value:.4g}" for value in controlled.solution.holding()]
    if not values:
        return ""
    return f"There {'its motors hold' if values[1:] else 'its motor holds'} it by {all_of(values)}, for as long again. "


def _control_objectives(controlled: Controlled) -> list[str]:
    if not rolling(controlled.solution.problem).objectives:
        return ["There are no objectives except the duration."]
    first, last = controlled.first.means(), controlled.solution.means()
    before, after = (rolling(entry.problem).objectives for entry in (controlled.first, controlled.solution))
    weights = [{name: float(entry.weight) for name, entry in objectives.items()} for objectives in (before, after)]
    numbers = {name: (weights[0][name], first[name], weights[1][name], last[name]) for name in last}
    header = ["objective", "first weight", "its mean", "weight", "its mean"]
    return _in_table(header, numbers, objectives_in_units(controlled))


def _control_constraints(controlled: Controlled) -> list[list[str]]:
    violations, allowed = controlled.seen.violations, controlled.violation
    if not violations:
        return []
    rows = [[name, violation(by, allowed)] for name, by in violations.items()]
    evaluated = (
        f"Evaluated {POINTS_OF_INTERVAL - 1} times on each of {number_of(controlled.solution.errors.size, 'interval')}"
    )
    return [_table(["constraint", ""], rows, f"{evaluated}; a violation of {allowed:g} is allowed.")]


def name_paths(before: Rolling, after: Rolling) -> tuple[str, str]:
    """Names the first path and the last by what distinguishes their problems: weights, or how large the barrier is."""
    if any(before.objectives[name].weight != entry.weight for name, entry in after.objectives.items()):
        return OF_WEIGHTS
    return OF_BARRIERS if after.constraints else OF_ONE


def _control_figures(controlled: Controlled) -> dict[str, Axes]:
    solution, branch = controlled.solution, controlled.branch
    problem = rolling(solution.problem)
    times = np.linspace(float(problem.start), float(problem.end), SAVES_DRAWN)
    requirements = [*problem.objectives.values(), *problem.constraints.values()]
    first, last = ((times, entry.places(times)) for entry in (controlled.first, solution))
    axes = {
        "path": _path_figure(requirements, first, last, names=name_paths(rolling(controlled.first.problem), problem))
    }
    schedules, system = solution.schedules(), problem.system
    masses, plate = range(len(system.driven)), range(len(schedules) - len(system.driven_ground), len(schedules))
    for name, moved in (("", masses), ("plate-", plate)):
        if moved:
            angles = [jax.vmap(schedules[k])(jnp.asarray(times)) for k in moved]
            axes[f"{name}angles"] = plot.rail_angles(times, np.stack(angles, axis=1))
            axes[f"{name}accelerations"] = plot.rail_accelerations(times, solution.path.inputs(times)[:, list(moved)])
    weighed, least = branch[0].weights, branch[-1].weights
    for name in [name for name in weighed if 0 < weighed[name] != least[name] > 0][:1]:
        weights = np.asarray([point.weights[name] for point in branch])
        values = {entry: np.asarray([point.means[entry] for point in branch]) for entry in branch[0].means}
        axes["branch"] = plot.branch(weights, values, f"weight of {name}", of="mean of each objective")
    return axes
