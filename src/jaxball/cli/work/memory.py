"""How much memory the times of a run need, reported before it starts."""

import argparse
import math
import sys
from pathlib import Path

from ...interface.wording import counted
from ..options import BadInputError

# Bytes for each time, measured for balls and disks: of a run, and of its observables for files and figures.
OF_STATES, OF_OBSERVABLES = 800.0, 1_800.0
MANY = 1_000_000  # times, for which a user should be warned of the wait


def check_memory(options: argparse.Namespace, times: int) -> None:
    """Prints what so many times need if they are many.

    **Raises:** :class:`BadInputError` where that is more than is free.
    """
    observed = any(getattr(options, name) is not None for name in ("out", "plot", "view"))
    needed, free = times * (OF_STATES + OF_OBSERVABLES * observed), free_memory()
    if needed > free:
        raise BadInputError(
            f"Key `time` asks for {counted(times, 'time')}, which need about {_gigabytes(needed)} of memory, but "
            f"{_gigabytes(free)} are free; save fewer times."
        )
    if times > MANY and not options.quiet:
        told = f"jaxball: {counted(times, 'time')} take minutes and about {_gigabytes(needed)} of memory."
        print(told, file=sys.stderr, flush=True)


def free_memory() -> float:
    """The bytes that can be had without swapping; infinite where the system does not say."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
    except OSError:
        return math.inf
    return next((1024.0 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")), math.inf)


def _gigabytes(size: float) -> str:
    return f"{size / 1e9:.2g} GB"
