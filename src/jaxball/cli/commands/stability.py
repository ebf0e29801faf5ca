"""``jaxball stability``: the steady motions of a ball, and their linear stability."""

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ...files.scenario.errors import ScenarioError
from ...interface.wording import all_of
from ..input import SETTINGS, add_scenario, read_scenario, refuse_settings
from ..options import BadInputError, add_results, check_outputs, in_commands, number, working

if TYPE_CHECKING:
    from ...analysis.stability.steady import SteadyMotion
    from ...files.scenario.scenario import Scenario

MOST_MOTIONS_SHOWN = 20  # motions in a summary; files have all
NAMES, COMPLEX = ("turning", "residual", "ok", "stable", "kind"), ("eigenvalues",)
ELSE = "give --initial for a state that is steady, or use jaxball periodic for a motion that repeats itself"


def add(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Finds the directions about which a ball can rest or spin in place (--rate) or its rolling in circles "
        "(--rolling), or takes the scenario's initial state (--initial), and computes the eigenvalues that decide "
        "its stability. Masses must be at rest in the body."
    )
    add_scenario(parser)
    motions = parser.add_mutually_exclusive_group()
    motions.add_argument("--rate", type=number, metavar="OMEGA", help="spin at this rate (default: 0, rest)")
    motions.add_argument(
        "--rolling", type=number, nargs=2, metavar=("INCLINATION", "PRECESSION"), help="roll in circles"
    )
    motions.add_argument("--initial", action="store_true", help="the scenario's initial state")
    parser.add_argument("--turning", type=number, metavar="RATE", help="rate at which the state of --initial turns")
    parser.add_argument("--time", type=number, metavar="T", help="the time of the schedules (default: the start)")
    add_results(parser, "the states and eigenvalues: .csv", "the eigenvalues")


def run(options: argparse.Namespace) -> int:
    check_outputs(options, (".csv",))
    if options.turning is not None and not options.initial:
        raise BadInputError("Argument `--turning` is for the scenario's initial state; give --initial with it.")
    refuse_settings(options, "stability", SETTINGS)
    scenario = read_scenario(options)
    from ...programs.program import compile_quickly
    from ..files import motion_content, report, save_motions

    try:
        with working(options, "searching for steady motions"), compile_quickly():
            motions = _motions(options, scenario)
    except (ValueError, TypeError) as error:
        raise ScenarioError(str(error)) from None
    return report(
        options,
        scenario,
        {
            "title": scenario.title,
            "motions": [motion_content(motion, (*NAMES, "message"), COMPLEX) for motion in motions],
        },
        _summary(motions),
        save=lambda path: save_motions(motions, path, NAMES, COMPLEX),
        draw=lambda plot: plot.eigenvalues(motions),
    )


def _motions(options: argparse.Namespace, scenario: "Scenario") -> "Sequence[SteadyMotion]":
    from ...analysis.stability import permanent_rotations, steady_motion, steady_rolling
    from ...files.scenario.body import rolling_state
    from ...physics.body import AbstractBody, Ball

    system = scenario.system
    t = float(scenario.times[0]) if options.time is None else options.time
    rolling_state(scenario, "the stability of steady motions is")
    if not isinstance(system, AbstractBody):
        raise ValueError(
            f"Steady motions are those of a ball or a disk, but the scenario is of a {system.title}; use "
            "jaxball periodic for a motion that repeats itself."
        )
    if options.initial:
        return (steady_motion(system, scenario.state, turning=options.turning or 0.0, t=t),)  # pyright: ignore
    if not isinstance(system, Ball):
        raise ValueError(f"Steady motions of a {system.title} are not searched for, only those of a ball; {ELSE}.")
    _require_still(system)
    if options.rolling is not None:
        return (steady_rolling(system, *options.rolling, t=t),)
    return permanent_rotations(system, options.rate or 0.0, t=t)


def _require_still(ball: Any) -> None:
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


NO_MOTION = (
    "No steady motion was found. There is none at a time at which masses move in the ball: --time chooses another, and "
    "--initial analyses the state at the start."
)


def _summary(motions: "Sequence[SteadyMotion]") -> list[str]:
    from ..files import complex_numbers, state_line

    lines = [] if motions else [NO_MOTION]
    for motion in motions[:MOST_MOTIONS_SHOWN]:
        lines += [state_line(motion), f"  {in_commands(motion.message)}"]
        lines += [f"  eigenvalues {complex_numbers(motion.eigenvalues)}"]
    if len(motions) > MOST_MOTIONS_SHOWN:
        lines.append(
            f"and {len(motions) - MOST_MOTIONS_SHOWN} more, because the directions are not isolated; --out saves all"
        )
    return lines
