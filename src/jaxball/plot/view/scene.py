"""The scene of a view: bodies of one kind, the camera, and the graphs beside them."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ...simulation.trajectory import Trajectory
from .packing import Numbers

Discs = Sequence[tuple[Float[np.ndarray, "2"], float]]  # of the plane, each with centre and radius
SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")


class Scene(NamedTuple):
    """Bodies of one kind, in parts of the dictionary of a view."""

    stand: dict[str, Any]  # ``axes``, ``floor``, ``obstacles`` and ``camera``
    made: list[dict[str, Any]]  # of what each body is made
    numbers: list[dict[str, Numbers]]  # those of each body
    plots: list[dict[str, Any]]
    wanted: Numbers | None = None


def free_stand(azimuth: float) -> dict[str, Any]:
    """The stand of bodies without a plane, seen from a direction in degrees."""
    return {
        "axes": np.eye(3).tolist(),
        "floor": None,
        "obstacles": [],
        "camera": {"elevation": 20.0, "azimuth": azimuth},
    }


def made(kind: str, trajectory: Trajectory[Any, Any], radius: float, saved: int) -> dict[str, Any]:
    """The entries that every body has, empty; a rolling body has more."""
    parts: dict[str, Any] = {"body": kind, "radius": radius, "ok": trajectory.ok, "message": trajectory.message}
    return parts | {"saved": saved, "masses": [], "rails": [], "arms": []}


def continuous(quaternions: Float[np.ndarray, "T 4"]) -> Float[np.ndarray, "T 4"]:
    """The same quaternions, with signs that make each close to the one before."""
    flips = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0
    return quaternions * np.where(np.cumsum(np.concatenate([[0], flips])) % 2, -1.0, 1.0)[:, None]


def law_changes(trajectory: Trajectory[Any, Any], rows: np.ndarray) -> tuple[list[str], Float[np.ndarray, "T laws"]]:
    """The names of the system's laws and their changes since the start; of a vector, the length of its change."""
    laws = trajectory.laws._asdict()
    changes = []
    for leaf in laws.values():
        values = np.asarray(leaf)[rows].reshape(len(rows), -1)
        change = values - values[:1]
        changes.append(change[:, 0] if change.shape[1] == 1 else np.linalg.norm(change, axis=1))
    # A letter keeps its index, as in p_y.
    names = [name if name[1:2] == "_" else name.replace("_", " ") for name in laws]
    return names, np.stack(changes, axis=1) if changes else np.zeros((len(rows), 0))
