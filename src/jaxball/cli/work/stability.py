"""Steady motions found, and their eigenvalues."""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...numerics.programs import compiled_quickly
from ...physics.body import AbstractBody, Ball
from ...scenario import Scenario, ScenarioError
from ...scenario.contact import rolling_state
from ...scenario.paths import entries
from ...stability import SteadyMotion, permanent_rotations, stability, steady_rolling
from ..input import scenario_of
from ..output import say, working
from .files import write_csv, write_json, write_outputs

MOST_SHOWN = 20  # motions in a summary; files have all


def run(options: argparse.Namespace, document: dict[str, Any]) -> int:
    """Finds the motions of a document, saves them and draws their eigenvalues."""
    scenario = scenario_of(document, options.scenario)
    try:
        with working(options, "searching for steady motions"), compiled_quickly():
            motions = _motions(options, scenario)
    except (ValueError, TypeError) as error:
        raise ScenarioError(str(error)) from None
    written = write_outputs(
        options, scenario, lambda path: _save(motions, path), lambda plot: plot.eigenvalues(motions)
    )
    write_json(options, {"title": scenario.title, "motions": [_content(motion) for motion in motions]})
    say(options, scenario.title, *_summary(motions), written)
    return 0


def _motions(options: argparse.Namespace, scenario: Scenario) -> Sequence[SteadyMotion]:
    system = scenario.system
    t = float(scenario.times[0]) if options.time is None else options.time
    rolling_state(scenario.state, scenario.contact, "the stability of steady motions is")
    if not isinstance(system, AbstractBody):
        raise ValueError(f"Steady motions are those of a ball or a disk, but the scenario is of a {system.title}.")
    if options.initial:
        return (stability(system, scenario.state, turning=options.turning or 0.0, t=t),)  # pyright: ignore
    if not isinstance(system, Ball):
        raise ValueError("Steady motions of a disk are not searched for; give --initial to analyse its initial state.")
    if system.force is not None:
        raise ValueError("Steady motions are found without a force only, but the scenario has one.")
    if options.rolling is not None:
        return (steady_rolling(system, *options.rolling, t=t),)
    return permanent_rotations(system, options.rate or 0.0, t=t)


def _summary(motions: Sequence[SteadyMotion]) -> list[str]:
    lines = [] if motions else ["No steady motion was found."]
    for motion in motions[:MOST_SHOWN]:
        lines.append(", ".join(f"{name} = {_numbers(leaf)}" for name, leaf in _state(motion).items()))
        lines += [f"  {motion.message}", f"  eigenvalues {', '.join(map(_complex, motion.eigenvalues))}"]
    if len(motions) > MOST_SHOWN:
        lines.append(f"and {len(motions) - MOST_SHOWN} more, because the directions are not isolated; --out saves all")
    return lines


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


def _save(motions: Sequence[SteadyMotion], path: Path) -> None:
    """One row for each motion, its columns named by paths."""
    rows = [_row(motion) for motion in motions]
    write_csv(path, rows[0] if rows else ["kind"], (row.values() for row in rows))


def _row(motion: SteadyMotion) -> dict[str, Any]:
    row: dict[str, Any] = {}
    for name, values in _state(motion).items():
        row |= {entry: repr(float(values[index])) for entry, index in entries(name, values.shape).items()}
    row |= {name: getattr(motion, name) for name in ("turning", "residual", "steady", "stable", "kind")}
    for k, value in enumerate(motion.eigenvalues):
        row |= {f"eigenvalue[{k}].real": repr(float(value.real)), f"eigenvalue[{k}].imaginary": repr(float(value.imag))}
    return row
