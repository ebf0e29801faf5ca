"""Blocks of rows, computed on every core and every device."""

import concurrent.futures
import itertools
import os
from collections.abc import Callable
from typing import Any

import jax
import numpy as np


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_blocks(
    function: Callable[[Any], Any], take: Callable[[np.ndarray], Any], rows: int, block: int, threads: int
) -> list[Any]:
    """``function`` of each block of rows, in order; the last row fills what is left over of the last block.

    A compiled program gives the other threads of Python way while it runs. Blocks go to the devices in turn.
    """
    devices = jax.local_devices()
    places = [np.minimum(np.arange(start, start + block), rows - 1) for start in range(0, rows, block)]

    def one(job: tuple[np.ndarray, Any]) -> Any:
        place, device = job
        with jax.default_device(device):
            return jax.tree.map(np.asarray, function(take(place)))

    jobs = list(zip(places, itertools.cycle(devices)))  # noqa: B905
    if threads == 1 or len(jobs) == 1:
        found = [one(job) for job in jobs]
    else:
        # The first alone, so that the program is compiled once.
        with concurrent.futures.ThreadPoolExecutor(threads) as pool:
            found = [one(jobs[0]), *pool.map(one, jobs[1:])]
    return found
