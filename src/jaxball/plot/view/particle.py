"""The scene of particles: their paths in the space of x, y and z."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from ...classical import VakonomicState
from ...simulation.trajectory import Trajectory
from ..palette import COMPONENTS
from ..record import known_rows
from .graphs import PAIR, each, graph, laws, series
from .packing import Numbers
from .scene import Scene, free_stand, law_changes, made

SMALL = 1 / 24  # of the largest extent of all paths: the radius that arrows and dots are drawn by


def particle_scene(trajectories: Sequence[Trajectory[Any, Any]]) -> Scene:
    """The scene of particles.

    **Raises:** ``ValueError`` for a batch, and where no state is known.
    """
    rows = [known_rows(trajectory) for trajectory in trajectories]
    pairs = list(zip(trajectories, rows, strict=True))
    places = np.concatenate([_columns(trajectory, kept, "x", "y", "z") for trajectory, kept in pairs])
    radius = SMALL * (float(np.max(np.ptp(places, axis=0))) or 1.0)
    changes = [law_changes(trajectory, kept) for trajectory, kept in pairs]
    numbers = [
        _numbers(trajectory, kept, radius, found) for (trajectory, kept), (_, found) in zip(pairs, changes, strict=True)
    ]
    alike = all(isinstance(one.state, type(trajectories[0].state)) for one in trajectories)
    return Scene(
        free_stand(-60.0),
        [made("particle", trajectory, radius, len(kept)) for trajectory, kept in pairs],
        numbers,
        _graphs(trajectories, changes[0][0] if alike else []),
    )


def _columns(trajectory: Trajectory[Any, Any], rows: np.ndarray, *names: str) -> Float[np.ndarray, "T k"]:
    return np.stack([np.asarray(getattr(trajectory.state, name))[rows] for name in names], axis=1)


def _numbers(
    trajectory: Trajectory[Any, Any], rows: np.ndarray, radius: float, changes: Float[np.ndarray, "T laws"]
) -> dict[str, Numbers]:
    numbers = {
        "time": Numbers(np.asarray(trajectory.times)[rows], 0.0),
        "centre": Numbers(_columns(trajectory, rows, "x", "y", "z"), radius),
        "velocity": Numbers(_columns(trajectory, rows, "xdot", "ydot", "zdot")),
        "laws": Numbers(changes),
    }
    if isinstance(trajectory.state, VakonomicState):
        numbers["multiplier"] = Numbers(_columns(trajectory, rows, "multiplier"))
    return numbers


def _graphs(trajectories: Sequence[Trajectory[Any, Any]], names: list[str]) -> list[dict[str, Any]]:
    """The graphs of particles, with the laws ``names`` where all have them; the constraint is ż = y ẋ."""
    if len(trajectories) > PAIR:
        coordinates = [graph(name, [series(name, None, "centre", [k])]) for k, name in enumerate("xyz")]
        return [*coordinates, graph("Speed", [series("|v|", None, "velocity", [0, 1, 2], norm=True)])]
    graphs = [
        graph("Coordinates", each("xyz", COMPONENTS, "centre")),
        graph("Velocity", each(("ẋ", "ẏ", "ż"), COMPONENTS, "velocity")),
    ]
    if any(isinstance(one.state, VakonomicState) for one in trajectories):
        graphs.append(graph("Multiplier", [series("λ", COMPONENTS[0], "multiplier", [0])]))
    return graphs + laws(names)
