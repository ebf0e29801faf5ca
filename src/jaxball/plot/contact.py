"""Figures of what only a run with a law of contact has: its height over the plane, and the speed of its slip."""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from ..simulation.history import ContactHistory
from ..simulation.trajectory import Trajectory
from .modes import modes_of
from .record import finite_rows, require_one
from .style import COMPONENTS, up_to_ticks
from .time_series import Series, over_time


def height(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """The height h of the body over the plane, of a run with a law of contact.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns with a ``contact``.

    **Raises:** ``ValueError`` for a run without a law of contact, a batch, or a three-dimensional ``ax``.

    **Example:**

    >>> from jaxball import Contact, Disk, DiskState, ReleasedState, plot, simulate
    >>> thrown = ReleasedState(DiskState(), V=(1.0, 0.0, 0.0), height=0.1)
    >>> run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], thrown, contact=Contact(sliding=0.2))
    >>> plot.height(run).get_ylabel()
    '$h$'
    """
    values, rows = _of_contact(trajectory).height, finite_rows(trajectory)
    ax = _one(trajectory, np.asarray(values)[rows], "$h$", ax)
    up_to_ticks(ax, low=0.0)
    return ax


def slip_speed(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """|v_s|, the speed along the plane of the body's lowest point over it, of a run with a law of contact.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns with a ``contact``.

    **Raises:** as :func:`height`, also for a three-dimensional ``ax``.

    **Example:**

    >>> from jaxball import Contact, Disk, DiskState, ReleasedState, plot, simulate
    >>> thrown = ReleasedState(DiskState(), V=(1.0, 0.0, 0.0), height=0.1)
    >>> run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], thrown, contact=Contact(sliding=0.2))
    >>> [band.get_label() for band in plot.slip_speed(run).patches]
    ['flight', 'sliding']
    """
    slip, rows = np.asarray(_of_contact(trajectory).slip), finite_rows(trajectory)
    ax = _one(trajectory, np.linalg.norm(slip[rows, :2], axis=1), r"$|\,\mathbf{v}_s|$", ax)
    up_to_ticks(ax, low=0.0)
    return ax


def of_contact(trajectory: Trajectory[Any, Any]) -> list[Callable[..., Axes]]:
    """Of height and slip speed the figures that show something: none without a law of contact, nor of what is zero."""
    history, rows = trajectory.contact, finite_rows(trajectory)
    if history is None:
        return []
    moves = {height: np.asarray(history.height), slip_speed: np.asarray(history.slip)[:, :2]}
    return [draw for draw, values in moves.items() if np.any(values[rows])]


def _one(trajectory: Trajectory, values: Float[np.ndarray, " T"], name: str, ax: Axes | None) -> Axes:
    times = np.asarray(trajectory.times)[finite_rows(trajectory)]
    series = [Series(values, "", COMPONENTS[0])]
    return over_time(trajectory.system, times, series, name, ax, modes=modes_of(trajectory))


def _of_contact(trajectory: Trajectory) -> ContactHistory:
    require_one(trajectory)
    if trajectory.contact is None:
        raise ValueError(
            "Argument `trajectory` must be of a run with a law of contact, but it has none; a body that rolls neither "
            "slips nor leaves the plane. Give one: simulate(..., contact=Contact(sliding=0.3))."
        )
    return trajectory.contact
