"""Where the texts and the curves of a drawn figure are, in pixels, by matplotlib's own measure."""

import itertools
from typing import NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

BACKGROUND = 0.6  # points; lines that are thinner are a wireframe, which a name with a halo may cross
HAIR = 0.5  # pixels


class Box(NamedTuple):
    """A text and its rectangle."""

    text: str
    x0: float
    y0: float
    x1: float
    y1: float


def boxes(figure):
    """The rectangles of all texts that are drawn."""
    renderer = FigureCanvasAgg(figure).get_renderer()
    for artist in figure.findobj(lambda artist: artist.get_animated()):
        artist.set_animated(False)  # which only says that it is drawn apart
    figure.draw(renderer)
    axes, drawn = [], []
    for ax in figure.axes:
        of_ax = [ax.xaxis, ax.yaxis, *([ax.zaxis] if hasattr(ax, "zaxis") else [])]
        axes += of_ax
        drawn += of_ax if getattr(ax, "_axis3don", True) and ax.axison else []
    shown = [label for axis in drawn for tick in axis._update_ticks() for label in (tick.label1, tick.label2)]
    every = [label for axis in axes for tick in axis.get_major_ticks() for label in (tick.label1, tick.label2)]
    every += [label for axis in axes for tick in axis.get_minor_ticks() for label in (tick.label1, tick.label2)]
    hidden = {id(label) for label in every} - {id(label) for label in shown}
    figure.draw(renderer)  # because asking for the ticks that are shown moves those of axes in space
    texts = []
    for text in figure.findobj(Text):
        if text.get_visible() and text.get_text().strip() and id(text) not in hidden:
            # That of an annotation would have its anchor in it.
            texts.append(Box(text.get_text(), *Text.get_window_extent(text, renderer).extents))
    return texts


def overlaps(figure):
    """The pairs of texts that lie on one another, and texts that leave the page or lie on a curve or on a mark."""
    texts, (width, height) = boxes(figure), figure.bbox.size
    faults = [
        (a.text, b.text)
        for a, b in itertools.combinations(texts, 2)
        if min(a.x1, b.x1) - max(a.x0, b.x0) > HAIR and min(a.y1, b.y1) - max(a.y0, b.y0) > HAIR
    ]
    for box in texts:
        if box.x0 < -HAIR or box.y0 < -HAIR or box.x1 > width + HAIR or box.y1 > height + HAIR:
            faults.append((box.text, "the edge of the page"))
    for ax in figure.axes:
        for k, points in enumerate(_curves(ax)):
            for box in texts:
                inside = (points > [box.x0 + HAIR, box.y0 + HAIR]) & (points < [box.x1 - HAIR, box.y1 - HAIR])
                if np.any(np.all(inside, axis=1)):
                    faults.append((box.text, f"curve {k}"))
    return faults


def _curves(ax):
    """Points of every curve and mark of an Axes, a pixel apart; those that are cut off at its edges left out."""
    pixel = ax.figure.dpi / 72
    for line in ax.lines:
        # A line in space has its projection as data once it is drawn.
        points = line.get_transform().transform(np.asarray(line.get_xydata(), dtype=float))
        points_drawn = []
        if line.get_linestyle() != "None" and line.get_linewidth() >= BACKGROUND:
            points_drawn += [between(a, b) for a, b in itertools.pairwise(points) if np.all(np.isfinite([a, b]))]
        if line.get_marker() not in ("None", None):
            half = line.get_markersize() / 2 * pixel
            corners = half * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
            points_drawn += [point + corners for point in points if np.all(np.isfinite(point))]
        if points_drawn:
            points_drawn, box = np.concatenate(points_drawn), ax.bbox
            within = np.all((points_drawn >= box.min - HAIR) & (points_drawn <= box.max + HAIR), axis=1)
            yield points_drawn[within] if line.get_clip_on() and not hasattr(ax, "zaxis") else points_drawn
    for patch in ax.patches:
        for outline in patch.get_transform().transform_path(patch.get_path()).to_polygons():
            yield np.concatenate([between(a, b) for a, b in itertools.pairwise(outline)])


def between(a, b):
    """Points from ``a`` to ``b``, a pixel apart."""
    return np.linspace(a, b, int(np.ceil(np.linalg.norm(b - a))) + 1)
