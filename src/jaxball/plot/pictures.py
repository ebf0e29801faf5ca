"""What a user's function draws of a system with a Lagrangian, and how its coordinates are shared by panels."""

import functools
import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ..classical import LagrangianState
from ..interface.arguments import refusal, require_callable
from ..simulation.trajectory import Trajectory
from .palette import INK, MASSES
from .record import require_finite_rows

COLOURS = (INK, *MASSES)
# Coordinates with these names, and any number after them, are angles: Greek letters, and words for turning.
ANGLES = re.compile(
    r"(alpha|beta|gamma|delta|epsilon|eta|theta|kappa|phi|varphi|psi|chi|omega|vartheta|angle|heading|lean|roll|pitch|"
    r"yaw|tilt|turn|swing|back|front)[_ ]?\w?\d*"
)
Lines = Sequence[Float[np.ndarray, "points d"]]
Picture = Callable[[float, Float[np.ndarray, " n"]], Lines]


def motion_panels(names: Sequence[str]) -> list[tuple[str, str, str, list[int]]]:
    """Lists the panels of coordinates with these names and of their rates: title, the state's field, what a rate's
    name ends in, and which coordinates it has.
    """
    angles = [k for k, name in enumerate(names) if ANGLES.fullmatch(name)]
    positions = [k for k in range(len(names)) if k not in angles]
    kinds = (("positions", "rates", positions), ("angles", "angular rates", angles))
    panels = [(kind, "q", "", chosen) for kind, _, chosen in kinds]
    panels += [(rates, "qdot", "dot", chosen) for _, rates, chosen in kinds]
    return [panel for panel in panels if panel[3]]


def require_lagrangian(trajectory: Trajectory[Any, Any]) -> LagrangianState:
    """Returns the states of a run of a system with a Lagrangian.

    **Raises:** ``ValueError`` for one of another system.
    """
    if not isinstance(trajectory.state, LagrangianState):
        raise ValueError(
            "Argument `trajectory` must be of a system with a Lagrangian, but it is of a "
            f"{type(trajectory.system).__name__}; leave `picture` out, or use its method plot()."
        )
    return trajectory.state


class Drawn(NamedTuple):
    """What a user's function draws at the saved times that a run reached."""

    times: Float[np.ndarray, " T"]
    lines_at: Callable[[int], list[Float[np.ndarray, "points d"]]]  # of the k-th of these times
    points: Float[np.ndarray, "all d"]  # of all times


def read_picture(trajectory: Trajectory[Any, Any], picture: Picture) -> Drawn:
    """Reads the points and lines that a user's function draws of a system with a Lagrangian.

    **Raises:** ``TypeError`` and ``ValueError`` for a function that does not draw them, or not always as many.
    """
    rows, state = require_finite_rows(trajectory), require_lagrangian(trajectory)
    require_callable("picture", picture, "t", "q")
    times, q = np.asarray(trajectory.times)[rows], np.asarray(state.q)[rows]
    count = None

    @functools.cache
    def lines_at(k: int) -> list[np.ndarray]:
        return _lines(picture(float(times[k]), q[k]))

    for k, t in enumerate(times):
        count = len(lines_at(k)) if count is None else count
        if len(lines_at(k)) != count:
            must = f"a list of as many points and lines at every time, {count} as at t = {times[0]:g}"
            raise ValueError(f"Argument `picture` must return {must}, but at t = {t:g} it has {len(lines_at(k))}.")
    return Drawn(times, lines_at, np.concatenate([points for k in range(len(times)) for points in lines_at(k)]))


def _lines(drawn: Any) -> list[np.ndarray]:
    """Returns what a picture has as arrays.

    **Raises:** ``TypeError`` for anything but a list of points and lines of the same dimension.
    """
    must = "a list of points and lines, each an array of shape (points, 2) or (points, 3)"
    if not isinstance(drawn, list | tuple) or not drawn:
        raise refusal("picture(t, q)", must, drawn)
    lines = [np.atleast_2d(np.asarray(points, dtype=float)) for points in drawn]
    if any(points.ndim != 2 for points in lines) or {points.shape[1] for points in lines} not in ({2}, {3}):
        raise refusal("picture(t, q)", must, [points.shape for points in lines])
    return lines
