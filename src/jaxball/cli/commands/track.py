"""``jaxball track``: holds the motion of a scenario by feedback, from disturbed starts."""

import argparse
import dataclasses
import functools
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ...files.results.files import READ_BACK
from ...files.scenario.errors import ScenarioError
from ...interface.status import BACK_WITHIN
from ...interface.wording import heading
from ..input import add_scenario, scenario_document, scenario_of
from ..jax_setup import compile_for, set_up_jax
from ..options import (
    CHART_AXIS,
    FAILED_SOLVE,
    BadInputError,
    ChartAxis,
    add_formats,
    add_output,
    add_replacing,
    chart_axes,
    check_figures_folder,
    check_file,
    check_json,
    name_files,
    positive,
    say,
    working,
)

if TYPE_CHECKING:
    import numpy as np

    from ...control.basins import Basin
    from ...control.feedback import AbstractFeedback
    from ...control.loop import ClosedLoop
    from ...control.track import Track
    from ...files.scenario.feedback import RegulatorSettings
    from ...files.scenario.scenario import Scenario

ON_RATES = 0.1  # of the default disturbance, rad/time
WITHOUT, HELD, SEEING = "without feedback", "with feedback", "from sensors"
BASINS = {HELD: "basin", SEEING: "basin_from_sensors"}  # the names of figures, and in the summary
NAMED = "NUMBER|NAME=NUMBER,..."


class Held(NamedTuple):
    """A disturbed start: its words, and its closed loops without and with feedback."""

    start: str
    loops: "dict[str, ClosedLoop]"


def add(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Finds the linear quadratic regulator along the motion of a scenario, or what its table [feedback] describes, "
        "and simulates disturbed starts without and with feedback, and with an estimator if the scenario has one. The "
        "save times are the samples. The largest |f| / N is that at the samples."
    )
    add_scenario(parser)
    parser.add_argument(
        "--Q", type=_parse_start, metavar=NAMED, help="weights of deviations, as in z=9,theta=1 (default: 1)"
    )
    parser.add_argument("--R", type=_parse_start, metavar=NAMED, help="weights of inputs (default: 1)")
    parser.add_argument("--sample", type=positive, metavar="T", help="the time between samples, instead of save times")
    parser.add_argument("--delay", type=_not_negative, metavar="N", help="samples before feedback takes effect")
    parser.add_argument(
        "--limits", type=_parse_start, metavar=NAMED, help="largest magnitudes of inputs, instead of motors'"
    )
    parser.add_argument(
        "--disturb",
        type=_deviation,
        action="append",
        metavar="NAME=NUMBER,...",
        help="deviation of a start in local coordinates, as in 'z=0.1,Omega[0]=0.3'; can be given several times",
    )
    parser.add_argument(
        "--basin",
        nargs=2,
        metavar=CHART_AXIS,
        help="also find which starts of a grid come back, as in 'Omega[0]=-1:1:21' 'Omega[1]=-1:1:21'; with an "
        "estimator also which do from sensors",
    )
    parser.add_argument(
        "--within", type=positive, metavar="D", help=f"how close a start must come back (default: {BACK_WITHIN})"
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="save the run of the first start: .nc or .npz")
    parser.add_argument("--plot", type=Path, metavar="FOLDER", help="draw paths, inputs, gains and so on")
    add_formats(parser, "--plot-format")
    add_replacing(parser)
    add_output(parser)


def run(options: argparse.Namespace) -> int:
    check_json(options)
    check_file(options, "out", READ_BACK)
    check_figures_folder(options, "plot", "plot_format")
    if options.basin is None and options.within is not None:
        raise BadInputError("Argument `--within` is for a grid of starts; give --basin with it.")
    axes = None if options.basin is None else chart_axes(options, "basin", "Omega[0]=-1:1:21")
    document = _with_feedback(options, scenario_document(options))
    set_up_jax()
    _require_body(document)
    try:
        scenario = scenario_of(document, options.scenario)
    except ScenarioError as error:
        if options.sample is None:
            raise
        raise ScenarioError(str(error).replace("Key `time.step`", "Argument `--sample`")) from None
    with compile_for(scenario):
        return _track(options, scenario, axes)


def _with_feedback(options: argparse.Namespace, document: dict[str, Any]) -> dict[str, Any]:
    """Returns the document with the table [feedback] that the options ask for."""
    table = document.get("feedback", {"kind": "tvlqr", "Q": 1.0, "R": 1.0})
    if not isinstance(table, dict):
        return document  # which its reader refuses
    if table.get("kind") == "feedforward":
        raise ScenarioError(
            'Key `feedback.kind` must be "tvlqr" or "mpc" to hold a motion, but it is "feedforward"; change it with '
            "--set feedback.kind=tvlqr, --Q and --R."
        )
    changes = {name: getattr(options, name) for name in ("Q", "R", "delay", "limits")}
    feedback = table | {name: value for name, value in changes.items() if value is not None}
    times = document.get("time")
    if options.sample is not None and isinstance(times, dict):
        instants = times.get("at")
        # Times that are listed one by one have ends, too.
        ends = {"start": instants[0], "end": instants[-1]} if isinstance(instants, list) and instants else times
        times = {name: ends[name] for name in ("start", "end") if name in ends} | {"step": options.sample}
    return document | {"feedback": feedback} | ({} if times is None else {"time": times})


def _require_body(document: dict[str, Any]) -> None:
    """Raises a :class:`~jaxball.ScenarioError` for a classical system, which has no inputs to hold its motion by."""
    from ...files.scenario.classical import CLASSICAL

    if (kind := document.get("kind")) in tuple(CLASSICAL):
        raise ScenarioError(f'Key `kind` must be "ball" or "disk" for a motion to be held, but it is "{kind}".')


def _track(options: argparse.Namespace, scenario: "Scenario", axes: tuple[ChartAxis, ChartAxis] | None) -> int:
    from ...files.scenario.checks import message_in_keys
    from ...files.scenario.closed_loop import feedback_along, nominal_run
    from ..files import find_places, write_json

    disturbed = _disturb(options, scenario)
    with working(options, "simulating the motion"):
        motion = nominal_run(scenario)
    if not motion.ok:
        print(f"jaxball: The motion that is to be held fails. {message_in_keys(motion)}", file=sys.stderr)
        return FAILED_SOLVE
    with working(options, "linearising along the motion"):
        feedback = feedback_along(scenario, motion)
    held = [_simulate_loops(options, entry, feedback) for entry in disturbed]
    basins = {} if axes is None else _basins(options, scenario, feedback, axes)
    find_places(options)
    written = []
    if options.out is not None:
        with working(options, "evaluating and saving"):
            from ...files.results.saving import save

            save(_last(held[0]).run.set_scenario(disturbed[0]), options.out, disturbed[0])
        written.append(str(options.out))
    if options.plot is not None:
        with working(options, "drawing"):
            written.append(_draw(options, scenario, feedback, held, basins))
    weights = _weights(scenario, feedback)
    write_json(options, _content(scenario, weights, held, basins))
    lines = [_track_of(feedback), *_table(weights, held), *(_basin_line(*entry) for entry in basins.items())]
    say(options, heading(scenario.title), *lines, name_files(written))
    return 0 if all(loop.ok for entry in held for loop in entry.loops.values()) else FAILED_SOLVE


def _disturb(options: argparse.Namespace, scenario: "Scenario") -> "list[Scenario]":
    """Returns the scenario from each disturbed start: those of --disturb, its own, or else another angular velocity."""
    from ...control.sampled import SampledSystem
    from ...control.weights import by_name
    from ...files.scenario.closed_loop import robot_of, settings_of

    settings = settings_of(scenario)
    starts = options.disturb or [settings.start]
    for start in starts:  # known before anything is simulated
        try:
            by_name("disturb", start, SampledSystem.of(robot_of(scenario), 1.0, settings.inputs).directions)
        except ValueError as error:
            raise BadInputError(str(error)) from None
    # Where nothing disturbs it, feedback would have nothing to do.
    if starts == [{}] and not settings.pushes:
        starts = [{robot_of(scenario).state_type.rotation_rate: ON_RATES}]
    return [dataclasses.replace(scenario, feedback=dataclasses.replace(settings, start=start)) for start in starts]


def _simulate_loops(options: argparse.Namespace, scenario: "Scenario", feedback: "AbstractFeedback") -> Held:
    from ...files.scenario.closed_loop import loop_along, settings_of, with_estimator

    settings = settings_of(scenario)
    # Without feedback, in the same loop: its samples, limits and delay.
    kinds = {WITHOUT: feedback.feedforward(), HELD: feedback}
    if scenario.estimator is not None:
        kinds[SEEING] = with_estimator(scenario, feedback)
    loops = {}
    for name, kind in kinds.items():
        with working(options, f"simulating {name}"):
            loops[name] = loop_along(scenario, kind)
    start = ", ".join(f"{name} = {value:g}" for name, value in settings.start.items())
    pushed = f"{len(settings.pushes)} pushes" if len(settings.pushes) > 1 else "a push" if settings.pushes else ""
    return Held(" and ".join(filter(None, [start, pushed])), loops)


def _basins(
    options: argparse.Namespace, scenario: "Scenario", feedback: "AbstractFeedback", axes: tuple[ChartAxis, ChartAxis]
) -> "dict[str, Basin]":
    """Finds which starts of the grid come back, by feedback of the state and, with an estimator, from sensors."""
    import numpy as np

    from ...files.scenario.closed_loop import robot_of, with_estimator
    from ...files.scenario.feedback import in_keys

    settings = _regulator(scenario)
    starts = {name: np.linspace(low, high, count) for name, low, high, count in axes}
    kinds = {HELD: feedback}
    if scenario.estimator is not None:
        kinds[SEEING] = with_estimator(scenario, feedback)
    basins = {}
    for name, kind in kinds.items():
        with working(options, f"simulating {axes[0][3] * axes[1][3]:,} starts {name}"), in_keys():
            basins[name] = kind.basin(
                starts,
                Q=settings.Q,
                within=options.within or BACK_WITHIN,
                system=robot_of(scenario),
                limits=settings.limits,
                delay=settings.delay,
                contact=scenario.contact,
            )
    return basins


def _regulator(scenario: "Scenario") -> "RegulatorSettings":
    from ...files.scenario.feedback import RegulatorSettings

    assert isinstance(scenario.feedback, RegulatorSettings)
    return scenario.feedback


def _track_of(feedback: "AbstractFeedback") -> "Track":
    """Returns the regulator, also of predictive control."""
    from ...control.prediction import PredictiveControl
    from ...control.track import Track

    track = feedback.track if isinstance(feedback, PredictiveControl) else feedback
    assert isinstance(track, Track)
    return track


def _last(held: Held) -> "ClosedLoop":
    return held.loops.get(SEEING, held.loops[HELD])


def _weights(scenario: "Scenario", feedback: "AbstractFeedback") -> "np.ndarray":
    """Returns the matrix of the measure of deviations, √(ξ·Q ξ / tr Q)."""
    import numpy as np

    from ...control.weights import weight_matrix

    Q = np.asarray(weight_matrix("Q", _regulator(scenario).Q, _track_of(feedback).directions))
    return Q / np.trace(Q)


def _numbers(weights: "np.ndarray", loop: "ClosedLoop") -> dict[str, float]:
    import numpy as np

    xi, u, seen = np.asarray(loop.xi), np.abs(np.asarray(loop.u)), loop.run.observables
    along = np.sqrt(np.einsum("ki,ij,kj->k", xi, weights, xi))
    return {
        "start": float(along[0]),
        "largest": float(np.max(along)),
        "end": float(along[-1]),
        "largest_input": float(np.max(u)),
        "friction": float(np.max(np.asarray(seen.friction_ratio))),
    }


def _table(weights: "np.ndarray", held: list[Held]) -> list[str]:
    width = len(WITHOUT) + 10
    columns = ("at first", "largest", "at last", "input", "|f| / N")
    lines = [f"{'deviation, weighted by Q':<{width}}" + "".join(f"{name:>10}" for name in columns)]
    for entry in held:
        lines.append(f"from {entry.start}" if entry.start else "from the motion")
        for name, loop in entry.loops.items():
            numbers = _numbers(weights, loop)
            lifts = "  (N ≤ 0: it would leave the ground)" if numbers["friction"] == float("inf") else ""
            lines.append(f"  {name:<{width - 2}}" + "".join(f"{value:>10.4g}" for value in numbers.values()) + lifts)
    return lines


def _basin_line(name: str, basin: "Basin") -> str:
    assert basin.grid is not None
    summary, over = str(basin).removeprefix("Basin: "), " and ".join(basin.grid.names)
    return f"{name}, {summary}, to within {basin.within:g}, over {over}"


def _content(
    scenario: "Scenario", weights: "np.ndarray", held: list[Held], basins: "dict[str, Basin]"
) -> dict[str, Any]:
    """Returns the summary as JSON."""
    content: dict[str, Any] = {"title": scenario.title, "starts": []}
    for entry in held:
        loops = {name: _numbers(weights, loop) | {"ok": loop.ok} for name, loop in entry.loops.items()}
        content["starts"].append({"start": entry.start, "loops": loops})
    for kind, basin in basins.items():
        data = basin.dataset()
        axes = {str(name): data[name].values for name in data["returned"].dims}
        content[BASINS[kind]] = {
            "share": basin.share,
            "within": basin.within,
            **axes,
            "returned": data["returned"].values,
        }
    return content


def _draw(
    options: argparse.Namespace,
    scenario: "Scenario",
    feedback: "AbstractFeedback",
    held: list[Held],
    basins: "dict[str, Basin]",
) -> str:
    """Draws what there is to see, and returns how many figures and where."""
    from ... import plot
    from ...interface.wording import number_of
    from ...plot.files import run_mark, save_figures
    from ...plot.style import captioned, in_words
    from ..files import figure_name, suffixes

    first, last = held[0].loops, _last(held[0])
    drawings: dict[str, Callable[[], Any]] = {
        "paths": lambda: plot.held_paths(first),
    }
    with_feedback = {name: loop for name, loop in first.items() if name != WITHOUT}
    inputs = last.plant.inputs
    for k, name in enumerate(inputs):
        number = f"_{k + 1}" if len(inputs) > 1 else ""
        drawings[f"inputs{number}"] = functools.partial(plot.held_inputs, with_feedback, name)
        drawings[f"gains{number}"] = functools.partial(_track_of(feedback).plot, name)
    for kind, basin in basins.items():
        drawings[BASINS[kind]] = basin.plot
    estimate = last.feedback.estimates(last.times, last.memory)
    if estimate is not None:
        drawings["estimate"] = lambda: estimate.plot(last.states)
    begin = figure_name(options.scenario, scenario)

    about = scenario.system, scenario.title, in_words(scenario.units)
    named = [(f"{begin}_{name}", captioned(draw, *about)) for name, draw in drawings.items()]
    paths = save_figures(
        named,
        options.plot,
        run_mark(last.run.set_scenario(scenario)),
        suffixes(options.plot_format),
        svg_text=options.svg_text,
        replace=options.force,
    )
    return f"{number_of(len(paths), 'figure')} in {options.plot}"


def _parse_start(text: str) -> float | dict[str, float]:
    """Parses a number, or numbers by name."""
    try:
        return float(text)
    except ValueError:
        return _deviation(text)


def _deviation(text: str) -> dict[str, float]:
    """Parses numbers by name."""
    deviation = {}
    for part in text.split(","):
        name, equals, value = part.rpartition("=")
        if name.strip() in deviation:
            raise argparse.ArgumentTypeError(f"it must have each name once, but {name.strip()} is in it twice")
        try:
            deviation[name.strip()] = float(value)
        except ValueError:
            equals = ""
        if not equals:
            raise argparse.ArgumentTypeError(f"it must be NAME=NUMBER,..., as in z=0.1,Omega[0]=0.3, but it is {text}")
    return deviation


def _not_negative(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"it must be a whole number of samples, 0 or more, but it is {text}")
    return int(text)
