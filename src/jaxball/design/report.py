"""The report of a design: all its numbers in Markdown, and figures."""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tomli_w
from jaxtyping import Float
from matplotlib.axes import Axes

from .. import plot
from ..interface.output import replacing
from ..physics.body import Disk
from ..plot.report import write_figure
from ..scenario import ScenarioError
from ..simulation.extremes import contact_extremes
from ..simulation.trajectory import Trajectory
from .cells import bounds, in_units, violation
from .objectives import FollowCurve, FollowTrajectory, LargestDistance
from .problem import worst
from .remarks import remarks
from .run import Run
from .search import SCENARIO, Design
from .source import Source, made
from .verify import as_built
from .wanted import curve_and_discs, places_in_time

# Less is rounding, of which there is nothing to draw.
SMALLEST_FRICTION = 1e-9


def write_report(design: Design, title: str, folder: Path, source: Source | None = None) -> Path:
    """Writes ``design.toml``, ``report.md`` and its figures into ``folder``; the path of the report.

    With a ``source`` the report names it, and a copy of the problem file is beside it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if source is not None:
        source.copy(folder)
    document, space = design.document, design.problem.space
    with replacing(folder / SCENARIO) as beside:
        beside.write_text(tomli_w.dumps(document), encoding="utf-8")
    lines = [f"# {title or 'A design'}", "", *_verdict(design), "", *_remarks(design)]
    lines += [*_objectives(design), "", *_constraints(design), ""]
    lines += [*_variables(design), "", *_checks(design), ""]
    try:
        before = _simulated(design, np.asarray(space.numbers(jnp.asarray(space.start))))
        after = _simulated(design, design.numbers)
        lines += [*_distances(design, before, after), *_contact(after), ""]
        lines += [*_figures(design, before, after, title, folder), ""]
    except ScenarioError as error:
        lines += [f"The scenario cannot be run by `jaxball simulate`: {error}", ""]
    lines += made(source, design.progress.elapsed, resumed=design.check is None)
    with replacing(folder / "report.md") as beside:
        beside.write_text("\n".join(lines), encoding="utf-8")
    return folder / "report.md"


def _verdict(design: Design) -> list[str]:
    worth, seen = design.worth, design.verified
    ends = "All constraints hold" if design.feasible else f"The largest violation is {seen.violation:.3g}; not all hold"
    objective = seen.designed.terms @ design.problem.weights
    stationary = worth.gradient <= 10 * design.settings.stationary
    return [
        f"{ends}, to {design.settings.tolerance:g}, at the samples and at nine places between each two of them. The "
        f"objective is {objective:.6g}. The gradient of the Lagrangian is {worth.gradient:.1e}: the design is "
        f"{'' if stationary else 'not '}stationary. `{SCENARIO}` is the scenario.",
    ]


def _remarks(design: Design) -> list[str]:
    return [line for remark in remarks(design) for line in (remark, "")]


def _objectives(design: Design) -> list[str]:
    rows = [
        "| objective | weight | before | after | verified | in units of the scenario | perturbed, median | worst |",
        "|" + "---|" * 8,
    ]
    terms = zip(
        design.problem.objectives,
        design.problem.weights,
        design.before.terms,
        design.verified.designed.terms,
        design.verified.finer.terms,
        np.median(design.perturbed.terms, axis=0),
        np.max(design.perturbed.terms, axis=0),
        strict=True,
    )
    meant = objectives_in_units(design)
    for name, *numbers in terms:
        cells = [f"{x:.6g}" for x in numbers]
        rows.append("| " + " | ".join([name, *cells[:4], meant[name], *cells[4:]]) + " |")
    return [*rows, "", "Objectives are dimensionless: lengths over r, times over √(r/g), forces over M g."]


def objectives_in_units(design: Design) -> dict[str, str]:
    """The lengths, angles and times that the verified values of objectives stand for, in units of the scenario."""
    system = design.problem.space.candidate_of(jnp.asarray(design.numbers)).system
    names = design.problem.objectives
    values = dict(zip(names, np.asarray(design.verified.finer.terms).tolist(), strict=True))
    return in_units(names, values, system)


def _constraints(design: Design) -> list[str]:
    if not design.problem.constraints:
        return ["There are no constraints but bounds."]
    places = design.problem.places
    before = places.by_constraint(np.asarray(design.before.violations))
    shaken = [places.by_constraint(np.asarray(row)) for row in design.perturbed.violations]
    rows = [
        "| constraint | before | after | verified, between samples too | perturbed, worst |",
        "|" + "---|" * 5,
    ]
    for name, (coarse, fine) in design.verified.violations.items():
        perturbed = worst([worst(one[name]) for one in shaken])
        cells = [violation(by, design.settings.tolerance) for by in (worst(before[name]), coarse, fine, perturbed)]
        rows.append("| " + " | ".join([name, *cells]) + " |")
    looked = (
        "Each is where it is nearest to being violated, or violated most; violations and margins are dimensionless."
    )
    return [*rows, "", looked]


def _variables(design: Design) -> list[str]:
    space = design.problem.space
    start = np.asarray(space.numbers(jnp.asarray(space.start)))
    rows = ["| variable | start | found | bounds |", "|" + "---|" * 4]
    for variable, old, new in zip(space.variables, start, design.numbers, strict=True):
        names = ", ".join(f"`{path}`" for path in variable.paths)
        rows.append(f"| {names} | {old:.8g} | {new:.12g} | {bounds(variable.lower, variable.upper)} |")
    return rows


def _checks(design: Design) -> list[str]:
    seen, found, shaken = design.verified, design.check, as_built(design.problem)
    lines = [
        f"Simulated again by {seen.solver} at the tolerance {seen.rtol:.0e}, the path is {seen.apart:.1e} radii "
        f"away at most. Perturbed are {shaken.count} balls with masses off by up to {shaken.masses:.1%} and centres of "
        f"mass by up to {shaken.offset:.1%} of the radius along each axis.",
    ]
    if found is None:
        return lines
    words = "The gradient at the start, along a random direction, relative to its length:"
    return [*lines, "", words, "", "```", str(found), "```"]


def _contact(after: Trajectory) -> list[str]:
    return [f"Along the run: {'; '.join(str(contact_extremes(after)).splitlines())}."]


def _simulated(design: Design, numbers: Float[np.ndarray, " n"]) -> Trajectory[Any, Any]:
    return design.problem.space.scenario_of(numbers).simulate(dense=True)


def _run(trajectory: Trajectory[Any, Any]) -> Run:
    return Run(trajectory.system, jnp.asarray(trajectory.times), trajectory.state, trajectory.status)


def _distances(design: Design, before: Trajectory[Any, Any], after: Trajectory[Any, Any]) -> list[str]:
    lines = []
    for name, item in design.problem.objectives.items():
        if isinstance(item, FollowTrajectory | FollowCurve) and not isinstance(item, LargestDistance):
            old, new = (float(item.farthest(_run(trajectory))) for trajectory in (before, after))
            lines += [f"The largest distance of {name} is {new:.3g} radii; before it was {old:.3g}.", ""]
    return lines


def _figures(
    design: Design, before: Trajectory[Any, Any], after: Trajectory[Any, Any], title: str, folder: Path
) -> list[str]:
    history, run = np.asarray(design.progress.history), _run(after)
    wanted = [*design.problem.objectives.values(), *design.problem.constraints.values()]
    axes = {
        "path": _path_of_disk(design, before, after)
        if isinstance(after.system, Disk)
        else plot.designed_path(_path(before), _path(after), *curve_and_discs(wanted)),
        "rails": plot.configuration(after),
        "contact": plot.contact_force(after),
        "convergence": plot.convergence(*history[:, 2:5].T, polish=int(np.sum(history[:, 0] == 0))),
    }
    if float(after.friction_needed) > SMALLEST_FRICTION:
        axes["friction"] = plot.friction_ratio(after)
    if after.system.n_masses:
        theta = np.asarray(jax.jit(lambda: run.on_rails.theta)())
        axes["angles"] = plot.rail_angles(np.asarray(after.times), theta)
    for name, ax in axes.items():
        write_figure(ax, folder / f"{name}.png", after.system, title)
    return [f"![{name}]({name}.png)" for name in axes]


def _path_of_disk(design: Design, before: Trajectory[Any, Any], after: Trajectory[Any, Any]) -> Axes:
    """Over time, because it is a line in the plane."""
    times = np.asarray(after.times)
    wanted = places_in_time(design.problem.objectives.values(), times)
    found = {name: (np.asarray(run.times), _path(run)[:, 0]) for name, run in (("before", before), ("after", after))}
    return plot.place_in_time(found, None if wanted is None else (times, wanted[:, 0]))


def _path(trajectory: Trajectory[Any, Any]) -> np.ndarray:
    return np.asarray(trajectory.state.in_space().z)
