"""The options of the animation that ``jaxball simulate --animate`` makes."""

import argparse
import re
import shutil
from pathlib import Path

from ..interface.output import OutputError, check_destination
from .options import count, number, positive

SUFFIXES = (".mp4", ".gif")
MOST_FRAMES_A_SECOND = {
    ".mp4": 240,
    ".gif": 50,
}  # a GIF counts in hundredths of a second; players ignore delays of a single one
SMALLEST, LARGEST = 64, 7680
OPTIONS = ("fps", "speed", "size", "from", "to")


def add_animation(parser: argparse.ArgumentParser) -> None:
    """Adds --animate and its options."""
    parser.add_argument("--animate", type=Path, metavar="FILE", help="write an animation: .mp4 or .gif")
    parser.add_argument("--fps", type=count, help="frames per second of the animation (default: 30, or 20 in a GIF)")
    parser.add_argument("--speed", type=positive, help="units of time per second of the animation (default: 1)")
    parser.add_argument("--size", type=_size, metavar="WIDTHxHEIGHT", help="its size in pixels, as in 1280x720")
    parser.add_argument("--from", type=number, metavar="T", help="start of the animation (default: that of the run)")
    parser.add_argument("--to", type=number, metavar="T", help="end of the animation (default: that of the run)")


def check_animation(options: argparse.Namespace) -> None:
    """Raises an :class:`~jaxball.results.OutputError` for an animation that is impossible for any run."""
    if options.animate is None:
        for name in OPTIONS:
            if getattr(options, name) is not None:
                raise OutputError(f"Argument `--{name}` is for an animation; give --animate FILE with it.")
        return
    check_destination(options.animate, SUFFIXES, "--animate")
    suffix = options.animate.suffix
    if suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise OutputError(
            f'Argument `--animate` must end in .gif where ffmpeg is not installed, but it is "{options.animate}"; '
            "install ffmpeg, or make a .gif."
        )
    if options.fps is not None and options.fps > MOST_FRAMES_A_SECOND[suffix]:
        raise OutputError(
            f"Argument `--fps` must be at most {MOST_FRAMES_A_SECOND[suffix]} for {suffix}, but it is {options.fps}."
        )


def _size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    size = (int(match[1]), int(match[2])) if match else (0, 0)
    if not all(SMALLEST <= side <= LARGEST for side in size):
        raise argparse.ArgumentTypeError(
            f"it must be WIDTHxHEIGHT in pixels, each from {SMALLEST} to {LARGEST}, as in 1280x720, but it is {text}"
        )
    return size
