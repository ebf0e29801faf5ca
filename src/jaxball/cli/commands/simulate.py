"""``jaxball simulate``: simulates, saves and draws a scenario."""

import argparse
import math
import re
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...files.results.files import check_format
from ...files.scenario.errors import ScenarioError
from ...files.scenario.paths import with_values
from ...files.scenario.solvers import SOLVERS
from ...interface.output import check_view
from ...interface.wording import heading, number_of
from ..animation import add_animation, check_animation, check_span, write_animation
from ..input import add_scenario, scenario_document, scenario_of, source_name
from ..jax_setup import compile_for, set_up_jax
from ..options import (
    FAILED_SOLVE,
    BadInputError,
    add_formats,
    add_output,
    add_replacing,
    check_figures_folder,
    check_json,
    name_files,
    number,
    positive,
    say,
    working,
)

if TYPE_CHECKING:
    from ...files.scenario.scenario import Scenario
    from ...simulation.events import AbstractEvent, Occurrences
    from ...simulation.trajectory import Trajectory

# Bytes for each time, measured for balls and disks: of a run, and of its observables for files and figures.
OF_STATES, OF_OBSERVABLES = 800.0, 1_800.0
SETTINGS = ("solver", "rtol", "atol", "max_step")  # of the solve, which options can replace
MANY_TIMES = 1_000_000  # times, for which a user should be warned of the wait


def add(parser: argparse.ArgumentParser) -> None:
    add_scenario(parser)
    parser.add_argument("--end", type=number, metavar="T", help="end at this time, instead of the scenario's")
    parser.add_argument("--out", type=Path, metavar="FILE", help="save the trajectory: .nc, .npz, .csv or .mcap")
    parser.add_argument(
        "--plot",
        type=Path,
        metavar="FOLDER",
        help="draw the figures into this folder, named after the scenario; those of another run are not replaced",
    )
    add_formats(parser, "--plot-format")
    add_replacing(parser)
    parser.add_argument("--view", type=Path, metavar="FILE", help="show the run in one HTML file: .html")
    add_animation(parser)
    parser.add_argument(
        "--solver", choices=SOLVERS, metavar="SOLVER", help=f"instead of the scenario's: one of {', '.join(SOLVERS)}"
    )
    parser.add_argument("--rtol", type=positive, help="relative tolerance, instead of the scenario's")
    parser.add_argument("--atol", type=positive, help="absolute tolerance, instead of the scenario's")
    parser.add_argument("--max-step", type=positive, help="the longest step of the solver, instead of the scenario's")
    parser.add_argument(
        "--contact",
        metavar="LAW",
        help="let the body slip and fly, with this kinetic coefficient of friction, as in 0.3, or with these keys of "
        "[contact], as in friction=0.3,static_friction=0.4,restitution=0.5; replaces the scenario's law",
    )
    parser.add_argument("--friction", type=positive, metavar="MU", help="end where rolling needs more friction than MU")
    parser.add_argument("--detachment", action="store_true", help="end where the body would leave the plane")
    add_output(parser)


def run(options: argparse.Namespace) -> int:
    check_json(options)
    if options.out is not None:
        check_format(options.out, "--out")
    check_figures_folder(options, "plot", "plot_format")
    if options.view is not None:
        check_view(options.view, "--view")
    check_animation(options)
    document = scenario_document(options, options.end)
    set_up_jax()
    from ..files import check_figures, check_shown

    scenario = _scenario(options, _with_contact(document, options.contact))
    check_span(options, scenario)
    if options.view is not None:
        check_shown(scenario.system, "Argument `--view`")
    check_figures(options, scenario)
    # Now that the times are known.
    check_memory(options, scenario.times.size)
    with compile_for(scenario):
        return _simulate(options, scenario)


def _scenario(options: argparse.Namespace, document: dict[str, Any]) -> "Scenario":
    """Reads the scenario of a document with the solver and the tolerances of the options, which errors name as such."""
    settings = {name: getattr(options, name) for name in SETTINGS if getattr(options, name) is not None}
    solve = document.get("solve", {})
    if settings and isinstance(solve, dict):  # else its reader refuses it
        document = document | {"solve": solve | settings}
    try:
        return scenario_of(document, options.scenario)
    except ScenarioError as error:
        if not settings:
            raise
        key = rf"^{re.escape(source_name(options.scenario))}: Key `solve\.({'|'.join(settings)})`"
        raise ScenarioError(re.sub(key, r"Argument `--\1`", str(error), flags=re.MULTILINE)) from None


def _simulate(options: argparse.Namespace, scenario: "Scenario") -> int:
    from ... import plot
    from ...files.scenario.checks import message_in_keys
    from ...physics.rolling import AbstractRollingSystem
    from ...plot.record import finite_rows
    from ..files import find_places, write_json

    # The dense output serves the extremes of the contact force, which other systems do not have; samples have none.
    rolls = isinstance(scenario.system_to_solve, AbstractRollingSystem) and scenario.feedback is None
    # The quantities that show how close the body came to slipping or leaving the plane.
    shown = not options.quiet or any(getattr(options, name) is not None for name in ("out", "json", "plot"))
    events = _events(options, scenario)
    with working(options, "simulating"):
        trajectory = scenario.simulate(dense=rolls and shown, events=events)
    find_places(options)
    written = []
    if options.out is not None:
        with working(options, "evaluating and saving"):
            from ...files.results.saving import save

            _evaluate(trajectory)
            save(trajectory, options.out, scenario)
        written.append(str(options.out))
    if options.view is not None and finite_rows(trajectory).size:  # also for a run that failed, to see why
        with working(options, "writing the view"):
            plot.write_view(trajectory, options.view, scenario.title, friction=options.friction)
        written.append(str(options.view))
    if not trajectory.ok:
        write_json(options, _content(scenario, trajectory))
        files = " and ".join(f'"{path}"' for path in written)
        saved = f" What was computed is in {files}, marked as failed." if written else ""
        print(f"jaxball: {message_in_keys(trajectory)}{saved}", file=sys.stderr)
        return FAILED_SOLVE
    written += _draw(options, scenario, trajectory)
    with working(options, "evaluating"):
        content = {} if options.json is None else _content(scenario, trajectory)
        checks = [] if options.quiet else _checks(trajectory)
    write_json(options, content)
    say(options, heading(scenario.title), trajectory, *checks, name_files(written))
    return 0


def _evaluate(trajectory: "Trajectory[Any, Any]") -> None:
    """Compiles what a file needs: the observables on one core, and the extremes of contact on the other."""
    from ...physics.body import AbstractBody
    from ...simulation.extremes import contact_extremes
    from ...simulation.trajectory import always_rolls

    if not always_rolls(trajectory) or trajectory.interpolant is None:
        return
    forces = "observables" if isinstance(trajectory.system, AbstractBody) else "plane_reaction"
    with ThreadPoolExecutor(1) as beside:
        beside.submit(getattr, trajectory, forces)  # an error will be reported by saving, which needs them as well
        contact_extremes(trajectory)


def _draw(options: argparse.Namespace, scenario: "Scenario", trajectory: "Trajectory[Any, Any]") -> list[str]:
    from ..files import draw_figures

    written = []
    if options.plot is not None:
        with working(options, "drawing"):
            written.append(
                draw_figures(options, trajectory, options.plot, options.plot_format, scenario, options.scenario)
            )
    if options.animate is not None:
        write_animation(options, scenario)
        written.append(str(options.animate))
    return written


def _content(scenario: "Scenario", trajectory: "Trajectory[Any, Any]") -> dict[str, Any]:
    """Returns the summary as JSON: the attributes of a result file, and the state at the end."""
    import numpy as np

    from ...files.results.saving import attributes
    from ...files.results.variables import history_summary
    from ...numerics.arrays import arrays_of
    from ...physics.body import AbstractBody

    about = {name: value for name, value in attributes(trajectory, scenario).items() if name != "format"}
    end = {name: np.asarray(leaf)[-1] for name, leaf in arrays_of(trajectory.state).items()}
    content = {**about, "ok": trajectory.ok, "time": float(trajectory.times[-1]), "state": end}
    if not isinstance(scenario.system, AbstractBody):
        content["law_changes"] = _law_changes(trajectory)
    if trajectory.events:
        content["events"] = {name: _summary(seen) for name, seen in trajectory.events.items()}
    return content | history_summary(trajectory.history.of_body)


def _summary(seen: "Occurrences") -> dict[str, Any]:
    """Describes how often an event happened, and when, as far as there was room."""
    return {
        "count": int(seen.count),
        "times": seen.times[: int(seen.count)].tolist(),
        "unresolved": int(seen.unresolved),
    }


def _events(options: argparse.Namespace, scenario: "Scenario") -> "dict[str, AbstractEvent]":
    from ...physics.rolling import AbstractRollingSystem
    from ...simulation.events import Detachment, Slip

    events: dict[str, AbstractEvent] = {}
    if options.friction is not None:
        events["slip"] = Slip(options.friction)
    if options.detachment:
        events["detachment"] = Detachment()
    if events and not isinstance(scenario.system, AbstractRollingSystem):
        raise ScenarioError(
            "Arguments `--friction` and `--detachment` must be left out for a system that does not roll on a plane, "
            f"such as the {scenario.system.title} of this scenario."
        )
    if scenario.feedback is not None and events:
        raise ScenarioError(
            "Arguments `--friction` and `--detachment` must be left out where the scenario has feedback, whose samples "
            "are solved one by one; the figures show the friction that each needs."
        )
    return events


def _checks(trajectory: "Trajectory[Any, Any]") -> list[str]:
    """Returns the lines about events, the contact of a body with its plane, and conserved quantities of other
    systems.
    """
    from ...physics.body import AbstractBody
    from ...simulation.extremes import contact_extremes
    from ...simulation.trajectory import always_rolls

    lines = [f"{name}: {seen.message}" for name, seen in trajectory.events.items()]
    # With modes or feedback, of which the trajectory's own lines tell, there is no dense output.
    if always_rolls(trajectory) and trajectory.interpolant is not None:
        lines += str(contact_extremes(trajectory)).splitlines()
    if not isinstance(trajectory.system, AbstractBody):
        changes = (f"{name} {change:.1e}" for name, change in _law_changes(trajectory).items())
        lines.append("change of conserved quantities: " + ", ".join(changes))
    return [f"  {line}" for line in lines]


def _law_changes(trajectory: "Trajectory[Any, Any]") -> dict[str, float]:
    """Computes the largest change of each conserved quantity since the start; balances, which change at a rate, are
    left out.
    """
    import equinox as eqx
    import jax
    import jax.numpy as jnp
    import numpy as np

    start = jnp.asarray(trajectory.times[0]), jax.tree.map(lambda leaf: leaf[0], trajectory.state)
    balances = eqx.filter_eval_shape(type(trajectory.system).law_rates, trajectory.system, *start)
    all_laws = trajectory.laws._asdict()
    laws = {name: np.asarray(values) for name, values in all_laws.items() if name not in balances}
    # NaN where an event ended the run; the start is always known.
    return {name: float(np.nanmax(np.abs(values - values[0]))) for name, values in laws.items()}


def _with_contact(document: dict[str, Any], law: str | None) -> dict[str, Any]:
    """Returns the document with its contact law replaced by the one of ``--contact``, a kinetic coefficient or keys
    with values.

    **Raises:** :class:`~jaxball.ScenarioError` for a system that is no ball or disk.
    """
    from ...files.scenario.classical import CLASSICAL

    if law is None:
        return document
    if document.get("kind") in CLASSICAL:
        raise ScenarioError(
            "Argument `--contact` must be left out for a system that is no ball or disk, such as a scenario of the "
            f'kind "{document["kind"]}".'
        )
    keys = law.split(",") if "=" in law else [f"friction={law}"]
    # As a whole, because keys of another law must not mix with those that are given.
    others = {name: value for name, value in document.items() if name != "contact"}
    return with_values(others, [f"contact.{key.strip()}" for key in keys])


def check_memory(options: argparse.Namespace, times: int) -> None:
    """Prints how much memory the saved times need if they are many.

    **Raises:** :class:`BadInputError` where that is more than is free.
    """
    observed = any(getattr(options, name) is not None for name in ("out", "plot", "view"))
    needed, free = times * (OF_STATES + OF_OBSERVABLES * observed), free_memory()
    if needed > free:
        raise BadInputError(
            f"Key `time` asks for {number_of(times, 'time')}, which need about {_gigabytes(needed)} of memory, but "
            f"{_gigabytes(free)} are free; save fewer times."
        )
    if times > MANY_TIMES and not options.quiet:
        warning = f"jaxball: {number_of(times, 'time')} take minutes and about {_gigabytes(needed)} of memory."
        print(warning, file=sys.stderr, flush=True)


def free_memory() -> float:
    """Returns the number of bytes that can be had without swapping; infinite where the system does not say."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
    except OSError:
        return math.inf
    return next((1024.0 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")), math.inf)


def _gigabytes(size: float) -> str:
    return f"{size / 1e9:.2g} GB"
