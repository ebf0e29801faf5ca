"""Labels of points, such as the names of masses in ``space``, placed so that they hide as little as possible."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.text import Annotation, Text
from mpl_toolkits.mplot3d import Axes3D, proj3d

from .style import SMALL_FONT

DIRECTIONS, DISTANCES = 24, (2.0, 5.0, 9.0, 14.0, 20.0, 28.0, 38.0, 50.0)  # in points, from the edge of the mark
LEADER = 15.0  # a name farther than this from its mark is connected to it by a line
FIRST_ANGLE = np.pi / 4  # upwards to the right, where a reader looks first
PADDING = 1.5  # points around a name
SPACING = 1.0  # points between the samples of a curve
FAINT_LINE = 0.6  # a line thinner than this, in points, counts as background, which a name may cross
OUTSIDE, ON_A_NAME, ON_A_MARK, ON_A_CURVE, ON_A_BACKGROUND, FAR, TURNED = 1e4, 300.0, 300.0, 30.0, 0.02, 0.15, 0.05


class Names(Artist):
    """Names of points in an Axes, each placed beside its point whenever the figure is drawn.

    This artist draws nothing: it comes before the texts and moves them once sizes and projections are known.
    """

    def __init__(self, ax: Axes, points: Float[np.ndarray, "n d"], texts: Sequence[Annotation], room: float):
        super().__init__()
        # Before all others, because it moves them.
        self.set_zorder(-np.inf)
        self.set_in_layout(False)
        self._ax, self._points, self._texts, self._room = ax, points, texts, room

    def draw(self, renderer: Any) -> None:
        """Moves the names."""
        point = renderer.points_to_pixels(1.0)
        anchors = _on_the_page(self._ax, self._points)
        # Of the text alone: the extent of an annotation would include its anchor.
        boxes = [Text.get_window_extent(text, renderer) for text in self._texts]
        sizes = np.array([(box.width, box.height) for box in boxes]) / point
        curves, faint, marks = (points / point for points in _obstacles(self._ax))
        width, height = self._ax.figure.bbox.size / point
        centres = places(anchors / point, sizes, curves, marks, faint, (width, height), self._room)
        data = self._ax.transData.inverted().transform(anchors)
        shifts = centres - anchors / point
        distances = np.linalg.norm(np.maximum(np.abs(shifts) - sizes / 2, 0.0), axis=1) - self._room
        for text, anchor, shift, distance in zip(self._texts, data, shifts, distances, strict=True):
            text.xy = tuple(anchor)
            text.set_position(tuple(shift))
            assert text.arrow_patch is not None
            text.arrow_patch.set_visible(bool(distance > LEADER))


def name_points(
    ax: Axes, points: Float[np.ndarray, "n d"], names: Sequence[str], colours: Sequence[str], room: float, **look: Any
) -> None:
    """Writes a name beside each point, away from curves, marks and other names.

    **Arguments:**

    - ``points``: in the coordinates of ``ax``, two or three to a point.
    - ``room``: the radius of the mark at each point, in points of the page.
    - ``look``: of the texts, as for ``ax.text``.
    """
    options: dict[str, Any] = {
        "xytext": (0.0, 0.0),
        "textcoords": "offset points",
        "ha": "center",
        "va": "center",
        "fontproperties": SMALL_FONT,
        "annotation_clip": False,
    }
    start = tuple(np.asarray(points)[0, :2]) if len(points) else (0.0, 0.0)
    texts = []
    for name, colour in zip(names, colours, strict=True):
        line = {"arrowstyle": "-", "linewidth": 0.5, "color": colour, "shrinkA": 0.0, "shrinkB": room}
        texts.append(ax.annotate(name, start, **(options | look), color=colour, arrowprops=line))
        # Annotations in the layout would shrink the Axes for names that are to be placed in them.
        texts[-1].set_in_layout(False)
    if texts:
        ax.add_artist(Names(ax, np.asarray(points), texts, room))


def places(
    anchors: Float[np.ndarray, "n 2"],
    sizes: Float[np.ndarray, "n 2"],
    curves: Float[np.ndarray, "curve 2"],
    marks: Float[np.ndarray, "mark 2"],
    background: Float[np.ndarray, "background 2"],
    page: tuple[float, float],
    room: float,
) -> Float[np.ndarray, "n 2"]:
    """Returns the centres of names beside their anchors, chosen so that they hide as little as possible.

    All lengths are in points of the page. Each name has candidates around its anchor; names choose in turn, the most
    crowded one first, repeatedly until none would move. The result is deterministic.

    **Arguments:**

    - ``anchors``, ``sizes``: the points that are named, and the widths and heights of the names.
    - ``curves``, ``marks``, ``background``: points that a name should not hide, background the least.
    - ``page``: width and height of the page, which no name should leave.
    - ``room``: the radius of the mark at an anchor.
    """
    options = np.stack([_candidates(anchor, size, room) for anchor, size in zip(anchors, sizes, strict=True)])
    halves = sizes[:, None, :] / 2 + PADDING
    low, high = options - halves, options + halves
    out = np.maximum(0.0, -low) + np.maximum(0.0, high - np.asarray(page))
    # The farther a direction is from the first, the more it costs.
    turned = np.minimum(np.arange(DIRECTIONS), DIRECTIONS - np.arange(DIRECTIONS))  # from the first direction
    costs = OUTSIDE * out.sum(axis=2) + np.add.outer(FAR * np.asarray(DISTANCES), TURNED * turned).ravel()
    for points, weight in ((curves, ON_A_CURVE), (marks, ON_A_MARK), (background, ON_A_BACKGROUND)):
        costs += weight * _counts(low, high, points)
    chosen = np.argmin(costs, axis=1)
    # Choices can run in a circle, in which two names give way to each other; ten rounds are enough in practice.
    for _ in range(10):
        before = chosen.copy()
        # The one that stands worst chooses first; a stable order makes the figure the same every time.
        for i in np.argsort(-costs[np.arange(len(chosen)), chosen], kind="stable"):
            others = np.arange(len(chosen)) != i
            k = np.arange(len(chosen))[others], chosen[others]
            overlap = np.minimum(high[i][:, None], high[k][None]) - np.maximum(low[i][:, None], low[k][None])
            # Both count: any overlap at all, so that names keep off each other, and its area, so that less is better.
            area = np.prod(np.maximum(overlap, 0.0), axis=2)
            chosen[i] = np.argmin(costs[i] + ON_A_NAME * ((area > 0) + area).sum(axis=1))
        if np.array_equal(before, chosen):
            break
    return options[np.arange(len(chosen)), chosen]


def _candidates(
    anchor: Float[np.ndarray, "2"], size: Float[np.ndarray, "2"], room: float
) -> Float[np.ndarray, "candidates 2"]:
    """Centres around an anchor, nearest distance first, so that the edge of the name is that far from the mark."""
    angles = FIRST_ANGLE + 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    towards = np.column_stack([np.cos(angles), np.sin(angles)])
    # The direction leaves the box of the name on its edge: at the middle of a side, and at corners for diagonals.
    beside = np.clip(np.sqrt(2.0) * towards, -1.0, 1.0) * size / 2
    return np.concatenate([anchor + (room + distance) * towards + beside for distance in DISTANCES])


def _counts(
    low: Float[np.ndarray, "n candidates 2"],
    high: Float[np.ndarray, "n candidates 2"],
    points: Float[np.ndarray, "m 2"],
) -> Float[np.ndarray, "n candidates"]:
    """Counts the points that lie in each box."""
    counts = np.zeros(low.shape[:2])
    for i in range(len(low)):
        # Most points are in none of the candidates; this leaves a few for the large comparison.
        near = points[np.all((points >= low[i].min(axis=0)) & (points <= high[i].max(axis=0)), axis=1)]
        inside = np.all((near >= low[i][:, None]) & (near <= high[i][:, None]), axis=2)
        counts[i] = np.sum(inside, axis=1)
    return counts


def _on_the_page(ax: Axes, points: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n 2"]:
    """Returns points in pixels from the lower left corner of the figure."""
    if isinstance(ax, Axes3D):
        x, y, _ = proj3d.proj_transform(*np.asarray(points).T, ax.get_proj())  # pyright: ignore[reportCallIssue]
        points = np.column_stack([x, y])
    return ax.transData.transform(points)


def _obstacles(ax: Axes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Samples in pixels of the curves of an Axes, of those in its background, and of its marks."""
    kinds: tuple[list[np.ndarray], ...] = ([], [], [])
    pixel = ax.figure.dpi / 72  # pixels to a point
    for line in ax.lines:
        if not line.get_visible():
            continue
        points = _points_of(ax, line)
        if line.get_linestyle() not in ("None", "none", ""):
            faint = line.get_linewidth() < FAINT_LINE
            kinds[1 if faint else 0].append(_sample_curve(points, SPACING * pixel))
        if line.get_marker() not in ("None", "none", "", None):
            kinds[2].append(_disc(points, line.get_markersize() / 2 * pixel, SPACING * pixel))
    for patch in ax.patches:
        outlines = patch.get_transform().transform_path(patch.get_path()).to_polygons()
        kinds[0].extend(_sample_curve(np.asarray(outline), SPACING * pixel) for outline in outlines)
    curves, background, marks = (np.concatenate([np.zeros((0, 2)), *points]) for points in kinds)
    return curves, background, marks


def _points_of(ax: Axes, line: Line2D) -> Float[np.ndarray, "n 2"]:
    if isinstance(ax, Axes3D):
        return _on_the_page(ax, np.column_stack(line.get_data_3d()))  # pyright: ignore[reportAttributeAccessIssue]
    return line.get_transform().transform(np.asarray(line.get_xydata(), dtype=float))


def _sample_curve(points: Float[np.ndarray, "n 2"], spacing: float) -> Float[np.ndarray, "m 2"]:
    """Samples a curve at points no farther apart than ``spacing``; it has gaps where it is not finite."""
    if len(points) < 2:
        return points[np.all(np.isfinite(points), axis=1)]
    start, step = points[:-1], np.diff(points, axis=0)
    whole = np.all(np.isfinite(step), axis=1)
    start, step = start[whole], step[whole]
    counts = np.ceil(np.linalg.norm(step, axis=1) / spacing).astype(int) + 1
    which = np.repeat(np.arange(len(counts)), counts)
    # The index within each piece: counted from where the piece starts.
    along = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
    return start[which] + step[which] * (along / counts[which])[:, None]


def _disc(points: Float[np.ndarray, "n 2"], radius: float, spacing: float) -> Float[np.ndarray, "m 2"]:
    """Returns points that fill a mark."""
    points = points[np.all(np.isfinite(points), axis=1)]
    steps = np.arange(-radius, radius + spacing, spacing)
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    grid = grid[np.linalg.norm(grid, axis=1) <= radius]
    return (points[:, None] + grid).reshape(-1, 2)
