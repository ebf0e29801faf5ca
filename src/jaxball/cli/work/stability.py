"""Steady motions found, and their eigenvalues."""

import argparse
from collections.abc import Sequence
from typing import Any

from ...interface.wording import all_of
from ...numerics.programs import compiled_quickly
from ...physics.body import AbstractBody, Ball
from ...scenario import Scenario, ScenarioError
from ...scenario.body import rolling_state
from ...stability import SteadyMotion, permanent_rotations, stability, steady_rolling
from ..input import scenario_of
from ..output import say, working
from .files import write_json, write_outputs
from .motions import complex_numbers, content, save, state_line

MOST_SHOWN = 20  # motions in a summary; files have all
NAMES, COMPLEX = ("turning", "residual", "steady", "stable", "kind"), ("eigenvalues",)
ELSE = "give --initial for a state that is steady, or use jaxball periodic for a motion that repeats itself"


def run(options: argparse.Namespace, document: dict[str, Any]) -> int:
    """Finds the motions of a document, saves them and draws their eigenvalues."""
    scenario = scenario_of(document, options.scenario)
    try:
        with working(options, "searching for steady motions"), compiled_quickly():
            motions = _motions(options, scenario)
    except (ValueError, TypeError) as error:
        raise ScenarioError(str(error)) from None
    written = write_outputs(
        options, scenario, lambda path: save(motions, path, NAMES, COMPLEX), lambda plot: plot.eigenvalues(motions)
    )
    write_json(
        options,
        {"title": scenario.title, "motions": [content(motion, (*NAMES, "message"), COMPLEX) for motion in motions]},
    )
    say(options, scenario.title, *_summary(motions), written)
    return 0


def _motions(options: argparse.Namespace, scenario: Scenario) -> Sequence[SteadyMotion]:
    system = scenario.system
    t = float(scenario.times[0]) if options.time is None else options.time
    rolling_state(scenario.state, scenario.contact, "the stability of steady motions is")
    if not isinstance(system, AbstractBody):
        raise ValueError(
            f"Steady motions are searched for only for a ball or a disk, but the scenario is of a {system.title}; use "
            "jaxball periodic for a motion that repeats itself."
        )
    if options.initial:
        return (stability(system, scenario.state, turning=options.turning or 0.0, t=t),)  # pyright: ignore
    if not isinstance(system, Ball):
        raise ValueError(f"Steady motions of a disk are not searched for; {ELSE}.")
    _require_still(system)
    if options.rolling is not None:
        return (steady_rolling(system, *options.rolling, t=t),)
    return permanent_rotations(system, options.rate or 0.0, t=t)


def _require_still(ball: Ball) -> None:
    """Raises a ``ValueError`` where steady motions of the ball are not searched for, and says what to do instead."""
    if ball.coordinates:
        raise ValueError(
            "Steady motions are searched for only where nothing moves freely or by a law, unlike "
            f"{all_of(ball.coordinates)} here; hold these with a schedule, {ELSE}."
        )
    acting = [f"`{name}`" for name in ("force", "ground", "resistance") if getattr(ball, name) is not None]
    if acting:
        raise ValueError(
            "Steady motions are searched for only on a level plane at rest, without force and resistance, but the "
            f"scenario has {all_of(acting)}; {ELSE}."
        )


def _summary(motions: Sequence[SteadyMotion]) -> list[str]:
    lines = [] if motions else ["No steady motion was found."]
    for motion in motions[:MOST_SHOWN]:
        lines += [state_line(motion), f"  {motion.message}"]
        lines += [f"  eigenvalues {complex_numbers(motion.eigenvalues)}"]
    if len(motions) > MOST_SHOWN:
        lines.append(f"and {len(motions) - MOST_SHOWN} more, because the directions are not isolated; --out saves all")
    return lines
