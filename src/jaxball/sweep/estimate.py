"""What a study would cost."""

import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..interface.arguments import require_flags
from .batch import Engine
from .chunk import compute
from .engine import solve_in_lanes
from .outputs import outputs_of
from .progress import duration
from .store import POINTS_TOGETHER
from .study import Study
from .whole import BYTES_OF_A_CHECKSUM

TRIED = 512


class Estimate(NamedTuple):
    """Rows, chunks, the size of the store and, if measured, how long one process takes.

    **Arguments:**

    - ``rows``, ``chunks``, ``size``: how many, and the bytes of the store.
    - ``compiling``, ``solving``: how long one process takes to compile, and then to solve all rows, seconds.
    """

    rows: int
    chunks: int
    size: int
    compiling: float | None = None
    solving: float | None = None

    def sentence(self, workers: int) -> str:
        """The estimate as text, for so many workers."""
        words = f"{_counted(self.rows, 'row')} in {_counted(self.chunks, 'chunk')}, a store of {_bytes(self.size)}"
        if self.compiling is None or self.solving is None:
            return words
        share = duration(self.solving / min(workers, self.chunks))
        return (
            f"{words}, about {share} with {_counted(workers, 'worker')} after compiling for {duration(self.compiling)}"
        )


def estimate(study: Study, engine: Engine = solve_in_lanes, *, measure: bool = False) -> Estimate:
    """The size of a study's store, at once.

    **Arguments:**

    - ``study``: the study to be run.
    - ``engine``: what solves its rows.
    - ``measure``: whether to solve a few rows, to estimate how long all of them take.

    **Raises:** :class:`StudyError` as :func:`sweep`.
    """
    require_flags(measure=measure)
    template = study.template()
    outputs = outputs_of(study, template)
    numbers = sum(item.empty(study.chunk).nbytes for item in outputs.values()) * study.chunks
    points = sum(8 * axis.size * len(axis.paths) for axis in study.axes)
    files = len(outputs) * study.chunks + sum(-(-axis.size // POINTS_TOGETHER) * len(axis.paths) for axis in study.axes)
    unmeasured = Estimate(study.rows, study.chunks, numbers + points + BYTES_OF_A_CHECKSUM * files)
    if not measure:
        return unmeasured
    tried = np.unique(np.linspace(0, study.rows - 1, min(TRIED, study.chunk)).astype(int))
    first, second = (_seconds(lambda: compute(study, template, outputs, tried, engine)) for _ in range(2))
    return unmeasured._replace(compiling=max(0.0, first - second), solving=second * study.rows / len(tried))


def _seconds(call: Callable[[], Any]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def _bytes(size: int) -> str:
    units = ("B", "kB", "MB", "GB", "TB")
    power = min(int(math.log10(max(size, 1))) // 3, len(units) - 1)
    return f"{size / 1000**power:.3g} {units[power]}"


def _counted(n: int, noun: str) -> str:
    return f"{n:,} {noun}" if n == 1 else f"{n:,} {noun}s"
