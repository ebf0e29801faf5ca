"""The plane: tilted, and with a turntable in it."""

import numpy as np
from matplotlib.figure import Figure
from sketch import BODY, FORCE, INK, PAPER, SHELL, SMALL, Camera, arc, arrow, canvas, circle, dot, line, word

SEEN = Camera(azimuth=-62.0, elevation=20.0)
TILT, HEADING = np.radians([24.0, 35.0])


def draw() -> Figure:
    figure = Figure(figsize=(7.8, 3.2), layout="constrained")
    draw_slope(canvas(figure, 121))
    draw_turntable(canvas(figure, 122))
    return figure


def draw_slope(ax) -> None:
    down, across = np.array([np.cos(TILT), 0.0, -np.sin(TILT)]), np.array([0.0, 1.0, 0.0])
    axes = np.stack(
        [
            np.cos(HEADING) * down - np.sin(HEADING) * across,
            np.sin(HEADING) * down + np.cos(HEADING) * across,
            np.cross(down, across),
        ]
    )
    sheet = [s * 1.7 * down + q * 1.25 * across for s, q in [(-1, -1), (1, -1), (1, 1), (-1, 1)]]
    low = [[corner[0], corner[1], -1.7 * np.sin(TILT)] for corner in sheet]
    ax.fill(*SEEN([low[0], low[1], sheet[0]]).T, color="0.88")
    ax.fill(*SEEN(sheet).T, color=PAPER)
    toe = np.array(sheet[1])
    line(ax, SEEN([low[0], toe]), "0.6", linewidth=0.8)
    line(ax, SEEN(arc(toe, 0.8, np.pi, np.pi - TILT, (1, 0, 0), (0, 0, 1))), INK)
    word(ax, SEEN(toe + 1.02 * np.array([-np.cos(TILT / 2), 0, np.sin(TILT / 2)])), "$a$")
    place = -0.55 * down + 0.1 * across
    centre = place + 0.42 * axes[2]
    line(ax, circle(SEEN(centre), 0.42), SHELL, linewidth=1.4)
    dot(ax, SEEN(centre))
    for k, axis in enumerate(axes):
        tip = SEEN(centre + 0.95 * axis)
        shift = 0.13 * (tip - SEEN(centre)) / np.linalg.norm(tip - SEEN(centre))
        arrow(ax, SEEN(centre), tip, BODY, rf"$\mathbf{{e}}_{k + 1}$", shift, linewidth=1.0)
    foot = 0.45 * down - 0.5 * across
    line(ax, SEEN([foot, foot + 0.75 * axes[0]]), BODY, linewidth=0.8, linestyle=(0, (4, 2)))
    arrow(ax, SEEN(foot), SEEN(foot + 0.9 * down), INK, linewidth=1.2)
    word(ax, np.add(SEEN(foot + 1.0 * down), (0.12, -0.12)), "descent", fontproperties=SMALL)
    line(ax, SEEN(arc(foot, 0.5, 0.0, HEADING, axes[0], axes[1])), INK)
    word(ax, SEEN(foot + 0.66 * (np.cos(HEADING / 2) * axes[0] + np.sin(HEADING / 2) * axes[1])), "$b$")
    arrow(ax, SEEN(centre), SEEN(centre) - (0.0, 0.8), FORCE, r"$\mathbf{g}$", (0.12, 0.02))
    ax.set_title("slope: tilt $a$, heading $b$ of the descent", fontproperties=SMALL, pad=14)


def draw_turntable(ax) -> None:
    sheet = [(-1.9, -1.6, 0), (1.9, -1.6, 0), (1.9, 1.6, 0), (-1.9, 1.6, 0)]
    ax.fill(*SEEN(sheet).T, color=PAPER)
    table = SEEN(circle((0, 0, 0), 1.4, (1, 0, 0), (0, 1, 0)))
    ax.fill(*table.T, color="0.86")
    line(ax, table, "0.6", linewidth=0.8)
    centre, place = np.zeros(3), np.array([1.0, -0.25, 0.0])
    dot(ax, SEEN(centre))
    word(ax, np.add(SEEN(centre), (-0.12, -0.1)), r"$\mathbf{c}$")
    turning = SEEN(arc(centre, 1.15, np.radians(150), np.radians(215), (1, 0, 0), (0, 1, 0)))
    line(ax, turning, INK, linewidth=1.3)
    arrow(ax, turning[-2], turning[-1], INK, "$W$", (0.06, -0.14))
    line(ax, SEEN([centre, place]), "0.5", linewidth=0.8, linestyle=(0, (4, 2)))
    word(ax, np.add(SEEN(0.4 * place), (-0.02, -0.16)), r"$\mathbf{z}-\mathbf{c}$", "0.3")
    velocity = 0.9 * np.cross([0, 0, 1], place)
    arrow(ax, SEEN(place), SEEN(place + velocity), FORCE, r"$\mathbf{u}$", (0.14, 0.06))
    gc = place + np.array([0, 0, 0.42])
    line(ax, circle(SEEN(gc), 0.42), SHELL, linewidth=1.4)
    dot(ax, SEEN(gc))
    dot(ax, SEEN(place))
    word(ax, np.add(SEEN(place), (0.06, -0.16)), "CP", fontproperties=SMALL)
    origin = np.array([-1.55, -1.2, 0.0])
    for k, axis in enumerate(np.eye(3)):
        tip = SEEN(0.5 * axis)
        arrow(
            ax,
            SEEN(origin),
            SEEN(origin) + tip,
            BODY,
            rf"$\mathbf{{e}}_{k + 1}$",
            0.12 * tip / np.linalg.norm(tip),
            linewidth=1.0,
        )
    ax.set_title(r"turntable: $\mathbf{u} = W\,\mathbf{e}_3\times(\mathbf{z}-\mathbf{c})$", fontproperties=SMALL)
