"""Takes from a trajectory what figures draw: its rows as NumPy arrays, and what a user's function draws of them."""

import functools
import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from ..interface.arguments import a, refusal, require_callable, require_one_run
from ..physics.body import AbstractBody
from ..physics.classical import LagrangianState
from ..simulation.one_sided import with_one_sided_limits
from ..simulation.trajectory import Trajectory
from .palette import INK, MASSES


class Record(NamedTuple):
    """The saved times that the solve reached, and the observables at each."""

    times: Float[np.ndarray, " T"]
    observables: Any  # Observables whose arrays are NumPy's


def record(trajectory: Trajectory) -> Record:
    """Returns the rows of ``trajectory`` whose states are finite; the others are not drawn.

    **Raises:** ``ValueError`` for a batch of trajectories and for a reduced one.
    """
    require_one(trajectory)
    rows = finite_rows(trajectory)
    observables = jax.tree.map(lambda leaf: np.asarray(leaf)[rows], trajectory.observables)
    return Record(np.asarray(trajectory.times)[rows], observables)


def with_jumps(trajectory: Trajectory) -> Trajectory:
    """Adds the states just before and just after each switch of the run's mode, which are drawn as jumps.

    **Raises:** ``ValueError`` for a batch of trajectories.
    """
    require_one(trajectory)
    limits = with_one_sided_limits(trajectory)
    # With its scenario, whose units the axes have; what makes a new trajectory leaves it out.
    return limits if trajectory.scenario is None else limits.set_scenario(trajectory.scenario)


def require_finite_rows(trajectory: Trajectory) -> np.ndarray:
    """Returns the indices of the saved times at which the state is finite.

    **Raises:** ``ValueError`` for a batch of trajectories, and where there is none.
    """
    require_one(trajectory)
    rows = finite_rows(trajectory)
    if not rows.size:
        raise ValueError(
            f"Argument `trajectory` must have a finite state to show, but it has none. {trajectory.message}"
        )
    return rows


def require_one(trajectory: Trajectory) -> None:
    """Raises ``ValueError`` for a batch of trajectories."""
    require_one_run(trajectory.status, "A picture")


def require_one_of_body(trajectory: Trajectory) -> None:
    """Raises ``ValueError`` for a batch of trajectories, and for one of another system than a ball or a disk."""
    require_one(trajectory)
    if not isinstance(trajectory.system, AbstractBody):
        raise ValueError(
            "Argument `trajectory` must be of a ball or a disk, but it is of "
            f"{a(type(trajectory.system).__name__)}; its method plot() draws its motion."
        )


def columns_by_field(names: Sequence[str]) -> dict[str, list[int]]:
    """Returns the places of the numbers of each field, by its name: of ``z[0]`` and ``z[1]`` those of ``z``."""
    columns: dict[str, list[int]] = {}
    for place, name in enumerate(names):
        columns.setdefault(name.partition("[")[0], []).append(place)
    return columns


def finite_rows(trajectory: Trajectory) -> np.ndarray:
    """Returns the indices of the saved times at which every entry of the state is finite."""
    leaves = [np.asarray(leaf).reshape(len(trajectory.times), -1) for leaf in jax.tree.leaves(trajectory.state)]
    return np.flatnonzero(np.all(np.isfinite(np.concatenate(leaves, axis=1)), axis=1))


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
