"""Animations of a rolling ball or disk."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from matplotlib.figure import Figure
from matplotlib.typing import ColorType

from ..interface.output import replacing
from ..simulation.trajectory import Trajectory
from .canvas import Canvas
from .gif import gif
from .mp4 import has_ffmpeg, mp4
from .record import record_to_show
from .scene import scene

FRAMES = {".mp4": 30, ".gif": 20}  # a second


def animate(
    trajectory: Trajectory,
    path: str | Path,
    fps: int | None = None,
    *,
    speed: float = 1.0,
    dpi: float | int = 120,
    size: tuple[int, int] | None = None,
    progress: Callable[[int, int], Any] | None = None,
) -> Path:
    """Animates the rolling body: shell, rails, masses, centre of mass and the trail of the contact point.

    Gravity points down, so that a tilted plane is the top of a wedge. A moving plane carries floor and trail along, and
    a turntable turns; the trail is in axes that move with the plane but do not turn. For a run with a law of contact,
    it is that of the lowest point, dashed where the body slides and dotted where it flies above its shadow.

    Each frame shows the nearest saved time, so save at least ``fps / speed`` times per unit of time for a smooth
    animation.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns; only its finite states are shown.
    - ``path``: a file that ends in ``.mp4``, which needs ffmpeg, or in ``.gif``. Without a suffix,
      ``.mp4`` is added where ffmpeg is installed, and ``.gif`` otherwise.
    - ``fps``: frames per second; if not given, 30 in an MP4 and 20 in a GIF.
    - ``speed``: units of the trajectory's time per second of the animation.
    - ``dpi``: dots per inch; a frame is 8 inches wide.
    - ``size``: width and height of a frame in pixels, instead of ``dpi``; the scene is scaled to fit.
    - ``progress``: called with the number of frames done and the number of all, after each frame.

    **Returns:** the path of the file. It is written when all frames have been drawn; nothing is written if that fails.

    **Raises:** ``ValueError`` for another suffix, for ``.mp4`` without ffmpeg, for an ``fps`` or a
    ``speed`` that is not positive, for a trajectory without a finite state, and for a reduced one or a batch.
    """
    path = _checked(Path(path))
    fps = FRAMES[path.suffix] if fps is None else fps
    for name, value in (("fps", fps), ("speed", speed)):
        if not value > 0:
            raise ValueError(f"Argument `{name}` must be a positive number, but it is {value}.")
    run = record_to_show(trajectory)
    figure, show = scene(trajectory, run)
    if size is not None:
        dpi = _fitted(figure, size)
    shown = frames(run.times, speed / fps)
    show(int(shown[0]))
    canvas = Canvas(figure, dpi)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        make = mp4 if path.suffix == ".mp4" else partial(gif, colours=_colours(figure))
        with make(temporary, fps, canvas.size) as add:
            for done, k in enumerate(shown, start=1):
                show(int(k))
                add(canvas.picture())
                if progress is not None:
                    progress(done, len(shown))
    return path


def frames(times: Float[np.ndarray, " T"], step: float) -> Int[np.ndarray, " frames"]:
    """The indices of the saved times nearest to the first one, the first one + ``step``, and so on."""
    count = int(np.floor((times[-1] - times[0]) / step + 1e-9)) + 1
    return np.searchsorted((times[1:] + times[:-1]) / 2, times[0] + step * np.arange(count))


def _fitted(figure: Figure, size: tuple[int, int]) -> float:
    """Widens a figure to the proportions of ``size`` without changing its Axes, and returns the dots per inch."""
    before = figure.get_size_inches()
    dpi = float(np.min(np.asarray(size) / before))
    after = np.asarray(size) / dpi
    for ax in figure.axes:
        box = ax.get_position(original=True)
        corner = ((box.x0, box.y0) * before + (after - before) / 2) / after
        ax.set_position((*corner, *((box.width, box.height) * before / after)))
    figure.set_size_inches(*after)
    return dpi


def _colours(figure: Figure) -> list[ColorType]:
    """The colours of the lines and faces of a figure."""
    lines = [line.get_color() for ax in figure.axes for line in ax.lines]
    faces = [
        tuple(colour) for ax in figure.axes for face in ax.collections for colour in np.atleast_2d(face.get_facecolor())
    ]
    return [*lines, *faces]


def _checked(path: Path) -> Path:
    """The path with a suffix."""
    if path.suffix == "":
        path = path.with_suffix(".mp4" if has_ffmpeg() else ".gif")
    if path.suffix not in FRAMES:
        raise ValueError(f"Argument `path` must end in .mp4 or .gif, but it is {str(path)!r}.")
    if path.suffix == ".mp4" and not has_ffmpeg():
        raise ValueError(
            f"Argument `path` must end in .gif where ffmpeg is not installed, but it is {str(path)!r}; "
            "install ffmpeg, or write a .gif."
        )
    return path
