"""Figures specific to runs with a law of contact: the height above the plane, and the slip speed."""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from ..simulation.history import ContactHistory
from ..simulation.trajectory import Trajectory
from .modes import modes_of
from .over_time import Series, over_time, sizes_of, without_rounding
from .palette import COMPONENTS
from .record import drawn_run, finite_rows, require_one
from .style import up_to_ticks


def height(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """The height h of the body above the plane, for a run with a law of contact.

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
    run = _of_contact(trajectory)
    values = np.asarray(_history(run).height)
    return _one(run, values, "$h$", sizes_of(run.system).length, ax)


def slip_speed(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """|v_s|, the speed of the body's lowest point along the plane, for a run with a law of contact.

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
    run = _of_contact(trajectory)
    values = np.linalg.norm(np.asarray(_history(run).slip)[:, :2], axis=1)
    return _one(run, values, r"$|\,\mathbf{v}_s|$", sizes_of(run.system).speed, ax)


def of_contact(trajectory: Trajectory[Any, Any]) -> list[Callable[..., Axes]]:
    """The figures of height and slip speed that are not empty, none without a law of contact."""
    history, rows = trajectory.contact, finite_rows(trajectory)
    if history is None:
        return []
    sizes = sizes_of(trajectory.system)
    moves = {
        height: without_rounding(np.asarray(history.height), sizes.length),
        slip_speed: without_rounding(np.asarray(history.slip)[:, :2], sizes.speed),
    }
    return [draw for draw, values in moves.items() if np.any(values[rows])]


def _one(run: Trajectory, values: Float[np.ndarray, " T"], name: str, size: float, ax: Axes | None) -> Axes:
    rows = finite_rows(run)
    series = [Series(values[rows], "", COMPONENTS[0])]
    ax = over_time(run.system, np.asarray(run.times)[rows], series, name, ax, modes=modes_of(run), size=size)
    up_to_ticks(ax, low=0.0)
    return ax


def _of_contact(trajectory: Trajectory) -> Trajectory:
    """The run, with the states on both sides of its switches."""
    require_one(trajectory)
    if trajectory.contact is None:
        raise ValueError(
            "Argument `trajectory` must be of a run with a law of contact, but it has none; a body that rolls neither "
            "slips nor leaves the plane. Give one: simulate(..., contact=Contact(sliding=0.3))."
        )
    return drawn_run(trajectory)


def _history(run: Trajectory) -> ContactHistory:
    assert run.contact is not None
    return run.contact
