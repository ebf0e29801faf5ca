"""The axes of a chart over two numbers of a scenario, as the command line names them."""

import argparse
import math
from typing import NamedTuple

from .options import BadInputError

MOST_VALUES = 10_000  # of one number
METAVAR = "PATH=FROM:TO:COUNT"


class Axis(NamedTuple):
    """An axis of a chart: so many ``values`` of the number at ``path``, equally spaced from ``low`` to ``high``."""

    path: str
    low: float
    high: float
    values: int


def axes_of(options: argparse.Namespace) -> tuple[Axis, Axis]:
    """The two axes of --chart.

    **Raises:** :class:`BadInputError` for a malformed axis, and for the same number twice.
    """
    first, second = map(_axis, options.chart)
    if first.path == second.path:
        raise BadInputError(f"Argument `--chart` must name two numbers, but it names `{first.path}` twice.")
    return first, second


def _axis(text: str) -> Axis:
    path, _, values = text.partition("=")
    parts = values.split(":")
    try:
        low, high, count = float(parts[0]), float(parts[1]), int(parts[2])
    except (ValueError, IndexError):
        low, high, count = math.nan, math.nan, 0
    if len(parts) != 3 or not math.isfinite(low + high) or low == high or not 2 <= count <= MOST_VALUES:
        raise BadInputError(
            f"Argument `--chart` must be {METAVAR}, with two different numbers and a count from 2 to "
            f"{MOST_VALUES:,}, such as 'initial.Omega[0]=0:3:30', but it is \"{text}\"."
        )
    return Axis(path.strip(), low, high, count)
