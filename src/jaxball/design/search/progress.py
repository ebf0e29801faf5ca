"""The progress of an optimisation, saved on disk so that it can be stopped at any time and resumed."""

import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ...interface.output import replacing
from ..problem.variables import DesignError


class Merit(NamedTuple):
    """The merit of a design: its objective, largest violation, and gradient of the Lagrangian.

    - ``objective``, ``violation``, ``gradient``: these three numbers.
    - ``place``: the index of the largest violation; −1 where there are no constraints.
    """

    objective: float = np.inf
    violation: float = np.inf
    gradient: float = np.inf
    place: float = -1.0

    def better_than(self, other: "Merit", tolerance: float) -> bool:
        """Feasible designs by their objective, and others by their violation."""
        if not np.isfinite(self.objective) or np.isnan(self.violation):
            return False
        mine, theirs = max(self.violation, tolerance), max(other.violation, tolerance)
        return (mine, self.objective) < (theirs, other.objective)


@dataclasses.dataclass
class Progress:
    """The state of an optimisation between two of its steps.

    - ``phase``: ``adam``, ``polish`` or ``done``; ``step`` counts within it.
    - ``y``: the unknowns of the designs that are optimised side by side.
    - ``arrays``: the other arrays of the phase: moments of Adam, or multipliers.
    - ``best``, ``merit``: the best design so far.
    - ``history``: for each report, the phase (0 or 1), the step, and the merit of the best of ``y`` then.
    - ``elapsed``: the time taken, in seconds, including interrupted runs of the search.
    """

    phase: str
    step: int
    y: Float[np.ndarray, "starts n"]
    arrays: list[np.ndarray]
    best: Float[np.ndarray, " n"]
    merit: Merit = dataclasses.field(default_factory=Merit)
    history: list[tuple[float, ...]] = dataclasses.field(default_factory=list)
    elapsed: float = 0.0

    def offer(self, y: Float[np.ndarray, "starts n"], merits: list[Merit], tolerance: float) -> Merit:
        """Keeps the best of the offered designs if it is better than the best so far."""
        leader = Merit()
        for unknowns, merit in zip(y, merits, strict=True):
            if merit.better_than(leader, tolerance):
                leader = merit
            if merit.better_than(self.merit, tolerance):
                self.best, self.merit = np.array(unknowns), merit
        return leader


def save_progress(progress: Progress, path: Path, identity: str) -> None:
    """Writes the progress of the problem ``identity``, atomically."""
    arrays: dict[str, Any] = {f"array_{k}": array for k, array in enumerate(progress.arrays)}
    with replacing(path) as beside, beside.open("wb") as file:
        np.savez(
            file,
            identity=identity,
            phase=progress.phase,
            step=progress.step,
            z=progress.y,
            best=progress.best,
            worth=np.asarray(progress.merit),
            elapsed=progress.elapsed,
            history=np.asarray(progress.history, dtype=float).reshape(-1, 6),
            **arrays,
        )


def load_progress(path: Path, identity: str) -> Progress:
    """The progress that was written.

    **Raises:** :class:`DesignError` where it belongs to another problem, or is not such a file.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            kept = dict(file)
    except (OSError, ValueError) as error:
        raise DesignError(f'File "{path}" must be the progress of a design, but it cannot be read ({error}).') from None
    if str(kept["identity"]) != identity:
        raise DesignError(f'File "{path}" is the progress of another problem; choose another folder, or remove it.')
    count = sum(name.startswith("array_") for name in kept)
    return Progress(
        phase=str(kept["phase"]),
        step=int(kept["step"]),
        y=kept["z"],
        arrays=[kept[f"array_{k}"] for k in range(count)],
        best=kept["best"],
        merit=Merit(*(float(x) for x in kept["worth"])),
        history=[tuple(float(x) for x in row) for row in kept["history"]],
        elapsed=float(kept.get("elapsed", 0.0)),
    )
