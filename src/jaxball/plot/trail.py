"""The trail of an animation: the path of the body's lowest point up to the time shown.

It is dashed where the body slides, and dotted, above the plane, where it flies.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ..simulation.trajectory import Trajectory
from .floor import Placed, Setting
from .modes import PATHS, track_of
from .moving import line, move
from .palette import TRAIL


def draw_trail(
    ax: Axes, trajectory: Trajectory, placed: Placed, setting: Setting, **look: Any
) -> Callable[[int], None]:
    """Draws the trail, and returns a function that shows it up to the k-th saved time."""
    track = track_of(trajectory)
    if track is None:
        trail = line(ax, color=TRAIL, **look)
        return lambda k: move(trail, placed.path[: k + 1] + placed.moved[k])
    look = {name: value for name, value in look.items() if name != "solid_capstyle"}
    pieces = [(track.pieces(mode), line(ax, color=TRAIL, **look, **dashes)) for mode, dashes in PATHS.items()]

    def show(k: int) -> None:
        for (times, points), artist in pieces:
            until = np.searchsorted(times, placed.times[k], side="right")
            move(artist, points[:until] @ setting.page.T + placed.moved[k])

    return show
