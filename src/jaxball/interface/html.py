"""The ``_repr_html_`` of objects, for notebooks: their text, with the path of a run beside it, in a few kilobytes."""

import html

import numpy as np
from jaxtyping import Float

SIZE = 140  # of a sketch, in pixels
MARGIN = 6
MOST_POINTS = 400
LEAST_EXTENT = 1e-9  # of the size of its coordinates, below which a path is a point


def repr_html(self: object) -> str:
    """Returns the ``_repr_html_`` of a class whose ``repr`` has a headline and indented lines."""
    return as_html(repr(self))


def as_html(text: str, sketch: str = "") -> str:
    """Formats a headline in bold and the lines below it, with a sketch to the right."""
    head, _, lines = text.partition("\n")
    body = f'<pre style="margin:0;white-space:pre-wrap"><b>{html.escape(head)}</b>\n{html.escape(lines)}</pre>'
    return f'<div style="display:flex;gap:1.5em;align-items:flex-start">{body}{sketch}</div>'


def sketch_of(points: Float[np.ndarray, "n 2"], name: str) -> str:
    """Draws a path as SVG, with a dot where it ends and the same scale along both axes; empty if it is a point.

    - ``name``: what it shows, for readers of the screen.
    """
    points = points[np.isfinite(points).all(axis=1)]
    points = points[:: max(1, -(-len(points) // MOST_POINTS))] if len(points) else points
    extent = float(np.max(np.ptp(points, axis=0), initial=0.0)) if len(points) else 0.0
    if len(points) < 2 or extent <= LEAST_EXTENT * np.max(np.abs(points)):
        return ""
    scale = (SIZE - 2 * MARGIN) / extent
    low, high = points.min(axis=0), points.max(axis=0)
    width, height = np.ceil((high - low) * scale + 2 * MARGIN).astype(int)
    x = MARGIN + (points[:, 0] - low[0]) * scale
    y = MARGIN + (high[1] - points[:, 1]) * scale  # upwards, as in a figure
    line = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    return (
        f'<svg width="{width}" height="{height}" role="img" aria-label="{html.escape(name, quote=True)}">'
        f'<polyline points="{line}" fill="none" stroke="currentColor" stroke-width="1.2"/>'
        f'<circle cx="{x[-1]:.1f}" cy="{y[-1]:.1f}" r="3" fill="currentColor"/></svg>'
    )
