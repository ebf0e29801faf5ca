"""Runs a study again and again in children that are killed at random moments, until one comes to its end.

python -m tests.sweep.kills FOLDER SEED prints the number of kills, and how many chunks were computed in all.
"""

import os
import random
import signal
import sys
import time
from pathlib import Path

import jax
import numpy as np

from jaxball.studies.sweep.rows import Batch, Request
from tests.sweep.studies import pretend, study

AXES = '[[axes]]\npath = "body.mass"\nlinear = { from = 1.0, to = 2.0, count = 60 }\n'
CHUNKS = 20
FEWEST = 3


def once(folder: Path) -> None:
    """The study from beginning to end; each chunk that is computed adds a byte to a file."""

    def counted(batch: Batch, request: Request) -> dict[str, np.ndarray]:
        with (folder / "computed").open("ab") as file:
            file.write(b".")
        return pretend(batch, request)

    study(folder, AXES, "chunk = 3").run(folder / "s.zarr", engine=counted)


def main() -> None:
    """Kills children while there are kills to come, then lets them end."""
    folder, moments, kills = Path(sys.argv[1]), random.Random(sys.argv[2]), 0
    while True:
        # A child begins before any backend of JAX does, so that it may be a fork, which starts at once.
        child = os.fork()
        if not child:
            jax.config.update("jax_enable_x64", True)
            once(folder)
            os._exit(0)
        begun = folder / "s.zarr"
        before = done(begun)
        while kills < FEWEST and done(begun) == before and os.waitpid(child, os.WNOHANG) == (0, 0):
            time.sleep(0.001)
        time.sleep(moments.uniform(0.0, 0.06))
        if kills < FEWEST:
            os.kill(child, signal.SIGKILL)
            kills += 1
        if os.waitpid(child, 0)[1] == 0:
            print(kills, (folder / "computed").stat().st_size)
            return


def done(store: Path) -> int:
    """How many chunks are done."""
    return len(list((store / ".done").glob("[0-9]*")))


if __name__ == "__main__":
    main()
