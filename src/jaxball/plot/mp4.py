"""MP4 films, made by ffmpeg."""

import contextlib
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from matplotlib.animation import FFMpegWriter

from ..interface.interruption import blocked_in_children, on_interrupt
from ..interface.output import OutputError
from .canvas import Picture

QUALITY = 26  # of libx264, where 0 is exact and 51 the worst
EVEN = "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white"  # the chroma of a film has half the resolution of its luma
PIXELS = "yuv420p"  # which every player can show


def has_ffmpeg() -> bool:
    """Whether ffmpeg is installed where matplotlib looks for it."""
    return FFMpegWriter.isAvailable()


@contextlib.contextmanager
def mp4(path: Path, fps: float | int, size: tuple[int, int]) -> Iterator[Callable[[Picture], object]]:
    """A film; yields a function that adds a frame to it.

    **Arguments:**

    - ``fps``: frames per second.
    - ``size``: width and height of the frames in pixels; a row or a column of white is added to an odd number.

    **Raises:** :class:`~jaxball.results.OutputError` with ffmpeg's own message if it fails.
    """
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{size[0]}x{size[1]}", "-framerate", str(fps), "-i", "pipe:"]
    coded = ["-c:v", "libx264", "-preset", "slow", "-tune", "animation", "-crf", str(QUALITY), "-pix_fmt", PIXELS]
    command = [FFMpegWriter.bin_path(), "-loglevel", "error", "-y", *raw, "-vf", EVEN, *coded]
    with tempfile.TemporaryFile() as said:
        with blocked_in_children():
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
                    yield lambda picture: stdin.write(np.ascontiguousarray(picture).data)
                    stdin.close()
                    complete = True
                process.wait()
            finally:
                process.kill()
                process.wait()
                with contextlib.suppress(BrokenPipeError):
                    stdin.close()
        if process.returncode or not complete:
            said.seek(0)
            reason = said.read().decode(errors="replace").strip().splitlines() or ["it did not say why"]
            raise OutputError(
                f"ffmpeg must be able to make an MP4 with libx264, but it stopped: {reason[-1]}; "
                "install one that has it, or write a .gif."
            )
