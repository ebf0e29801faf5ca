"""Lines and faces that move from frame to frame, in space or in the plane of a disk.

matplotlib calls them animated: :mod:`.canvas` draws them on a picture of everything that does not move.
"""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection


def line(ax: Axes, animated: bool = True, **look) -> Line2D:
    """A line that has no points yet."""
    empty = [[]] * (3 if isinstance(ax, Axes3D) else 2)
    return ax.plot(*empty, animated=animated, **look)[0]


def move(artist: Line2D, points: Float[np.ndarray, "points 3"]) -> None:
    """Moves a line to ``points``; in a plane figure, to their first and third coordinates."""
    if isinstance(artist.axes, Axes3D):
        artist.set_data_3d(*points.T)  # pyright: ignore[reportAttributeAccessIssue]
    else:
        artist.set_data(points[:, 0], points[:, 2])


def face(ax: Axes3D, edgecolor: str = "none", animated: bool = True, **look) -> Poly3DCollection:
    """A polygon in space that has no corners yet."""
    polygon = Poly3DCollection([np.zeros((3, 3))], edgecolor=edgecolor, animated=animated, **look)
    ax.add_collection3d(polygon)
    return polygon
