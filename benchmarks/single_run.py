"""One run of the paper's ball: jaxball beside numbalsoda and heyoka, achieved error beside each time.

    python benchmarks/single_run.py [--json FILE]

Everything is measured in one process, the contenders in turns; then jaxball and numbalsoda once more in
another process without the command line's CPU settings.
"""

import argparse
import json
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import harness
import numpy as np

NUMBALSODA, HEYOKA = "numbalsoda DOP853", "heyoka Taylor"  # contenders of ``python -m benchmarks``
GOAL = 1e-9
TYPED, COMPILED, BY_XLA = "jaxball, simulate(ball, times)", "jaxball, jaxball.jit", "jaxball, jax.jit"
OURS = (TYPED, COMPILED, BY_XLA)
DEFAULT_TOLERANCE = 1e-10


def main() -> None:
    options = _options()
    harness.set_up_jax(options.cpu_settings)
    rows = measure([NUMBALSODA, HEYOKA] if options.cpu_settings else [NUMBALSODA])
    content = {
        "benchmark": "the paper's ball from t = 0 to 20, kinks stepped to; error of q, Omega, z at t = 20",
        **harness.description("numba", "numbalsoda", "heyoka"),
        "rows": rows,
        "ratios": ratios(rows),
    }
    if options.child:
        print(json.dumps(content))
        return
    report("With the command line's CPU settings", content)
    content["without_cpu_settings"] = _without_settings()
    report("Without them", content["without_cpu_settings"])
    harness.write_json(options.json, content)


def measure(peers: list[str]) -> list[dict]:
    """One row for each contender and tolerance: time and build time in seconds, error at t = 20."""
    import jax
    import jaxball_ball

    from jaxball.paper import reference

    exact = reference.ball().values[-1, -9:]  # q, Omega, z
    contenders: dict[tuple[str, float], Callable] = {(TYPED, DEFAULT_TOLERANCE): jaxball_ball.typed()}
    contenders |= {(COMPILED, tolerance): call for tolerance, call in jaxball_ball.compiled().items()}
    contenders |= {(BY_XLA, tolerance): call for tolerance, call in jaxball_ball.compiled(jax.jit).items()}
    build = {name: jaxball_ball.compile_time(contenders[name, DEFAULT_TOLERANCE]) for name in OURS}
    states = dict(contenders)
    for name in peers:
        build[name], runs = _peer(name)
        contenders |= {(name, tolerance): run.solve for tolerance, run in runs.items()}
        states |= {(name, tolerance): lambda run=run: run.outcome().state for tolerance, run in runs.items()}
    medians = harness.interleaved_medians(contenders)
    return [
        {
            "solver": name,
            "tolerance": tolerance,
            "time": medians[name, tolerance],
            "error": _error(state(), exact),
            "build_time": build[name],
        }
        for (name, tolerance), state in states.items()
    ]


def ratios(rows: list[dict]) -> dict[str, float]:
    """jaxball's time at its default tolerance over that of every peer.

    ``at most 1e-9``: over the peer's cheapest setting whose error is at most that. ``equal error``:
    over the peer's time at jaxball's own error, on the straight line between its settings in the
    logarithms of error and time.
    """
    found = {}
    for ours in (row for row in rows if row["solver"] in OURS and row["tolerance"] == DEFAULT_TOLERANCE):
        for name in dict.fromkeys(row["solver"] for row in rows if row["solver"] not in OURS):
            theirs = [row for row in rows if row["solver"] == name]
            cheapest = min(row["time"] for row in theirs if row["error"] <= GOAL)
            found[f"{ours['solver']} / {name}, at most {GOAL:.0e}"] = ours["time"] / cheapest
            found[f"{ours['solver']} / {name}, equal error"] = ours["time"] / _time_at(ours["error"], theirs)
    return found


def report(title: str, content: dict) -> None:
    """Prints a table of the rows and the ratios."""
    print(f"\n{title}: {content['machine']['cpu']}, {content['machine']['cores']} cores\n")
    print(f"{'Solver':32}{'Tolerance':>10}{'Time':>12}{'Error':>10}{'Build':>9}")
    for row in content["rows"]:
        print(
            f"{row['solver']:32}{row['tolerance']:>10.0e}{1e6 * row['time']:>9.0f} us"
            f"{row['error']:>10.1e}{row['build_time']:>7.1f} s"
        )
    for name, ratio in content["ratios"].items():
        print(f"{name:70}{ratio:6.2f}")


def _peer(name: str) -> tuple[float, dict]:
    """The time in which a peer builds one program, and its runs by their tolerances; none where it is not installed."""
    from comparison.contenders import ALL
    from comparison.problems import BALL
    from jaxball_ball import TOLERANCES

    contender = ALL[name]
    missing = contender.family.missing()
    if missing is not None:
        print(f"Left out: {name}, because {missing}; {contender.family.remedy}.")
        return 0.0, {}
    program = contender.program(BALL)
    seconds, runs = harness.timed(lambda: {tolerance: program.run(tolerance) for tolerance in TOLERANCES})
    return program.build_time + seconds / len(TOLERANCES), runs


def _error(final, exact) -> float:
    return float(max(abs(final[-9:] - exact)))


def _time_at(error: float, rows: list[dict]) -> float:
    rows = sorted(rows, key=lambda row: row["error"])
    logarithms = [[math.log(row[key]) for row in rows] for key in ("error", "time")]
    return math.exp(np.interp(math.log(error), *logarithms))


def _without_settings() -> dict:
    command = [sys.executable, str(Path(__file__)), "--child", "--no-cpu-settings"]
    finished = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(finished.stdout.splitlines()[-1])


def _options() -> argparse.Namespace:
    parser = harness.parser(__doc__ or "")
    parser.add_argument("--no-cpu-settings", dest="cpu_settings", action="store_false", help=argparse.SUPPRESS)
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    return parser.parse_args()


if __name__ == "__main__":
    main()
