"""A draw shot at billiards: the error of the place at its end against its closed form, beside steps and time.

    python benchmarks/draw_shot.py [--json FILE] [--figure FILE] [--rows 100]

jaxball, Drake with CENIC and with a Runge-Kutta method, and GRADSOLVE control their errors, and are asked for several
accuracies; MuJoCo takes steps of several lengths. Times are processor time, the least of five calls after the first.
"""

import argparse
import dataclasses
import datetime
import functools
import importlib
import importlib.util
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import harness

OURS = "jaxball"
TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-9)
ACCURACIES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
ACCURACIES_OF_RUNGE_KUTTA = (1e-1, 1e-2)  # a tighter one takes more than a second
TIMESTEPS_OF_MUJOCO = (1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 1e-4)
CALLS = 5
SMALLEST = 1e-16  # error that the figure shows; its axis has no place for 0
PACKAGES = ("numpy", "mujoco", "drake", "gradsolve", "warp-lang")
ABOUT = "A draw shot: error of the place at its end, in radii; processor time in seconds of one shot."
COLUMNS = ("program, setting", "accuracy", "error", "steps", "time")


def main() -> None:
    options = _options()
    harness.set_up_jax(cpu_settings=True)
    rows = list(measure(options.rows))
    print(table(rows))
    settings = {"rows": options.rows, "calls": CALLS}
    date = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    content = {"about": ABOUT, "date": date, **harness.description(*PACKAGES), "settings": settings, "rows": rows}
    harness.write_json(options.json, content)
    if options.figure is not None:
        diagram(rows).savefig(options.figure, dpi=160)


def _options() -> argparse.Namespace:
    found = harness.parser(__doc__ or "", rows=100)
    found.add_argument("--figure", type=Path, help="where to draw the errors over the times")
    return found.parse_args()


def closed_form(scenario: Any, t: float) -> float:
    """The place at t in m of a shot with backspin.

    With the slip velocity u = v - r ω > 0 at the start, it slides until t = 2u/(7μg), and then rolls with v - 2/7 u.
    """
    ball, state = scenario.system, scenario.state
    v, u = float(state.V[0]), float(state.V[0] - ball.radius * state.body.Omega[1])
    deceleration = float(scenario.contact.friction * ball.gravity)
    slides = min(t, 2 * u / (7 * deceleration))
    return v * slides - deceleration * slides**2 / 2 + (v - 2 / 7 * u) * (t - slides)


def measure(rows: int) -> Iterator[dict[str, Any]]:
    """A row for each program, setting and accuracy; of a program that is not here, one that says what installs it."""
    scenario = _scenario()
    exact, radius = closed_form(scenario, float(scenario.times[-1])), float(scenario.system.radius)
    for program, packages, measured in CONTENDERS:
        absent = [package for package in packages if importlib.util.find_spec(package) is None]
        if absent:
            yield {"program": program, "failure": harness.not_installed(absent[0])}
            continue
        for setting, accuracy, solve in measured(scenario, rows):
            who = {"program": program, "setting": setting, "accuracy": accuracy}
            try:
                place, steps, seconds = _least(solve)
            except (ValueError, RuntimeError) as error:
                yield who | {"failure": str(error).splitlines()[0]}
                continue
            if not math.isfinite(place):
                yield who | {"failure": f"The place at the end is {place}."}
                continue
            yield who | {"error": abs(place - exact) / radius, "steps": steps, "seconds": seconds}


Solve = Callable[[], tuple[float, int, float]]  # the place at the end, how many steps, and seconds of one shot
Solves = Iterator[tuple[str, float, Solve]]


def _least(solve: Solve) -> tuple[float, int, float]:
    """The results of a solve, with the least time of some calls after one that compiles."""
    place, steps, _ = solve()
    return place, steps, min(solve()[2] for _ in range(CALLS))


@functools.cache
def _scenario() -> Any:
    import numpy as np

    from jaxball import load_scenario

    return dataclasses.replace(load_scenario("draw-shot"), times=np.array([0.0, 1.0]))


def own(scenario: Any, rows: int) -> Solves:
    """jaxball: one shot as it is typed, and ``rows`` of them, of which the steps are those of the first."""
    for tolerance in TOLERANCES:
        yield "one shot", tolerance, functools.partial(_one, scenario, tolerance)
    for tolerance in TOLERANCES:
        yield f"{rows} shots", tolerance, functools.partial(_many, scenario, rows, tolerance)


def _one(scenario: Any, tolerance: float) -> tuple[float, int, float]:
    begin = time.process_time()
    run = scenario.simulate(rtol=tolerance, atol=tolerance)
    place = float(run.state.z[-1, 0])
    return place, int(run.steps), time.process_time() - begin


def _many(scenario: Any, rows: int, tolerance: float) -> tuple[float, int, float]:
    import jax
    import numpy as np

    from jaxball.simulation.ensemble import simulate_ensemble

    states = jax.tree.map(lambda leaf: np.broadcast_to(leaf, (rows, *np.shape(leaf))), scenario.state)
    accurate = {"rtol": tolerance, "atol": tolerance, "contact": scenario.contact, "in_axes": (None, 0)}
    begin = time.process_time()
    run = simulate_ensemble(scenario.system, scenario.times, states, threads=1, **accurate).trajectory
    place = float(run.state.z[0, -1, 0])
    return place, int(run.steps[0]), (time.process_time() - begin) / rows


def drake(scenario: Any, rows: int) -> Solves:
    """Drake's plants whose integrators control their errors: settings of ``python -m benchmarks engines``."""
    from comparison.engines import DRAKE

    for setting in DRAKE.settings:
        if setting.values.get("continuous", False):
            cenic = setting.values.get("scheme") == "cenic"
            for accuracy in ACCURACIES if cenic else ACCURACIES_OF_RUNGE_KUTTA:
                yield setting.name, accuracy, functools.partial(_in_engine, "drake_", scenario, setting, accuracy)


def mujoco(scenario: Any, rows: int) -> Solves:
    """MuJoCo in its best setting on this page, which has no control of errors: the accuracy is the length of a step."""
    from comparison.engines import MUJOCO

    setting = next(setting for setting in MUJOCO.settings if setting.name == "RK4, stiff")
    for timestep in TIMESTEPS_OF_MUJOCO:
        solve = functools.partial(_in_engine, "mujoco_", scenario, setting, timestep)
        yield f"{setting.name}, fixed steps", timestep, solve


def _in_engine(module: str, scenario: Any, setting: Any, step: float) -> tuple[float, int, float]:
    from comparison.engines import Case

    case = Case("draw-shot", "a draw shot", "an end of slipping", lambda: scenario)
    motion = importlib.import_module(f"comparison.engines.{module}").run(case, setting, step)
    return float(motion.centre[-1, 0]), motion.steps, motion.seconds


def gradsolve(scenario: Any, rows: int) -> Solves:
    """GRADSOLVE, with friction that is smoothed over a speed of slip, because its solves have no events."""
    from peers.gradsolve_shot import SMOOTHED_OVER, shots

    for speed in SMOOTHED_OVER:
        for tolerance in TOLERANCES:
            setting = f"{rows} shots, smoothed over {speed:g} m/s"
            yield setting, tolerance, functools.partial(shots, scenario, rows, speed, tolerance)


CONTENDERS: tuple[tuple[str, tuple[str, ...], Callable[[Any, int], Solves]], ...] = (
    (OURS, (), own),
    ("Drake", ("pydrake",), drake),
    ("GRADSOLVE", ("gradsolve", "warp"), gradsolve),
    ("MuJoCo", ("mujoco",), mujoco),
)


def table(rows: list[dict[str, Any]]) -> str:
    """The rows as a table in Markdown."""
    from comparison.measure import power, seconds

    lines = ["| " + " | ".join(COLUMNS) + " |", "|:--|" + "--:|" * (len(COLUMNS) - 1)]
    for row in rows:
        name = f"{row['program']}, {row['setting']}" if "setting" in row else row["program"]
        accuracy = power(row["accuracy"]) if "accuracy" in row else "–"
        if "failure" in row:
            cells = [name, accuracy, row["failure"], "", ""]
        else:
            cells = [name, accuracy, power(row["error"], 2), str(row["steps"]), seconds(row["seconds"])]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def diagram(rows: list[dict[str, Any]]):
    """The errors over the times, a line for each setting of each program."""
    from comparison.engines.report import COLOURS, MARKERS
    from matplotlib.figure import Figure

    from jaxball.plot import palette, style

    figure = Figure(figsize=(7.2, 3.9), layout="constrained")
    ax = figure.subplots()
    measured = [row for row in rows if "error" in row]
    for program in dict.fromkeys(row["program"] for row in measured):
        settings = dict.fromkeys(row["setting"] for row in measured if row["program"] == program)
        for marker, setting in zip(MARKERS, settings, strict=False):
            curve = [row for row in measured if (row["program"], row["setting"]) == (program, setting)]
            times, errors = [row["seconds"] for row in curve], [max(row["error"], SMALLEST) for row in curve]
            look = {"color": COLOURS[program], "linewidth": 1.9 if program == OURS else 0.9, "marker": marker}
            ax.plot(times, errors, label=f"{program}, {setting}", markersize=3.5, **look)
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.grid(True, color=palette.FAINT, linewidth=0.4)
    style.label_axes(ax, "processor time of one shot [s]", "error of the place at the end [radii]")
    figure.legend(loc="outside right upper", frameon=False, prop=style.SMALL_FONT)
    return figure


if __name__ == "__main__":
    main()
