"""Animations of a rolling ball or disk as MP4 or GIF, and single frames of them."""

import base64
import contextlib
import functools
import html
import struct
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from matplotlib.animation import FFMpegWriter
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.typing import ColorType
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from PIL import Image
from PIL.GifImagePlugin import getdata

from ..interface.arguments import a
from ..interface.interruption import block_in_children, on_interrupt
from ..interface.output import OutputError, replacing
from ..numerics.arrays import Numbers
from ..physics.classical import LagrangianState
from ..simulation.trajectory import Trajectory
from .classical import picture_scene
from .record import Picture, record, require_finite_rows, require_lagrangian
from .scene import Scene, scene

FRAMES = {".mp4": 30, ".gif": 20}  # a second
Pixels = UInt8[np.ndarray, "height width 3"]
GREYS = (1.0, 0.965, 0.9, 0.8, 0.7, 0.6, 0.45, 0.25, 0.0)
STRENGTHS = (1.0, 0.66, 0.33)  # of a colour over white, for antialiased edges
SHORTEST_GAP = 8  # pixels; a gap between changes that is shorter is written too, which compresses better
FOREVER = 0
QUALITY = 26  # of libx264, where 0 is exact and 51 the worst
EVEN = "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white"  # the chroma of a film has half the resolution of its luma
PIXELS = "yuv420p"  # which every player can show


class Animation:
    """A run as a film, which a notebook plays in place. :func:`animate` makes one.

    Nothing is drawn before it is saved or shown. ``path`` is the file to which it was written last, None if it was not.

    **Arguments:**

    - ``name``: of the system, such as ``disk``.
    - ``times``: the saved times, shape (T,).
    - ``make``: a function of nothing that returns a figure, and a function that makes it show the k-th of these times.
    - ``fps``, ``speed``, ``dpi``, ``size``, ``progress``: as for :func:`animate`.

    **Raises:** ``ValueError`` for an ``fps`` or a ``speed`` that is not positive.
    """

    def __init__(
        self,
        name: str,
        times: Float[np.ndarray, " T"],
        make: Callable[[], Scene],
        fps: float | int | None,
        speed: float,
        dpi: float | int,
        size: tuple[int, int] | None,
        progress: Callable[[int, int], Any] | None,
    ) -> None:
        for argument, value in (("fps", fps), ("speed", speed)):
            if value is not None and not value > 0:
                raise ValueError(f"Argument `{argument}` must be a positive number, but it is {value}.")
        self.path: Path | None = None
        self._name, self._times, self._make = name, times, make
        self._fps, self._speed, self._dpi, self._size, self._progress = fps, speed, dpi, size, progress

    def save(self, path: str | Path) -> Path:
        """Writes the film to ``path``, as :func:`animate` does, and returns the path of the file."""
        path = _check_path(Path(path))
        fps = FRAMES[path.suffix] if self._fps is None else self._fps
        figure, show = self._make()
        dpi = self._dpi if self._size is None else _widen_figure(figure, self._size)
        shown = frames(self._times, self._speed / fps)
        show(int(shown[0]))
        canvas = Canvas(figure, dpi)

        def pictures() -> Iterator[Pixels]:
            for done, k in enumerate(shown, start=1):
                show(int(k))
                yield canvas.picture()
                if self._progress is not None:
                    self._progress(done, len(shown))

        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary:
            if path.suffix == ".mp4":
                mp4(temporary, pictures(), fps, canvas.size)
            else:
                gif(temporary, pictures(), fps, canvas.size, _colours(figure))
        self.path = path
        return path

    def _repr_html_(self) -> str:
        kind, film = self._film
        data, name = base64.b64encode(film).decode(), html.escape(repr(self), quote=True)
        if kind == ".gif":
            return f'<img src="data:image/gif;base64,{data}" alt="{name}" style="max-width: 100%">'
        return (
            f'<video controls autoplay loop muted style="max-width: 100%" title="{name}">'
            f'<source src="data:video/mp4;base64,{data}" type="video/mp4"></video>'
        )

    @functools.cached_property
    def _film(self) -> tuple[str, bytes]:
        """The suffix and the content of the file, made once, however often a notebook shows it."""
        if self.path is not None and self.path.exists():
            return self.path.suffix, self.path.read_bytes()
        with tempfile.TemporaryDirectory() as folder:
            path = self.save(Path(folder) / "film")
            self.path = None  # as the folder goes
            return path.suffix, path.read_bytes()

    def __repr__(self) -> str:
        first, last = self._times[[0, -1]]
        return f"Animation of {a(self._name)} from t = {first:g} to t = {last:g}"


def _colours(figure: Figure) -> list[ColorType]:
    """Lists the colours of a scene: a palette must have all of them before the first frame is drawn."""
    lines = [line.get_color() for ax in figure.axes for line in ax.lines]
    faces = (np.atleast_2d(face.get_facecolor()) for ax in figure.axes for face in ax.collections)
    return [*lines, *(tuple(colour) for face in faces for colour in face)]


def animate(
    trajectory: Trajectory,
    path: str | Path | None = None,
    fps: int | None = None,
    *,
    speed: float = 1.0,
    dpi: float | int = 120,
    size: tuple[int, int] | None = None,
    picture: Picture | None = None,
    progress: Callable[[int, int], Any] | None = None,
) -> Animation:
    rows = require_finite_rows(trajectory)
    make = scene_of(trajectory, picture)
    times = np.asarray(trajectory.times)[rows]
    film = Animation(trajectory.system.title, times, make, fps, speed, dpi, size, progress)
    if path is not None:
        film.save(path)
    return film


def frames(times: Float[np.ndarray, " T"], step: float) -> Int[np.ndarray, " frames"]:
    """Returns the indices of the saved times nearest to the first one, the first one + ``step``, and so on."""
    # A little more, so that rounding does not leave out the last frame.
    count = int(np.floor((times[-1] - times[0]) / step + 1e-9)) + 1
    return np.searchsorted((times[1:] + times[:-1]) / 2, times[0] + step * np.arange(count))


def _widen_figure(figure: Figure, size: tuple[int, int]) -> float:
    """Widens a figure to the proportions of ``size`` without changing its Axes, and returns the dots per inch."""
    before = figure.get_size_inches()
    # The smaller one, so that all of the scene is in the frame.
    dpi = float(np.min(np.asarray(size) / before))
    after = np.asarray(size) / dpi
    for ax in figure.axes:
        box = ax.get_position(original=True)
        corner = ((box.x0, box.y0) * before + (after - before) / 2) / after
        ax.set_position((*corner, *((box.width, box.height) * before / after)))
    figure.set_size_inches(*after)
    return dpi


def _check_path(path: Path) -> Path:
    """Checks the path's suffix, and adds one where there is none."""
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


def scene_of(trajectory: Trajectory, picture: Picture | None) -> Callable[[], Scene]:
    """Returns a function that makes the scene of a run: of a rolling body, or what ``picture`` draws.

    **Raises:** ``ValueError`` for a run that cannot be drawn.
    """
    if picture is not None:
        require_lagrangian(trajectory)
        return lambda: picture_scene(trajectory, picture)
    if isinstance(trajectory.state, LagrangianState):
        raise ValueError(
            f"Argument `picture` must be given for {a(trajectory.system.title)}, whose coordinates may mean anything: "
            "a function of (t, q) that returns a list of points and lines."
        )
    run = record(trajectory)
    return lambda: scene(trajectory, run)


def snapshot(trajectory: Trajectory, t: Numbers | None = None, *, picture: Picture | None = None) -> Figure:
    times = np.asarray(trajectory.times)[require_finite_rows(trajectory)]
    figure, show = scene_of(trajectory, picture)()
    show(len(times) - 1 if t is None else int(np.argmin(np.abs(times - float(np.asarray(t))))))
    return figure


class Canvas:
    """Draws a figure repeatedly; artists marked as animated in its Axes are drawn above everything else."""

    def __init__(self, figure: Figure, dpi: float | int):
        """Prepares to draw a figure with ``dpi`` dots per inch."""
        figure.set_dpi(dpi)
        self._canvas = FigureCanvasAgg(figure)
        self._canvas.draw()
        # Drawn once: every frame restores it, and draws only what moves.
        self._still = self._canvas.copy_from_bbox(figure.bbox)
        self._moving: list[Artist] = []
        for ax in figure.axes:
            moving = (artist for artist in ax.get_children() if artist.get_animated())
            self._moving += sorted(moving, key=Artist.get_zorder)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self._canvas.get_width_height()

    def picture(self) -> Pixels:
        """Returns the current figure as a picture."""
        self._canvas.restore_region(self._still)
        renderer = self._canvas.get_renderer()
        for artist in self._moving:
            # matplotlib computes the projection only when it draws the whole figure.
            if isinstance(artist, Poly3DCollection):
                artist.do_3d_projection()
            artist.draw(renderer)
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()


def gif(
    path: Path, pictures: Iterable[Pixels], fps: float | int, size: tuple[int, int], colours: Sequence[ColorType]
) -> None:
    """Writes pictures one by one as a GIF that repeats forever: a few colours, and of a frame only what changes.

    **Arguments:**

    - ``fps``: frames per second. A GIF counts in hundredths of a second, so frames may differ by one of these.
    - ``size``: width and height in pixels.
    - ``colours``: those of the drawing, on white.
    """
    table = palette_of(colours)
    palette, unchanged = table.ravel().tolist(), len(table)  # the colour after the last is transparent
    reference = Image.new("P", (1, 1))
    reference.putpalette(palette)
    shown: UInt8[np.ndarray, "height width"] | None = None
    with path.open("wb") as file:
        _write_header(file, size, table)
        for k, picture in enumerate(pictures):
            # Without dithering, in which still parts would change from frame to frame.
            frame = np.asarray(Image.fromarray(picture).quantize(palette=reference, dither=Image.Dither.NONE))
            corner, part = (0, 0), frame
            if shown is not None:
                changed = frame != shown
                rows, columns = _extent(changed.any(axis=1)), _extent(changed.any(axis=0))
                gaps = long_runs(~changed[rows, columns], SHORTEST_GAP)
                corner, part = (columns.start, rows.start), np.where(gaps, unchanged, frame[rows, columns])
            shown = frame
            image = Image.fromarray(part.astype(np.uint8))
            image.putpalette([*palette, 0, 0, 0])
            hundredths = round(100 * (k + 1) / fps) - round(100 * k / fps)  # so that the total duration is right
            options = {"duration": 10 * hundredths, "disposal": 1, "interlace": 0, "transparency": unchanged}
            file.writelines(getdata(image, corner, **options))
        file.write(b";")


def palette_of(colours: Sequence[ColorType]) -> UInt8[np.ndarray, "n 3"]:
    """Returns greys, and each colour with its tints; the first one is white."""
    hues = dict.fromkeys(to_rgb(colour) for colour in colours)
    shades = [(grey,) * 3 for grey in GREYS]
    for hue in hues:
        if np.ptp(hue) > 0:
            shades += [tuple(1 - strength * (1 - part) for part in hue) for strength in STRENGTHS]
    return np.round(255 * np.array(shades)).astype(np.uint8)


def _extent(changed: Bool[np.ndarray, " n"]) -> slice:
    """Returns the slice from the first change to the last; a single pixel where there is none, because a frame must
    have pixels.
    """
    indices = np.flatnonzero(changed)
    return slice(int(indices[0]), int(indices[-1]) + 1) if indices.size else slice(0, 1)


def long_runs(same: Bool[np.ndarray, "height width"], shortest: int) -> Bool[np.ndarray, "height width"]:
    """Returns where ``same`` is true in a run of at least ``shortest``, reading line after line."""
    flat = same.ravel()
    starts = np.flatnonzero(np.diff(flat, prepend=not flat[0]))
    lengths = np.diff(starts, append=flat.size)
    return np.repeat(flat[starts] & (lengths >= shortest), lengths).reshape(same.shape)


def _write_header(file: BinaryIO, size: tuple[int, int], palette: UInt8[np.ndarray, "n 3"]) -> None:
    """Writes the header before the frames: the size, a table of colours for all of them, and how often they are
    repeated.
    """
    bits = max(1, len(palette).bit_length())  # for the colours and a transparent one
    # 0xF0: a table of colours for all frames, of 2^bits entries, with 8 bits to a colour.
    file.write(b"GIF89a" + struct.pack("<HHBBB", *size, 0xF0 | bits - 1, 0, 0))
    file.write(palette.tobytes().ljust(3 * 2**bits, b"\0"))
    file.write(b"!\xff\x0bNETSCAPE2.0" + struct.pack("<BBHB", 3, 1, FOREVER, 0))


def has_ffmpeg() -> bool:
    """Returns whether ffmpeg is installed where matplotlib looks for it."""
    return FFMpegWriter.isAvailable()


def mp4(path: Path, pictures: Iterable[Pixels], fps: float | int, size: tuple[int, int]) -> None:
    """Writes pictures as a film.

    **Arguments:**

    - ``fps``: frames per second.
    - ``size``: width and height of the frames in pixels; a row or a column of white is added to an odd number.

    **Raises:** :class:`~jaxball.files.results.OutputError` with ffmpeg's own message if it fails.
    """
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{size[0]}x{size[1]}", "-framerate", str(fps), "-i", "pipe:"]
    coded = ["-c:v", "libx264", "-preset", "slow", "-tune", "animation", "-crf", str(QUALITY), "-pix_fmt", PIXELS]
    command = [FFMpegWriter.bin_path(), "-loglevel", "error", "-y", *raw, "-vf", EVEN, *coded]
    # Messages go to a file: a pipe that nobody reads would fill up, and ffmpeg wait for ever.
    with tempfile.TemporaryFile() as said:
        # An interrupt in the terminal would go to ffmpeg as well, which would then finish half a film.
        with block_in_children():
            process = subprocess.Popen(
                [*command, "-movflags", "+faststart", str(path)], stdin=subprocess.PIPE, stdout=said, stderr=said
            )
        assert process.stdin is not None
        stdin = process.stdin
        # Otherwise it would finish the file of a command that was interrupted.
        with on_interrupt(process.kill):
            complete = False
            try:
                with contextlib.suppress(BrokenPipeError):  # ffmpeg has ended, and says why
                    for picture in pictures:
                        stdin.write(np.ascontiguousarray(picture).data)
                    stdin.close()
                    complete = True
                process.wait()
            finally:
                process.kill()
                process.wait()
                # What is left in the buffer cannot be written any more.
                with contextlib.suppress(BrokenPipeError):
                    stdin.close()
        if process.returncode or not complete:
            said.seek(0)
            reason = said.read().decode(errors="replace").strip().splitlines() or ["it did not say why"]
            raise OutputError(
                f"ffmpeg must be able to make an MP4 with libx264, but it stopped: {reason[-1]}; "
                "install one that has it, or write a .gif."
            )
