"""Figures, and Axes of a figure of their own, that a notebook shows where a cell ends in them.

They need no backend of matplotlib's, are not registered with pyplot, and change no setting: IPython asks an object for
``_repr_png_`` where nothing else is registered for its class.
"""

import io
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D


class ShownFigure(Figure):
    """A figure that a notebook shows."""

    def _repr_png_(self) -> bytes:
        return _png(self)


class ShownAxes(Axes):
    """Plane Axes whose figure a notebook shows."""

    def _repr_png_(self) -> bytes:
        return _png(self.figure)


class ShownAxes3D(Axes3D):
    """Three-dimensional Axes whose figure a notebook shows."""

    def _repr_png_(self) -> bytes:
        return _png(self.figure)


def _png(figure: Any) -> bytes:
    stream = io.BytesIO()
    # Not that of a user's settings for files: as large as on a screen.
    figure.savefig(stream, format="png", dpi=figure.dpi)
    return stream.getvalue()
