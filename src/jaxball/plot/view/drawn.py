"""Systems with a Lagrangian in a view: the points and lines that a user's function draws, and graphs of coordinates."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from ...simulation.trajectory import Trajectory
from ..palette import COMPONENTS
from ..pictures import COLOURS, Drawn, Picture, motion_panels, read_picture
from ..record import require_finite_rows
from .scene import PAIR, Numbers, Scene, each, graph, law_changes, laws, make_body, of_masses, series

DOT = 1 / 50  # the radius of dots, of the largest extent of all that is drawn
FROM_THE_SIDE = {"elevation": 0.0, "azimuth": -90.0}  # degrees; of pictures of a plane, whose second axis is upwards
FROM_ABOVE = {"elevation": 20.0, "azimuth": -60.0}


def picture_scene(trajectories: Sequence[Trajectory[Any, Any]], picture: Picture) -> Scene:
    """Builds the scene of systems with a Lagrangian, which a user's function draws.

    **Raises:** ``TypeError`` and ``ValueError`` as :func:`~jaxball.plot.pictures.read_picture`.
    """
    everything = [read_picture(trajectory, picture) for trajectory in trajectories]
    planar = all(drawn.points.shape[1] == PAIR for drawn in everything)
    points = np.concatenate([_in_space(drawn.points) for drawn in everything])
    low, high = points.min(axis=0), points.max(axis=0)
    radius = DOT * (float(np.max(high - low)) or 1.0)
    names, changes = zip(*(law_changes(run, require_finite_rows(run)) for run in trajectories), strict=True)
    pairs = list(zip(trajectories, everything, strict=True))
    return Scene(
        {
            "axes": np.eye(3).tolist(),
            "floor": None,
            "obstacles": [],
            "corners": np.stack(np.meshgrid(*zip(low, high, strict=True)), axis=-1).reshape(-1, 3).tolist(),
            "camera": FROM_THE_SIDE if planar else FROM_ABOVE,
        },
        [
            make_body("drawn", run, radius, len(drawn.times))
            | {"lines": [COLOURS[k % len(COLOURS)] for k in range(len(drawn.lines_at(0)))]}
            for run, drawn in pairs
        ],
        [_numbers(run, drawn, radius, change) for (run, drawn), change in zip(pairs, changes, strict=True)],
        _graphs(trajectories, names[0]),
    )


def _in_space(points: Float[np.ndarray, "_ d"]) -> Float[np.ndarray, "_ 3"]:
    """Returns points in space; those of a plane stand upright."""
    return points if points.shape[1] > PAIR else np.insert(points, 1, 0.0, axis=1)


def _numbers(
    trajectory: Trajectory[Any, Any], drawn: Drawn, radius: float, changes: Float[np.ndarray, "T laws"]
) -> dict[str, Numbers]:
    rows, at_times = require_finite_rows(trajectory), range(len(drawn.times))
    numbers = {"time": Numbers(drawn.times, 0.0), "laws": Numbers(changes)}
    for k in range(len(drawn.lines_at(0))):
        lines = [_in_space(drawn.lines_at(i)[k]) for i in at_times]
        longest = max(map(len, lines))
        # An array has as many points at each time: a shorter line stays at its end.
        filled = [np.pad(line, ((0, longest - len(line)), (0, 0)), mode="edge") for line in lines]
        numbers[f"line_{k}"] = Numbers(np.stack(filled), radius)
    # What is traced is where the last line, or the last point, ends.
    ends = np.concatenate([_in_space(drawn.lines_at(i)[-1][-1:]) for i in at_times])
    numbers["centre"] = Numbers(ends, radius)
    numbers |= {name: Numbers(np.asarray(getattr(trajectory.state, name))[rows]) for name in ("q", "qdot")}
    forces = np.asarray(trajectory.multipliers)[rows]
    return numbers | ({"multipliers": Numbers(forces)} if forces.shape[1] else {})


def _graphs(trajectories: Sequence[Trajectory[Any, Any]], law_names: list[str]) -> list[dict[str, Any]]:
    """Returns the graphs of coordinates, rates and λ; of many runs, one of each coordinate."""
    names = trajectories[0].system.coordinates
    if len(trajectories) > PAIR:
        return [graph(name, [series(name, None, "q", [k])]) for k, name in enumerate(names)]
    graphs = []
    for title, field, dot, chosen in motion_panels(names):
        looks = [(*COMPONENTS, *COLOURS)[k % len(COLOURS)] for k in chosen]
        lines = each([f"{names[k]}{dot}" for k in chosen], looks, field)
        for line, k in zip(lines, chosen, strict=True):
            line["columns"] = [k]
        graphs.append(graph(title.capitalize(), lines))
    count = np.asarray(trajectories[0].multipliers).shape[1]
    if count:
        lines = each([f"λ{k}" for k in range(1, count + 1)], of_masses(range(1, count + 1)), "multipliers")
        graphs.append(graph("Constraint forces", lines))
    return graphs + laws(law_names)
