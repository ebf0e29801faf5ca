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
    function: Callable[[Any], Any], take: Callable[[np.ndarray], Any], rows: int, block: int, threads: int, warm: bool
) -> list[Any]:
    """``function`` of each block of rows, in order; the last row fills what is left over of the last block.

    A compiled program gives the other threads of Python way while it runs. Blocks go to the devices in turn, the first
    of them alone where the function is not ``warm``, so that it is compiled once.
    """
    devices = jax.local_devices()
    places = [np.minimum(np.arange(start, start + block), rows - 1) for start in range(0, rows, block)]

    def one(job: tuple[np.ndarray, Any]) -> Any:
        place, device = job
        with jax.default_device(device):
            return jax.tree.map(np.asarray, function(take(place)))

    jobs = list(zip(places, itertools.cycle(devices)))
    alone = len(jobs) if threads == 1 else 0 if warm else 1
    found = [one(job) for job in jobs[:alone]]
    if jobs[alone:]:
        with concurrent.futures.ThreadPoolExecutor(threads) as pool:
            found += pool.map(one, jobs[alone:])
    return found


def balanced(rows: int, largest: int, threads: int) -> int:
    """The size of blocks of which every thread gets as many, none larger than ``largest``."""
    blocks = threads * -(-rows // (largest * threads))
    return -(-rows // blocks)
