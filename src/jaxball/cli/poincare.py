"""``jaxball chaos --poincare``: where a motion crosses a section of its phase space."""

import argparse
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

from ..chaos import poincare_map
from ..interface.output import OutputError
from ..interface.status import Status
from ..physics.phase_space import phase_point
from ..scenario import ScenarioError
from ..scenario.paths import entries
from ..scenario.solve import SOLVERS
from .input import scenario_of
from .options import FAILED_SOLVE
from .output import check_outputs, say, write_csv, write_json, write_outputs

DIRECTIONS = {"rising": 1, "falling": -1, "both": 0}
MOST_CROSSINGS = 100_000


def add_options(parser: argparse.ArgumentParser, kinds: Any) -> None:
    """Adds --poincare and its options."""
    kinds.add_argument(
        "--poincare",
        metavar="COMPONENT=VALUE",
        help="a Poincaré map instead: the states in which a component has a value, as in 'Omega[0]=0'",
    )
    parser.add_argument("--direction", choices=DIRECTIONS, help="of the crossings of --poincare (default: rising)")
    parser.add_argument(
        "--axes", nargs=2, metavar="COMPONENT", help="the axes of --poincare's figure, as in 'Omega[1]' 'Gamma[2]'"
    )


def check_options(options: argparse.Namespace) -> None:
    """Raises an :class:`~jaxball.results.OutputError` for options that do not go together."""
    for name in ("direction", "axes"):
        if getattr(options, name) is not None and options.poincare is None:
            raise OutputError(f"Argument `--{name}` is for a Poincaré map; give --poincare COMPONENT=VALUE with it.")
    for name in ("exponents", "interval"):
        if options.poincare is not None and getattr(options, name) is not None:
            raise OutputError(f"Argument `--{name}` is for Lyapunov exponents; leave it out with --poincare.")
    if options.poincare is not None and options.transient:
        raise OutputError("Argument `--transient` is for Lyapunov exponents; leave it out with --poincare.")


def run(options: argparse.Namespace) -> int:
    """Computes the map, saves it and draws it."""
    check_outputs(options, (".csv", ".npz"))
    scenario = scenario_of(options)
    state = phase_point(scenario.system, scenario.state)
    known = _components(state)
    path, value = _section(options.poincare, known)
    others = [name for name in known if name != path]
    across, up = (_checked(name, known) for name in options.axes or (others * 2)[:2])
    name, index = known[path]

    def section(system, t, x):
        return getattr(x, name)[index] - value

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


def _section(text: str, known: dict[str, Any]) -> tuple[str, float]:
    path, equals, value = text.partition("=")
    try:
        number = float(value) if equals else math.nan
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ScenarioError(
            f"Argument `--poincare` must be COMPONENT=VALUE, such as 'Omega[0]=0', but it is \"{text}\"."
        )
    return _checked(path.strip(), known), number


def _checked(name: str, known: dict[str, Any]) -> str:
    if name not in known:
        raise ScenarioError(f'The components of this state are {", ".join(known)}, but not "{name}".')
    return name
