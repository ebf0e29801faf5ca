"""The gradient of where the paper's ball comes to with respect to ten parameters: jaxball beside heyoka and CasADi.

    python benchmarks/gradient.py [--mode forward] [--json FILE]

The error is that of the derivatives, the largest relative one, against thirty digits by heyoka in multiple precision.
With `--mode forward` the settings of XLA are those for forward mode, and a thousand balls are differentiated, too.
"""

import argparse
import importlib
from collections.abc import Callable
from pathlib import Path

import harness
import numpy as np

TOLERANCES = (1e-8, 1e-9, 1e-10, 1e-11, 1e-12)
GOAL = 1e-8
# What each mode is measured with.
OURS = {
    "forward": {"jaxball, forward mode": "forward"},
    "reverse": {"jaxball, reverse mode": "reverse"},
}
PLAIN = "jaxball, no derivatives"
STARTS = 1000
PEERS = {"heyoka, variational equations": "heyoka", "CasADi, CVODES": "casadi"}
PACKAGES = ("jaxball", "jax", "jaxlib", "diffrax", "equinox", "heyoka", "casadi")


def main() -> None:
    options = _options()
    harness.set_up_jax(cpu_settings=True)
    calls, build = _contenders(OURS[options.mode])
    exact = _exact()
    medians = harness.interleaved_medians(calls, rounds=options.rounds, block=3)
    rows = [
        {
            "solver": name,
            "tolerance": tolerance,
            "time": medians[name, tolerance],
            "error": _error(call(), exact),
            "build_time": build[name],
        }
        for (name, tolerance), call in calls.items()
    ]
    content = {
        "benchmark": "the derivatives of z1(20) of the paper's ball with respect to ten parameters",
        **harness.description(*PACKAGES),
        "exact": exact.tolist(),
        "rows": rows,
    }
    report(rows)
    if options.mode == "forward":
        content["starts"] = _starts(options.rounds)
    if options.json:
        harness.write_json(options.json, content)


def report(rows: list[dict]) -> None:
    """Prints a table, and how many plain solves a gradient takes."""
    for row in rows:
        print(
            f"{row['solver']:32}{row['tolerance']:>10.0e}{1e6 * row['time']:>10.0f} us"
            f"{row['error']:>10.1e}{row['build_time']:>8.1f} s"
        )
    time = {(row["solver"], row["tolerance"]): row["time"] for row in rows}
    for name in dict.fromkeys(name for name, _ in time if name.startswith("jaxball") and name != PLAIN):
        ratios = ", ".join(f"{time[name, one] / time[PLAIN, one]:.1f} at {one:.0e}" for one in TOLERANCES)
        print(f"{name}: {ratios} plain solves")
    reach = {
        name: min((row["time"] for row in rows if row["solver"] == name and row["error"] <= GOAL), default=None)
        for name in dict.fromkeys(row["solver"] for row in rows)
        if name != PLAIN
    }
    for name, seconds in reach.items():
        print(f"{name:32}" + (f"{1e6 * seconds:.0f} us for {GOAL:.0e}" if seconds else f"does not reach {GOAL:.0e}"))


def _starts(rounds: int) -> dict[str, float]:
    """Microseconds for each of many runs, and for each with its gradient, on one core."""
    import jaxball_gradient

    best = harness.interleaved_best(jaxball_gradient.starts(STARTS, 1e-10), rounds)
    found = {name: 1e6 * seconds / STARTS for name, seconds in best.items()}
    print(f"{STARTS} balls: {found['runs']:.0f} us a run, {found['gradients']:.0f} us a run with its gradient")
    return found


def _contenders(ours: dict[str, str]) -> tuple[dict[tuple[str, float], Callable], dict[str, float]]:
    import jaxball_gradient

    makers = {
        PLAIN: jaxball_gradient.plain,
        **{name: getattr(jaxball_gradient, function) for name, function in ours.items()},
    }
    for name, package in PEERS.items():
        try:
            importlib.import_module(package)
        except ModuleNotFoundError:
            print(f"Left out: {name}, because {harness.not_installed(package)}.")
            continue
        makers[name] = importlib.import_module(f"peers.{package}_gradient").solvers
    calls, build = {}, {}
    for name, make in makers.items():
        seconds, made = harness.timed(lambda make=make: make(TOLERANCES))
        first = next(iter(made.values()))
        build[name] = seconds / len(TOLERANCES) + harness.timed(first)[0] - harness.timed(first)[0]
        calls |= {(name, tolerance): call for tolerance, call in made.items()}
    return calls, build


def _exact() -> np.ndarray:
    from peers import heyoka_gradient

    return np.array([float(text) for text in heyoka_gradient.exact()])


def _error(found: np.ndarray, exact: np.ndarray) -> float:
    """The largest relative error of the derivatives, or of z1 where there are none."""
    known = exact[1:] if len(found) > 1 else exact[:1]
    return float(np.max(np.abs(found[-len(known) :] / known - 1)))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mode", choices=OURS, default="reverse", help="how derivatives are computed")
    parser.add_argument("--rounds", type=int, default=10, help="turns of every contender")
    parser.add_argument("--json", type=Path, help="where to write the measurements")
    return parser.parse_args()


if __name__ == "__main__":
    main()
