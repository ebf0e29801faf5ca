"""The Poincaré map of a scenario: where its motion crosses a section of its phase space."""

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

from ...chaos import poincare_map
from ...interface.status import Status
from ...physics.phase_space import phase_point
from ...scenario.body import rolling_state
from ...scenario.paths import entries
from ...scenario.solvers import SOLVERS
from ..commands.chaos import DIRECTIONS
from ..input import scenario_of
from ..options import FAILED_SOLVE, BadInputError
from ..output import say, working
from .files import write_csv, write_json, write_outputs

MOST_CROSSINGS = 100_000


def run(options: argparse.Namespace, document: dict[str, Any], path: str, value: float) -> int:
    """Computes the map of a document where the component at ``path`` is ``value``, saves it and draws it."""
    scenario = scenario_of(document, options.scenario)
    state = rolling_state(scenario.state, scenario.contact, "a Poincaré map is")
    state = phase_point(scenario.system, state)
    known = _components(state)
    path = _checked(path, known)
    others = [name for name in known if name != path]
    across, up = (_checked(name, known) for name in options.axes or (others * 2)[:2])
    name, index = known[path]

    def section(system, t, x):
        return getattr(x, name)[index] - value

    with working(options, "computing the Poincaré map"):
        crossings = poincare_map(
            scenario.system,
            section,
            (scenario.times[0], scenario.times[-1] if options.end is None else options.end),
            state,
            direction=DIRECTIONS[options.direction or "rising"],
            room=MOST_CROSSINGS,
            solver=SOLVERS[scenario.solver](),
            rtol=scenario.rtol,
            atol=scenario.atol,
        )
    state = crossings.state
    columns = {"time": crossings.times} | {name: getattr(state, leaf)[:, *at] for name, (leaf, at) in known.items()}
    title = {"title": scenario.title} if scenario.title else {}
    write_json(options, {**title, "ok": crossings.ok, "message": crossings.message, "count": crossings.count})
    if crossings.status != Status.SUCCESS:
        print(f"jaxball: {crossings.message}", file=sys.stderr)
        return FAILED_SOLVE
    written = write_outputs(
        options,
        scenario,
        lambda path: _save(columns, path),
        lambda plot: plot.poincare_section(columns[across], columns[up], (across, up)),
    )
    heading = f"{crossings.count} crossings of {path} = {value:g}"
    say(options, scenario.title, heading, f"  {crossings.message}", written)
    return 0


def _save(columns: dict[str, np.ndarray], path: Path) -> None:
    if path.suffix == ".npz":
        np.savez_compressed(path, **columns)  # pyright: ignore[reportArgumentType]
    else:
        write_csv(path, columns, zip(*(values.tolist() for values in columns.values()), strict=True))


def _components(state: Any) -> dict[str, tuple[str, tuple[int, ...]]]:
    """The numbers of a state by their paths, counted from 0."""
    return {
        entry: (name, index)
        for name, leaf in vars(state).items()
        for entry, index in entries(name, np.shape(leaf)).items()
    }


def _checked(name: str, known: dict[str, Any]) -> str:
    if name not in known:
        raise BadInputError(f'The component must be one of {", ".join(known)}, but it is "{name}".')
    return name
