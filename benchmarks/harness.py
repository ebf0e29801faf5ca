"""What every benchmark needs: settings, interleaved timing, the machine's description, JSON."""

import argparse
import json
import os
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

# The others are of one extra.
INSTALLED_BY = {
    "numbalsoda": "jaxball[numbalsoda]",
    "gradsolve": "gradsolve[warp]",
    "warp": "gradsolve[warp]",
    "pydrake": "jaxball[engines]",
    "mujoco": "jaxball[engines]",
}


def set_up_jax(cpu_settings: bool, gpu: bool = False) -> None:
    """Chooses float64 and, if asked, the command line's CPU settings; to be called before the first array.

    JAX uses the CPU; with ``gpu``, what it finds or the user has chosen, and takes memory as it needs it.
    """
    os.environ["JAX_ENABLE_X64"] = "1"
    os.environ.pop("XLA_FLAGS", None)
    if gpu:
        os.environ["XLA_PYTHON_CLIENT_PREALLOCATE"] = "false"
    else:
        os.environ["JAX_PLATFORMS"] = "cpu"
    if cpu_settings:
        from jaxball.programs import cpu

        cpu.prepare()


COUNTS = {"rows": "how many runs", "rounds": "turns of every contender; the best or the median counts"}


def parser(about: str, **counts: int) -> argparse.ArgumentParser:
    """The arguments of a script that is ``about`` this: ``--json``, and counts with their defaults."""
    found = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in counts.items():
        found.add_argument(f"--{name}", type=int, default=default, help=COUNTS[name])
    found.add_argument("--json", type=Path, help="where to write the measurements")
    return found


def description(*packages: str) -> dict[str, object]:
    """The machine, the settings of XLA, and the versions of Python, jaxball and those ``packages`` there are."""
    # Imported here, because it imports JAX, which is to be set up before.
    from comparison.measure import machine, versions

    return {
        "machine": machine(),
        "XLA_FLAGS": os.environ.get("XLA_FLAGS", ""),
        "versions": versions(("jaxball", "jax", "jaxlib", "diffrax", "equinox", *packages)),
    }


def not_installed(package: str) -> str:
    """The end of a sentence: which package is missing, and what installs it."""
    return f"{package} is not installed; pip install '{INSTALLED_BY.get(package, 'jaxball[bench]')}'"


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def timed(call: Callable[[], Any]) -> tuple[float, Any]:
    """Seconds that ``call`` took, and its result; ``call`` must wait for what it started."""
    start = time.perf_counter()
    result = call()
    return time.perf_counter() - start, result


def interleaved_medians(calls: dict[Any, Callable], rounds: int = 30, block: int = 10) -> dict[Any, float]:
    """The median time of each call in seconds.

    The contenders take turns, ``block`` calls at a time, so that a drift of the machine's speed meets
    them all alike. The first call of a block, which finds the caches cold, is not timed.
    """
    times: dict[Any, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            call()
            times[name] += [timed(call)[0] for _ in range(block)]
    return {name: statistics.median(values) for name, values in times.items()}


def interleaved_best(calls: dict[Any, Callable], rounds: int) -> dict[Any, float]:
    """The shortest time of each call in seconds; the contenders take turns."""
    best = {name: timed(call)[0] for name, call in calls.items()}
    for _ in range(rounds):
        for name, call in calls.items():
            best[name] = min(best[name], timed(call)[0])
    return best


def write_json(path: Path | None, content: dict) -> None:
    """Writes ``content`` as readable JSON, if there is a path."""
    if path is not None:
        path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
