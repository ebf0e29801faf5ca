"""What every benchmark needs: settings, interleaved timing, the machine's description, JSON."""

import importlib.metadata
import json
import os
import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path


def set_up_jax(cpu_settings: bool) -> None:
    """Chooses float64 and, if asked, the command line's CPU settings; to be called before the first array."""
    os.environ["JAX_ENABLE_X64"] = "1"
    os.environ["JAX_PLATFORMS"] = "cpu"
    os.environ.pop("XLA_FLAGS", None)
    if cpu_settings:
        from jaxball import cpu

        cpu.prepare()


def description(*packages: str) -> dict[str, object]:
    """The machine, the settings of XLA, and the versions of Python and of those ``packages`` there are."""
    return {
        "machine": machine(),
        "XLA_FLAGS": os.environ.get("XLA_FLAGS", ""),
        "versions": versions(*packages),
    }


def timed(call: Callable) -> tuple[float, object]:
    """Seconds that ``call`` took, and its result; ``call`` must wait for what it started."""
    start = time.perf_counter()
    result = call()
    return time.perf_counter() - start, result


def interleaved_medians(calls: dict[str, Callable], rounds: int = 30, block: int = 10) -> dict[str, float]:
    """The median time of each call in seconds.

    The contenders take turns, ``block`` calls at a time, so that a drift of the machine's speed meets
    them all alike. The first call of a block, which finds the caches cold, is not timed.
    """
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            call()
            times[name] += [timed(call)[0] for _ in range(block)]
    return {name: statistics.median(values) for name, values in times.items()}


def machine() -> dict[str, object]:
    """The processor, its cores, and the system."""
    return {"cpu": _cpu_model(), "cores": os.cpu_count(), "system": platform.platform()}


def versions(*packages: str) -> dict[str, str]:
    """The versions of Python and of those ``packages`` that are installed."""
    found = {"python": platform.python_version()}
    for package in packages:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def write_json(path: Path | str, content: dict) -> None:
    """Writes ``content`` as readable JSON."""
    Path(path).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _cpu_model() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
