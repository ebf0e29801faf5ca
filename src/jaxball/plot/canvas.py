"""Pictures of a figure in which a few things move: everything else is drawn once."""

import numpy as np
from jaxtyping import UInt8
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

Picture = UInt8[np.ndarray, "height width 3"]


class Canvas:
    """Draws a figure repeatedly; artists marked as animated in its Axes are drawn above everything else."""

    def __init__(self, figure: Figure, dpi: float | int):
        """``dpi``: dots per inch."""
        figure.set_dpi(dpi)
        self._canvas = FigureCanvasAgg(figure)
        self._canvas.draw()
        self._still = self._canvas.copy_from_bbox(figure.bbox)
        self._moving: list[Artist] = []
        for ax in figure.axes:
            moving = (artist for artist in ax.get_children() if artist.get_animated())
            self._moving += sorted(moving, key=Artist.get_zorder)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self._canvas.get_width_height()

    def picture(self) -> Picture:
        """The current figure."""
        self._canvas.restore_region(self._still)
        renderer = self._canvas.get_renderer()
        for artist in self._moving:
            if isinstance(artist, Poly3DCollection):
                artist.do_3d_projection()
            artist.draw(renderer)
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()
