"""Small animated GIFs of line drawings: a few colours for all frames, and only the changed part of each frame."""

import contextlib
import struct
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np
from jaxtyping import Bool, UInt8
from matplotlib.colors import to_rgb
from matplotlib.typing import ColorType
from PIL import Image
from PIL.GifImagePlugin import getdata

from .canvas import Picture

GREYS = (1.0, 0.965, 0.9, 0.8, 0.7, 0.6, 0.45, 0.25, 0.0)
STRENGTHS = (1.0, 0.66, 0.33)  # of a colour over white, for antialiased edges
SHORTEST = 8  # pixels; a gap between changes that is shorter is written too, which compresses better
FOREVER = 0


@contextlib.contextmanager
def gif(
    path: Path, fps: float | int, size: tuple[int, int], colours: Sequence[ColorType]
) -> Iterator[Callable[[Picture], None]]:
    """A GIF that repeats forever; yields a function that adds a frame to it.

    **Arguments:**

    - ``fps``: frames per second. A GIF counts in hundredths of a second, so frames may differ by one of these.
    - ``size``: width and height in pixels.
    - ``colours``: those of the drawing, on white.
    """
    palette = palette_of(colours)
    with path.open("wb") as file:
        _write_header(file, size, palette)
        writer = _Writer(file, fps, palette)
        yield writer.add
        file.write(b";")


def palette_of(colours: Sequence[ColorType]) -> UInt8[np.ndarray, "n 3"]:
    """Greys, and each colour with its tints; the first one is white."""
    hues = dict.fromkeys(to_rgb(colour) for colour in colours)
    shades = [(grey,) * 3 for grey in GREYS]
    shades += [_tint(hue, strength) for hue in hues if np.ptp(hue) > 0 for strength in STRENGTHS]
    return np.round(255 * np.array(shades)).astype(np.uint8)


def _tint(hue: tuple[float, ...], strength: float) -> tuple[float, ...]:
    return tuple(1 - strength * (1 - part) for part in hue)


class _Writer:
    """The frames of a GIF, one after the other."""

    def __init__(self, file: BinaryIO, fps: float | int, palette: UInt8[np.ndarray, "n 3"]):
        self._file, self._fps, self._count = file, fps, 0
        self._colours = palette.ravel().tolist()
        self._unchanged = len(palette)  # the index of the colour that is transparent
        self._reference = Image.new("P", (1, 1))
        self._reference.putpalette(self._colours)
        self._shown: UInt8[np.ndarray, "height width"] | None = None

    def add(self, picture: Picture) -> None:
        quantised = Image.fromarray(picture).quantize(palette=self._reference, dither=Image.Dither.NONE)
        frame = np.asarray(quantised)
        corner, part = (0, 0), frame
        if self._shown is not None:
            changed = frame != self._shown
            rows, columns = _extent(changed.any(axis=1)), _extent(changed.any(axis=0))
            kept = long_runs(~changed[rows, columns], SHORTEST)
            corner, part = (columns.start, rows.start), np.where(kept, self._unchanged, frame[rows, columns])
        self._shown = frame
        image = Image.fromarray(part.astype(np.uint8))
        image.putpalette([*self._colours, 0, 0, 0])
        options = {"duration": 10 * self._hundredths(), "disposal": 1, "interlace": 0, "transparency": self._unchanged}
        self._file.writelines(getdata(image, corner, **options))

    def _hundredths(self) -> int:
        """The duration of the next frame, so that the total duration is right."""
        self._count += 1
        return round(100 * self._count / self._fps) - round(100 * (self._count - 1) / self._fps)


def _extent(changed: Bool[np.ndarray, " n"]) -> slice:
    """From the first change to the last; a single pixel where there is none, because a frame must have pixels."""
    at = np.flatnonzero(changed)
    return slice(int(at[0]), int(at[-1]) + 1) if at.size else slice(0, 1)


def long_runs(same: Bool[np.ndarray, "height width"], shortest: int) -> Bool[np.ndarray, "height width"]:
    """Where ``same`` is true in a run of at least ``shortest``, reading line after line."""
    flat = same.ravel()
    starts = np.flatnonzero(np.diff(flat, prepend=not flat[0]))
    lengths = np.diff(starts, append=flat.size)
    return np.repeat(flat[starts] & (lengths >= shortest), lengths).reshape(same.shape)


def _write_header(file: BinaryIO, size: tuple[int, int], palette: UInt8[np.ndarray, "n 3"]) -> None:
    """The header before the frames: the size, a table of colours for all of them, and how often they are repeated."""
    bits = max(1, len(palette).bit_length())  # for the colours and a transparent one
    file.write(b"GIF89a" + struct.pack("<HHBBB", *size, 0xF0 | bits - 1, 0, 0))
    file.write(palette.tobytes().ljust(3 * 2**bits, b"\0"))
    file.write(b"!\xff\x0bNETSCAPE2.0" + struct.pack("<BBHB", 3, 1, FOREVER, 0))
