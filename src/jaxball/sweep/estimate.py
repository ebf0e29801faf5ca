"""What a study would cost."""

import math
import time
from typing import NamedTuple

import numpy as np

from .batch import Engine
from .chunk import compute
from .engine import solve_in_lanes
from .outputs import outputs_of
from .progress import duration
from .study import Study

TRIED = 512


class Estimate(NamedTuple):
    """Rows, chunks, the size of the store in bytes, and about how long one process takes, in seconds.

    **Arguments:**

    - ``rows``, ``chunks``, ``size``, ``seconds``: these numbers.
    """

    rows: int
    chunks: int
    size: int
    seconds: float

    def sentence(self, workers: int) -> str:
        """The estimate in words, for so many workers."""
        share = duration(self.seconds / min(workers, self.chunks))
        return (
            f"{_counted(self.rows, 'row')} in {_counted(self.chunks, 'chunk')}, a store of {_bytes(self.size)}, "
            f"about {share} with {_counted(workers, 'worker')} once they are compiled"
        )


def estimate(study: Study, engine: Engine = solve_in_lanes) -> Estimate:
    """The size of a study's store, and how long its rows take, from a few rows that are solved for it.

    **Arguments:**

    - ``study``: what is to be run.
    - ``engine``: what solves its rows.
    """
    template = study.template()
    outputs = outputs_of(study, template)
    size = sum(item.empty(study.chunk).nbytes for item in outputs.values()) * study.chunks
    count = min(TRIED, study.chunk)
    rows = np.unique(np.linspace(0, study.rows - 1, count).astype(int))
    compute(study, template, outputs, rows, engine)
    start = time.perf_counter()
    compute(study, template, outputs, rows, engine)
    seconds = time.perf_counter() - start
    return Estimate(study.rows, study.chunks, size, seconds * study.rows / len(rows))


def _bytes(size: int) -> str:
    units = ("B", "kB", "MB", "GB", "TB")
    power = min(int(math.log10(max(size, 1))) // 3, len(units) - 1)
    return f"{size / 1000**power:.3g} {units[power]}"


def _counted(n: int, noun: str) -> str:
    return f"{n:,} {noun}" if n == 1 else f"{n:,} {noun}s"
