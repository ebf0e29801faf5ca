"""``jaxball chaos --poincare``: where a motion crosses a section of its phase space."""

import argparse
import csv
import math
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np

from ..chaos import poincare_map
from ..interface.output import OutputError, check_destination, replacing
from ..interface.status import Status
from ..physics.phase_space import phase_point
from ..scenario import Scenario, ScenarioError
from ..scenario.paths import entries
from ..scenario.solve import SOLVERS
from .options import FAILED_SOLVE
from .pictures import write_figure
from .source import scenario_of
from .speaking import say, write_json

DIRECTIONS = {"rising": 1, "falling": -1, "both": 0}
ROOM = 100_000


def add_options(parser: argparse.ArgumentParser, kinds: Any) -> None:
    """Adds --poincare and its options."""
    kinds.add_argument(
        "--poincare",
        metavar="COMPONENT=VALUE",
        help="a Poincaré map instead: the states at which a component has a value, as in 'Omega[0]=0'",
    )
    parser.add_argument("--direction", choices=DIRECTIONS, help="of the crossings of --poincare (default: rising)")
    parser.add_argument(
        "--axes", nargs=2, metavar="COMPONENT", help="what the figure of --poincare shows, as in 'Omega[1]' 'Gamma[2]'"
    )


def check_options(options: argparse.Namespace) -> None:
    """Raises an :class:`~jaxball.results.OutputError` for options that are of no use together."""
    for name in ("direction", "axes"):
        if getattr(options, name) is not None and options.poincare is None:
            raise OutputError(f"Argument `--{name}` is for a Poincaré map; give --poincare COMPONENT=VALUE with it.")
    for name in ("exponents", "interval"):
        if options.poincare is not None and getattr(options, name) is not None:
            raise OutputError(f"Argument `--{name}` is for Lyapunov exponents; leave it out beside --poincare.")
    if options.poincare is not None and options.transient:
        raise OutputError("Argument `--transient` is for Lyapunov exponents; leave it out beside --poincare.")


def run(options: argparse.Namespace) -> int:
    """Makes the map, saves it and draws it."""
    if options.out is not None:
        check_destination(options.out, (".csv", ".npz"), "--out")
    scenario = scenario_of(options)
    state = phase_point(scenario.system, scenario.state)
    known = _components(state)
    path, value = _section(options.poincare, known)
    others = [name for name in known if name != path]
    across, up = (_known(name, known) for name in options.axes or (others * 2)[:2])
    name, index = _place(path)

    def section(system, t, x):
        return getattr(x, name)[index] - value

    found = poincare_map(
        scenario.system,
        section,
        (scenario.times[0], scenario.times[-1] if options.end is None else options.end),
        state,
        direction=DIRECTIONS[options.direction or "rising"],
        room=ROOM,
        solver=SOLVERS[scenario.solver](),
        rtol=scenario.rtol,
        atol=scenario.atol,
    )
    columns = {"time": found.times} | {name: getattr(found.state, place)[:, *at] for name, (place, at) in known.items()}
    title = {"title": scenario.title} if scenario.title else {}
    write_json(options, {**title, "ok": found.ok, "message": found.message, "count": found.count})
    if found.status != Status.SUCCESS:
        print(f"jaxball: {found.message}", file=sys.stderr)
        return FAILED_SOLVE
    lines = [*title.values(), f"{found.count} crossings of {path} = {value:g}", f"  {found.message}"]
    lines += _written(options, scenario, columns, (across, up))
    say(options, "\n".join(lines))
    return 0


def _written(
    options: argparse.Namespace, scenario: Scenario, columns: dict[str, np.ndarray], axes: tuple[str, str]
) -> list[str]:
    lines = []
    if options.out is not None:
        _write(columns, options.out)
        lines.append(f"  written: {options.out}")
    if options.plot is not None:
        from .. import plot

        write_figure(plot.poincare_section(columns[axes[0]], columns[axes[1]], axes), options.plot, scenario)
        lines.append(f"  written: {options.plot}")
    return lines


def _write(columns: dict[str, np.ndarray], path: Path) -> None:
    with replacing(path) as beside:
        if path.suffix == ".npz":
            np.savez_compressed(beside, **columns)  # pyright: ignore[reportArgumentType]
            return
        with beside.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))


def _components(state: Any) -> dict[str, tuple[str, tuple[int, ...]]]:
    """The numbers of a state by their paths, counted from 0."""
    return {
        entry: (name, index)
        for name, leaf in vars(state).items()
        for entry, index in entries(name, np.shape(leaf)).items()
    }


def _place(path: str) -> tuple[str, tuple[int, ...]]:
    return path.split("[")[0], tuple(int(index) for index in re.findall(r"\[(\d+)\]", path))


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
    return _known(path.strip(), known), number


def _known(name: str, known: dict[str, Any]) -> str:
    if name not in known:
        raise ScenarioError(f'The components of this state are {", ".join(known)}, and "{name}" is none of them.')
    return name
