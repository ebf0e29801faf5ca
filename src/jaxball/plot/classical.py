"""The motion of a classical system over time, and how well its laws hold."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ..classical import AbstractClassicalSystem, RigidBodyState
from ..trajectory import Trajectory
from .evolution import over_time
from .record import finite_rows, require_one
from .style import COMPONENTS, INK, MASSES

_WORDS = {
    "x": "$x$",
    "y": "$y$",
    "z": "$z$",
    "xdot": r"$\dot{x}$",
    "ydot": r"$\dot{y}$",
    "multiplier": r"$\lambda$",
    "p_x": "$p_x$",
    "p_y": "$p_y$",
    "p_z": "$p_z$",
    "p_xz": "$p_{xz}$",
}
COLOURS = (*COMPONENTS, INK, *MASSES)


def classical_motion(trajectory: Trajectory[Any, Any], ax: Axes | None = None) -> Axes:
    """The body components Ω_i of a rigid body, or every number of another state.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a batch, for a ball or a disk, and for a three-dimensional ``ax``.
    """
    rows = _rows(trajectory)
    state = trajectory.state
    if isinstance(state, RigidBodyState):
        found = {rf"$\Omega_{j + 1}$": np.asarray(state.Omega)[rows, j] for j in range(3)}
        return _drawn(trajectory, rows, found, r"$\Omega_i$", ax)
    found = {
        _WORDS.get(name, name if leaf.ndim == 1 else f"{name} {k + 1}"): values[rows]
        for name, leaf in vars(state).items()
        for k, values in enumerate(np.asarray(leaf).reshape(len(trajectory.times), -1).T)
    }
    return _drawn(trajectory, rows, found, "state", ax)


def law_errors(trajectory: Trajectory[Any, Any], ax: Axes | None = None) -> Axes:
    """How far each of the laws is from its value at the start, where that is not 0; of a vector, the farthest entry.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a batch, for a ball or a disk, and for a three-dimensional ``ax``.
    """
    rows = _rows(trajectory)
    found = {}
    for name, leaf in trajectory.laws._asdict().items():
        values = np.asarray(leaf)[rows].reshape(len(rows), -1)
        changes = np.max(np.abs(values - values[:1]), axis=1)
        found[_WORDS.get(name, name.replace("_", " "))] = np.where(changes > 0, changes, np.nan)
    ax = _drawn(trajectory, rows, found, "change since the start", ax)
    if any(np.any(np.isfinite(values)) for values in found.values()):
        ax.set_yscale("log")
    return ax


def _rows(trajectory: Trajectory[Any, Any]) -> np.ndarray:
    require_one(trajectory)
    if not isinstance(trajectory.system, AbstractClassicalSystem):
        raise ValueError(
            "Argument `trajectory` must be of a classical system, but it is of a "
            f"{type(trajectory.system).__name__}; the other functions of jaxball.plot draw it."
        )
    return finite_rows(trajectory)


def _drawn(trajectory: Trajectory[Any, Any], rows: np.ndarray, found: dict[str, np.ndarray], name: str, ax) -> Axes:
    series = [(values, label, COLOURS[k % len(COLOURS)]) for k, (label, values) in enumerate(found.items())]
    return over_time(np.asarray(trajectory.times)[rows], series, name, ax, most=3)
