"""Small studies, and an engine that solves nothing, for what is not about motion."""

from pathlib import Path

import numpy as np

from jaxball.studies.sweep import read_study
from jaxball.studies.sweep.rows import Batch, Request
from jaxball.studies.sweep.study import Study
from tests.scenario.documents import DISK

MASSES = """
[[axes]]
path = "body.mass"
linear = { from = 0.5, to = 2.0, count = 5 }
"""
GRAVITIES = """
[[axes]]
path = "body.gravity"
values = [0.5, 1.0, 2.0]
"""


class Clock:
    """A clock that stands still unless it is set."""

    now = 0.0

    def __call__(self):
        return self.now


def study(folder: Path, axes: str = MASSES + GRAVITIES, settings: str = "", scenario: str = DISK) -> Study:
    """A study of the small disk."""
    return read_study(study_text(folder, axes, settings, scenario), folder)


def study_text(folder: Path, axes: str = MASSES + GRAVITIES, settings: str = "", scenario: str = DISK) -> str:
    """The text of a study, whose scenario is written into ``folder``."""
    (folder / "disk.toml").write_text(scenario)
    return f'format = 1\nscenario = "disk.toml"\n{settings}\n{axes}'


def pretend(batch: Batch, request: Request) -> dict[str, np.ndarray]:
    """An engine: each disk is at φ = m g at all times, after as many steps as there are save times."""
    n, times = batch.times.shape
    phi = batch.system.mass * batch.system.gravity
    counts = np.full(n, times)
    at_times = np.tile(phi[:, None], (1, times))
    return {
        "status": np.zeros(n, dtype=int),
        "steps": counts,
        "rejected": 0 * counts,
        "reached": batch.times[:, -1],
        "phi": at_times,
        "phidot": 0 * at_times,
        "z": -at_times,
    }


def files(store: Path) -> dict[str, bytes]:
    """The content of every file of a store and of its table."""
    found = {str(path.relative_to(store)): path.read_bytes() for path in store.rglob("*") if path.is_file()}
    return found | {"table": store.with_suffix(".parquet").read_bytes()}
