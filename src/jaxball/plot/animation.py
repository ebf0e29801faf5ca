"""Animations of a rolling ball or disk."""

from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.figure import Figure

from ..simulation.trajectory import Trajectory
from .record import record
from .scene import scene


def animate(
    trajectory: Trajectory,
    path: str | Path,
    fps: int = 30,
    *,
    speed: float = 1.0,
    dpi: float | int = 120,
    size: tuple[int, int] | None = None,
) -> Path:
    """Animates the rolling body: shell, rails, masses, centre of mass and the trail of the contact point.

    Gravity points down, so that a tilted plane is the top of a wedge. A plane that moves takes floor and trail along,
    and a turntable turns; the trail is in axes that move with the plane and do not turn.

    Each frame shows the nearest saved time, so save at least ``fps / speed`` times per unit of time for a smooth
    animation.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns; only its finite states are shown.
    - ``path``: a file that ends in ``.mp4``, which needs ffmpeg, or in ``.gif``. Without a suffix,
      ``.mp4`` is added where ffmpeg is installed, and ``.gif`` otherwise.
    - ``fps``: frames per second.
    - ``speed``: units of the trajectory's time per second of the animation.
    - ``dpi``: dots per inch; a frame is 8 inches wide.
    - ``size``: width and height of a frame in pixels, instead of ``dpi``; the scene is scaled to fit.

    **Returns:** the path of the file.

    **Raises:** ``ValueError`` for another suffix, for ``.mp4`` without ffmpeg, for an ``fps`` or a
    ``speed`` that is not positive, for a trajectory without a finite state, and for a reduced one or a batch.
    """
    for name, value in (("fps", fps), ("speed", speed)):
        if not value > 0:
            raise ValueError(f"Argument `{name}` must be a positive number, but it is {value}.")
    path, writer = _writer(Path(path), fps)
    run = record(trajectory)
    if not len(run.times):
        raise ValueError(
            f"Argument `trajectory` must have a finite state to show, but it has none. {trajectory.message}"
        )
    figure, show = scene(trajectory, run)
    if size is not None:
        dpi = _fitted(figure, size)
    path.parent.mkdir(parents=True, exist_ok=True)
    with writer.saving(figure, str(path), dpi):
        for k in frames(run.times, speed / fps):
            show(int(k))
            writer.grab_frame()
    return path


def frames(times: Float[np.ndarray, " T"], step: float) -> Int[np.ndarray, " frames"]:
    """The indices of the saved times nearest to the first one, that one + ``step``, and so on."""
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


def _writer(path: Path, fps: int) -> tuple[Path, AbstractMovieWriter]:
    with_ffmpeg = FFMpegWriter.isAvailable()
    if path.suffix == "":
        path = path.with_suffix(".mp4" if with_ffmpeg else ".gif")
    if path.suffix == ".gif":
        return path, PillowWriter(fps=fps)
    if path.suffix != ".mp4":
        raise ValueError(f"Argument `path` must end in .mp4 or .gif, but it is {str(path)!r}.")
    if not with_ffmpeg:
        raise ValueError(
            f"Argument `path` must end in .gif where ffmpeg is not installed, but it is {str(path)!r}; "
            "install ffmpeg, or write a .gif."
        )
    # Quality 18 is visually lossless, and yuv420p is what every player can show.
    return path, FFMpegWriter(fps=fps, codec="h264", extra_args=["-crf", "18", "-pix_fmt", "yuv420p"])
