"""The readings of sensors along a run, over time."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..sensors import AbstractSensor
from ..simulation.trajectory import Trajectory
from .modes import modes_of, share_bands, with_breaks
from .over_time import Series, over_time
from .palette import COMPONENTS
from .record import drawn_run, finite_rows, require_one
from .style import WIDE, caption

PANEL = 1.5  # the height of a panel, in inches


def measurements(trajectory: Trajectory[Any, Any], sensors: Mapping[str, AbstractSensor]) -> Figure:
    """The readings of sensors, each in a panel under its name: a vector by its components along its axes.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.
    - ``sensors``: one or more of those of :mod:`jaxball.sensors`, by name.

    **Raises:** ``ValueError`` for a batch, without sensors, and as :meth:`jaxball.Trajectory.measured`.
    """
    require_one(trajectory)
    if not sensors:
        raise ValueError("Argument `sensors` must have one sensor or more to draw, but it is empty.")
    run = drawn_run(trajectory)
    rows, modes = finite_rows(run), modes_of(run)
    times, found = np.asarray(run.times)[rows], run.measured(sensors)
    figure = Figure(figsize=(WIDE[0], 0.5 + PANEL * len(sensors)), layout="constrained")
    caption(figure, trajectory.system)
    panels = figure.subplots(len(sensors), 1, sharex=True, squeeze=False)[:, 0]
    for ax, (name, leaf) in zip(panels, found.items(), strict=True):
        columns = np.asarray(leaf)[rows].reshape(len(rows), -1).T
        drawn, *lines = with_breaks(modes, times, *columns)
        labels = [rf"$x_{{{k}}}$" for k in range(1, len(lines) + 1)] if len(lines) > 1 else [""]
        looks = (COMPONENTS[k % len(COMPONENTS)] for k in range(len(lines)))
        series = [Series(*one) for one in zip(lines, labels, looks, strict=True)]
        over_time(trajectory.system, drawn, series, name, ax, modes=modes)
        ax.label_outer()
    share_bands(figure)
    return figure
