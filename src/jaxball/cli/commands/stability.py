"""``jaxball stability``: the steady motions of a ball, and their linear stability."""

import argparse
import csv
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...interface.output import check_destination, replacing
from ...physics.body import AbstractBody, Ball
from ...scenario import Scenario, ScenarioError
from ...scenario.paths import entries
from ...stability import SteadyMotion, permanent_rotations, stability, steady_rolling
from ..options import number
from ..pictures import check_figure, write_figure
from ..source import add_source, scenario_of
from ..speaking import add_speaking, check_json, say, write_json

SHOWN = 20  # motions in a summary; files have all


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser(
        "stability",
        description=(
            "Finds the directions about which a ball can rest or spin in place (--rate), its rolling in circles "
            "(--rolling), or takes the scenario's initial state (--initial), and says by eigenvalues which are stable. "
            "Masses must be at rest in the body."
        ),
    )
    add_source(parser)
    motions = parser.add_mutually_exclusive_group()
    motions.add_argument("--rate", type=number, metavar="OMEGA", help="spin at this rate (default: 0, rest)")
    motions.add_argument(
        "--rolling", type=number, nargs=2, metavar=("INCLINATION", "PRECESSION"), help="roll in circles like this"
    )
    motions.add_argument("--initial", action="store_true", help="the scenario's initial state")
    parser.add_argument("--turning", type=number, metavar="RATE", help="at which the state of --initial turns about E3")
    parser.add_argument("--time", type=number, metavar="T", help="when schedules are read (default: the start)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="save the states and eigenvalues: .csv")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the eigenvalues: .png, .pdf or .svg")
    add_speaking(parser)
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    check_json(options)
    check_figure(options)
    if options.out is not None:
        check_destination(options.out, (".csv",), "--out")
    if options.turning is not None and not options.initial:
        raise ScenarioError("Argument `--turning` is for a state that is given; give --initial with it.")
    scenario = scenario_of(options)
    try:
        motions = _motions(options, scenario)
    except (ValueError, TypeError) as error:
        raise ScenarioError(str(error)) from None
    written = []
    if options.out is not None:
        _write_table(motions, options.out)
        written.append(str(options.out))
    if options.plot is not None:
        from ... import plot

        write_figure(plot.eigenvalues(motions), options.plot, scenario)
        written.append(str(options.plot))
    write_json(options, {"title": scenario.title, "motions": [_content(motion) for motion in motions]})
    say(options, "\n".join(_summary(scenario, motions, written)))
    return 0


def _motions(options: argparse.Namespace, scenario: Scenario) -> Sequence[SteadyMotion]:
    system = scenario.system
    t = float(scenario.times[0]) if options.time is None else options.time
    if not isinstance(system, AbstractBody):
        raise ValueError(f"The steady motions are those of what rolls, but the scenario is of a {system.title}.")
    if options.initial:
        return (stability(system, scenario.state, turning=options.turning or 0.0, t=t),)  # pyright: ignore
    if not isinstance(system, Ball):
        raise ValueError("The steady motions of a disk are not searched for; give --initial for that of its state.")
    if system.force is not None:
        raise ValueError("The steady motions are those without a force, but the scenario has one.")
    if options.rolling is not None:
        return (steady_rolling(system, *options.rolling, t=t),)
    return permanent_rotations(system, options.rate or 0.0, t=t)


def _summary(scenario: Scenario, motions: Sequence[SteadyMotion], written: list[str]) -> list[str]:
    lines = [scenario.title] if scenario.title else []
    lines += ["No steady motion was found."] if not motions else []
    for motion in motions[:SHOWN]:
        lines.append(", ".join(f"{name} = {_numbers(leaf)}" for name, leaf in _state(motion).items()))
        lines += [f"  {motion.message}", f"  eigenvalues {', '.join(map(_complex, motion.eigenvalues))}"]
    if len(motions) > SHOWN:
        lines.append(f"and {len(motions) - SHOWN} more: the directions are not isolated, or --out has them all")
    return [*lines, *(["  written: " + ", ".join(written)] if written else [])]


def _state(motion: SteadyMotion) -> dict[str, np.ndarray]:
    return {name: np.asarray(leaf) for name, leaf in vars(motion.state).items() if np.size(leaf)}


def _numbers(values: np.ndarray) -> str:
    shown: Callable[[Any], str] = lambda x: f"{x + 0.0:.6g}" if abs(x) > 1e-12 else "0"  # noqa: E731
    return shown(float(values)) if values.ndim == 0 else f"({', '.join(map(shown, values.tolist()))})"


def _complex(value: complex) -> str:
    real, imaginary = (0.0 if abs(part) < 1e-9 else part for part in (value.real, value.imag))
    if not imaginary:
        return f"{real:.6g}"
    return f"{real:.6g}{imaginary:+.6g}i" if real else f"{imaginary:.6g}i"


def _content(motion: SteadyMotion) -> dict[str, Any]:
    names = ("turning", "residual", "steady", "stable", "kind", "message")
    return {
        "state": _state(motion),
        **{name: getattr(motion, name) for name in names},
        "eigenvalues": motion.eigenvalues,
    }


def _write_table(motions: Sequence[SteadyMotion], path: Path) -> None:
    """A row for each motion, its columns named by paths."""
    with replacing(path) as beside, beside.open("w", newline="", encoding="utf-8") as file:
        rows = [_row(motion) for motion in motions]
        writer = csv.DictWriter(file, list(rows[0]) if rows else ["kind"], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def _row(motion: SteadyMotion) -> dict[str, Any]:
    row: dict[str, Any] = {}
    for name, values in _state(motion).items():
        row |= {entry: repr(float(values[index])) for entry, index in entries(name, values.shape).items()}
    row |= {name: getattr(motion, name) for name in ("turning", "residual", "steady", "stable", "kind")}
    for k, value in enumerate(motion.eigenvalues):
        row |= {f"eigenvalue[{k}].real": repr(float(value.real)), f"eigenvalue[{k}].imaginary": repr(float(value.imag))}
    return row
