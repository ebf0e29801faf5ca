"""Simulates, saves and draws a scenario."""

import argparse
import dataclasses
import sys
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from ...physics.body import AbstractBody
from ...results import save
from ...results.provenance import attributes
from ...scenario import Scenario, ScenarioError
from ...scenario.checks import message_in_keys
from ...scenario.solve import check_dae
from ...simulation.events import AbstractEvent, Detachment, Slip
from ...simulation.extremes import contact_extremes
from ...simulation.trajectory import Trajectory
from ..input import scenario_of
from ..jax_setup import compiled_for
from ..options import FAILED_SOLVE
from ..output import say, working, written_line
from . import contact
from .animation import check_against, write_animation
from .files import check_figures, draw_figures, write_json
from .memory import check_memory
from .view import is_known, write_view


def run(options: argparse.Namespace, document: dict[str, Any]) -> int:
    """Simulates the scenario of a document, saves and draws its run, and prints its summary."""
    changes = {name: getattr(options, name) for name in ("solver", "rtol", "atol")}
    changes = {name: value for name, value in changes.items() if value is not None}
    document = contact.with_contact(document, options.contact)
    scenario = dataclasses.replace(scenario_of(document, options.scenario), **changes)
    if options.solver is not None:
        check_dae(scenario.system, scenario.contact, options.solver, scenario.dae, "Argument `--solver`")
    check_against(options, scenario)
    check_figures(options, scenario)
    check_memory(options, scenario.times.size)
    with compiled_for(scenario):
        return _simulate(options, scenario)


def _simulate(options: argparse.Namespace, scenario: Scenario) -> int:
    rolls = isinstance(scenario.system, AbstractBody) and scenario.contact is None
    events = _events(options, scenario)
    with working(options, "compiling and simulating"):
        trajectory = scenario.simulate(dense=rolls and _shows_contact(options), events=events)
    written = []
    if options.out is not None:
        with working(options, "evaluating and saving"):
            _evaluate(trajectory)
            save(trajectory, options.out, scenario)
        written.append(str(options.out))
    if options.view is not None and is_known(trajectory):  # also for a run that failed, to see why
        with working(options, "writing the view"):
            write_view(trajectory, options.view, scenario.title, options.friction)
        written.append(str(options.view))
    if not trajectory.ok:
        write_json(options, _content(scenario, trajectory))
        saved = f" What was computed is in {_quoted(written)}, marked as failed." if written else ""
        print(f"jaxball: {message_in_keys(trajectory)}{saved}", file=sys.stderr)
        return FAILED_SOLVE
    written += _draw(options, scenario, trajectory)
    with working(options, "evaluating"):
        content = {} if options.json is None else _content(scenario, trajectory)
        checks = [] if options.quiet else _checks(trajectory)
    write_json(options, content)
    say(options, scenario.title, trajectory, *checks, written_line(written))
    return 0


def _quoted(paths: list[str]) -> str:
    return " and ".join(f'"{path}"' for path in paths)


def _shows_contact(options: argparse.Namespace) -> bool:
    """Whether any requested output shows how close the ball came to slipping or leaving the plane."""
    return not options.quiet or any(getattr(options, name) is not None for name in ("out", "json", "plot"))


def _evaluate(trajectory: Trajectory[Any, Any]) -> None:
    """Compiles what a file needs: the observables on one core, and the extremes of contact on the other."""
    if not isinstance(trajectory.system, AbstractBody) or trajectory.interpolant is None:
        return
    with ThreadPoolExecutor(1) as beside:
        beside.submit(lambda: trajectory.observables)  # an error will be reported by saving, which needs them as well
        contact_extremes(trajectory)


def _draw(options: argparse.Namespace, scenario: Scenario, trajectory: Trajectory) -> list[str]:
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


def _content(scenario: Scenario, trajectory: Trajectory[Any, Any]) -> dict[str, Any]:
    """The summary as JSON: the attributes of a result file, and the state at the end."""
    about = {name: value for name, value in attributes(trajectory, scenario).items() if name != "format"}
    end = {name: np.asarray(leaf)[-1] for name, leaf in vars(trajectory.state).items()}
    content = {**about, "ok": trajectory.ok, "time": float(trajectory.times[-1]), "state": end}
    if not isinstance(scenario.system, AbstractBody):
        content["law_changes"] = _law_changes(trajectory)
    if trajectory.contact is not None:
        content["contact"] = contact.content(trajectory.contact)
    return content


def _events(options: argparse.Namespace, scenario: Scenario) -> dict[str, AbstractEvent]:
    events: dict[str, AbstractEvent] = {}
    if options.friction is not None:
        events["slip"] = Slip(options.friction)
    if options.detachment:
        events["detachment"] = Detachment()
    if events and not isinstance(scenario.system, AbstractBody):
        raise ScenarioError(
            "Arguments `--friction` and `--detachment` must be left out for a system that touches no plane, such as "
            f"the {scenario.system.title} of this scenario."
        )
    contact.check_against_contact(scenario.contact, events)
    return events


def _checks(trajectory: Trajectory[Any, Any]) -> list[str]:
    """The lines about the contact of a body with its plane, or about conserved quantities."""
    if trajectory.contact is not None:
        return []  # they are among the trajectory's own lines
    return _contact(trajectory) if isinstance(trajectory.system, AbstractBody) else _conservation(trajectory)


def _contact(trajectory: Trajectory[Any, Any]) -> list[str]:
    return [f"  {line}" for line in str(contact_extremes(trajectory)).splitlines()]


def _conservation(trajectory: Trajectory[Any, Any]) -> list[str]:
    changes = (f"{name} {change:.1e}" for name, change in _law_changes(trajectory).items())
    return ["  change of conserved quantities: " + ", ".join(changes)]


def _law_changes(trajectory: Trajectory[Any, Any]) -> dict[str, float]:
    """The largest change of each conserved quantity since the start."""
    laws = {name: np.asarray(values) for name, values in trajectory.laws._asdict().items()}
    return {name: float(np.max(np.abs(values - values[0]))) for name, values in laws.items()}
