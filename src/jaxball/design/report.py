"""The report of a design: all its numbers in Markdown, and figures; with parts shared by reports of optimal control."""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tomli_w
from jaxtyping import Float
from matplotlib.axes import Axes

from .. import plot
from ..interface.output import write_text
from ..physics.body import System
from ..plot.report import write_figure
from ..scenario import ScenarioError
from ..simulation.extremes import contact_extremes
from ..simulation.trajectory import Trajectory
from .constraints import discs_to_avoid
from .objectives import FollowCurve, FollowTrajectory, LargestDistance, wanted_path
from .problem.problem import worst
from .problem.requirements import AbstractObjective, Requirement
from .problem.run import Run
from .result import Source, made
from .search.design import SCENARIO, Design
from .search.verify import as_built
from .warnings import warnings

REPORT = "report.md"
UNITS = "Objectives are dimensionless: lengths over r, times over √(r/g), forces over M g."
# Anything less is rounding and is not drawn.
SMALLEST_FRICTION = 1e-9


def write_report(design: Design, title: str, folder: Path, source: Source | None = None) -> Path:
    """Writes ``design.toml``, ``report.md`` and its figures into ``folder``; the path of the report.

    With a ``source`` the report names it, and a copy of the problem file is beside it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if source is not None:
        source.copy(folder)
    write_text(folder / SCENARIO, tomli_w.dumps(design.document))
    space = design.problem.space
    lines = [f"# {title or 'A design'}", "", _verdict(design), ""]
    lines += [line for warning in warnings(design) for line in (warning, "")]
    lines += [*_objectives(design), "", *_constraints(design), ""]
    lines += [*_variables(design), "", *_checks(design), ""]
    try:
        before, after = (
            space.scenario_of(numbers).simulate(dense=True)
            for numbers in (np.asarray(space.numbers(jnp.asarray(space.start))), design.numbers)
        )
        lines += [*_distances(design, before, after), *along(after), ""]
        lines += [*figure_links(_figures(design, before, after), folder, after.system, title), ""]
    except ScenarioError as error:
        lines += [f"The scenario cannot be run by `jaxball simulate`: {error}", ""]
    lines += made(source, design.progress.elapsed, resumed=design.check is None)
    return write_text(folder / REPORT, "\n".join(lines))


def violation(by: float, allowed: float) -> str:
    """Whether a constraint holds, from its largest signed violation and the tolerance."""
    if math.isnan(by):
        return "not known"
    if by == -math.inf:
        return "nothing to check"
    if by > allowed:
        return f"violated by {by:.2e}"
    return f"holds to within {by:.1e}" if by > 0 else f"holds, margin {abs(by):.2e}"


def bounds(lower: float, upper: float) -> str:
    """The bounds of a variable, as text."""
    if lower == -math.inf:
        return "free" if upper == math.inf else f"at most {upper:g}"
    return f"at least {lower:g}" if upper == math.inf else f"{lower:g} to {upper:g}"


def in_units(
    objectives: Mapping[str, AbstractObjective], values: Mapping[str, float], system: System
) -> dict[str, str]:
    """The length, the angle or the time that the value of an objective stands for, in units of the scenario.

    Empty if it stands for none of them, or is not finite.
    """
    length, gravity = float(system.radius), abs(float(system.gravity))
    time = math.sqrt(length / gravity) if gravity > 0 else math.inf
    return {
        name: objective.in_units(values[name], length, time) if math.isfinite(values[name]) else ""
        for name, objective in objectives.items()
    }


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """The lines of a table in Markdown."""
    cells = [header, *rows]
    lines = ["| " + " | ".join(row) + " |" for row in cells]
    return [lines[0], "|" + "---|" * len(header), *lines[1:]]


def along(trajectory: Trajectory[Any, Any]) -> list[str]:
    """The contact force along a run."""
    return [f"Along the run: {'; '.join(str(contact_extremes(trajectory)).splitlines())}."]


def figure_links(axes: Mapping[str, Axes], folder: Path, system: System, title: str) -> list[str]:
    """Writes figures, by name, and links to them."""
    for name, ax in axes.items():
        write_figure(ax, folder / f"{name}.png", system, title)
    return [f"![{name}]({name}.png)" for name in axes]


def path_figure(
    requirements: Sequence[Requirement],
    before: tuple[np.ndarray, np.ndarray],
    after: tuple[np.ndarray, np.ndarray],
    *,
    names: tuple[str, str] = ("before", "after"),
) -> Axes:
    """The paths before and after, each with its times, and their targets; for a disk, positions over time."""
    times, path = after
    followed = [item for item in requirements if isinstance(item, FollowTrajectory | FollowCurve)]
    if path.ndim == 1:
        targets = [item.targets(jnp.asarray(times)) for item in followed if isinstance(item, FollowTrajectory)]
        target = (times, np.asarray(targets[0])[:, 0]) if targets else None
        return plot.place_in_time(dict(zip(names, (before, after), strict=True)), target)
    return plot.designed_path(before[1], path, wanted_path(requirements), discs_to_avoid(requirements), names=names)


def _verdict(design: Design) -> str:
    merit, verified = design.merit, design.verified
    ends = (
        "All constraints hold"
        if design.feasible
        else f"The largest violation is {verified.violation:.3g}; not all hold"
    )
    objective = verified.designed.terms @ design.problem.weights
    stationary = merit.gradient <= 10 * design.settings.stationary
    return (
        f"{ends}, to {design.settings.tolerance:g}, at the samples and at nine times between each two of them. The "
        f"objective is {objective:.6g}. The gradient of the Lagrangian is {merit.gradient:.1e}: the design is "
        f"{'' if stationary else 'not '}stationary. `{SCENARIO}` is the scenario."
    )


def _objectives(design: Design) -> list[str]:
    columns = zip(
        design.problem.objectives,
        design.problem.weights,
        design.before.terms,
        design.verified.designed.terms,
        design.verified.finer.terms,
        np.median(design.perturbed.terms, axis=0),
        np.max(design.perturbed.terms, axis=0),
        strict=True,
    )
    units, rows = objectives_in_units(design), []
    for name, *numbers in columns:
        cells = [f"{x:.6g}" for x in numbers]
        rows.append([name, *cells[:4], units[name], *cells[4:]])
    first = ["objective", "weight", "before", "after", "verified"]
    return [*table([*first, "in units of the scenario", "perturbed, median", "worst"], rows), "", UNITS]


def objectives_in_units(design: Design) -> dict[str, str]:
    """The lengths, angles and times that the verified values of objectives stand for, in units of the scenario."""
    system = design.problem.space.candidate_of(jnp.asarray(design.numbers)).system
    names = design.problem.objectives
    values = dict(zip(names, np.asarray(design.verified.finer.terms).tolist(), strict=True))
    return in_units(names, values, system)


def _constraints(design: Design) -> list[str]:
    if not design.problem.constraints:
        return ["There are no constraints except bounds."]
    places = design.problem.places
    before = places.by_constraint(np.asarray(design.before.violations))
    perturbed = [places.by_constraint(np.asarray(row)) for row in design.perturbed.violations]
    rows = []
    for name, (coarse, fine) in design.verified.violations.items():
        violations = worst(before[name]), coarse, fine, worst([worst(ball[name]) for ball in perturbed])
        rows.append([name, *(violation(by, design.settings.tolerance) for by in violations)])
    header = ["constraint", "before", "after", "verified, between samples too", "perturbed, worst"]
    legend = (
        "Each value is that of the largest violation or the smallest margin; violations and margins are dimensionless."
    )
    return [*table(header, rows), "", legend]


def _variables(design: Design) -> list[str]:
    space = design.problem.space
    start = np.asarray(space.numbers(jnp.asarray(space.start)))
    rows = [
        [", ".join(f"`{path}`" for path in one.paths), f"{old:.8g}", f"{new:.12g}", bounds(one.lower, one.upper)]
        for one, old, new in zip(space.variables, start, design.numbers, strict=True)
    ]
    return table(["variable", "start", "found", "bounds"], rows)


def _checks(design: Design) -> list[str]:
    verified, built = design.verified, as_built(design.problem)
    lines = [
        f"Simulated again by {verified.solver} at the tolerance {verified.rtol:.0e}, the path differs by at most "
        f"{verified.apart:.1e} radii. The {built.count} perturbed balls have errors of up to {built.masses:.1%} in "
        f"masses and up to {built.offset:.1%} of the radius in the centre of mass along each axis.",
    ]
    if design.check is None:
        return lines
    words = "The gradient at the start, along a random direction, relative to its length:"
    return [*lines, "", words, "", "```", str(design.check), "```"]


def _run(trajectory: Trajectory[Any, Any]) -> Run:
    return Run(trajectory.system, jnp.asarray(trajectory.times), trajectory.state, trajectory.status)


def _distances(design: Design, before: Trajectory[Any, Any], after: Trajectory[Any, Any]) -> list[str]:
    lines = []
    for name, item in design.problem.objectives.items():
        if isinstance(item, FollowTrajectory | FollowCurve) and not isinstance(item, LargestDistance):
            old, new = (float(item.farthest(_run(trajectory))) for trajectory in (before, after))
            lines += [f"The largest distance of {name} is {new:.3g} radii; before, it was {old:.3g}.", ""]
    return lines


def _figures(design: Design, before: Trajectory[Any, Any], after: Trajectory[Any, Any]) -> dict[str, Axes]:
    history, problem = np.asarray(design.progress.history), design.problem
    requirements = [*problem.objectives.values(), *problem.constraints.values()]
    axes = {
        "path": path_figure(requirements, _path(before), _path(after)),
        "rails": plot.configuration(after),
        "contact": plot.contact_force(after),
        "convergence": plot.convergence(*history[:, 2:5].T, polish=int(np.sum(history[:, 0] == 0))),
    }
    if float(after.friction_needed) > SMALLEST_FRICTION:
        axes["friction"] = plot.friction_ratio(after)
    if after.system.n_masses:
        theta = np.asarray(jax.jit(lambda: _run(after).on_rails.theta)())
        axes["angles"] = plot.rail_angles(np.asarray(after.times), theta)
    return axes | joint_figures(after)


def joint_figures(trajectory: Trajectory[Any, Any]) -> dict[str, Axes]:
    """Angles and efforts of the joints of mechanisms, if there are any."""
    if not trajectory.system.mechanisms:
        return {}
    return {"joint-angles": plot.joint_angles(trajectory), "joint-efforts": plot.joint_efforts(trajectory)}


def _path(trajectory: Trajectory[Any, Any]) -> tuple[Float[np.ndarray, " t"], Float[np.ndarray, "t *d"]]:
    return np.asarray(trajectory.times), np.asarray(trajectory.state.z)
