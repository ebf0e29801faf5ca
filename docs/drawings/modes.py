"""The three modes of a body on a plane, their forces, and what leads from one to another."""

import numpy as np
from matplotlib.figure import Figure
from sketch import FORCE, INK, PAPER, PATH, SHELL, SLIP, SMALL, arrow, canvas, circle, dot, line, word

PLACES = {"rolling": 0.0, "sliding": 4.4, "flight": 8.8}


def draw() -> Figure:
    figure = Figure(figsize=(7.8, 3.1), layout="constrained")
    ax = canvas(figure, 111)
    ax.fill([-1.7, 10.5, 10.5, -1.7], [-1.35, -1.35, -1.0, -1.0], color=PAPER)
    line(ax, [(-1.7, -1.0), (10.5, -1.0)], "0.6", linewidth=0.8)
    for name, x in PLACES.items():
        lift = 0.6 if name == "flight" else 0.0
        centre, low = np.array([x, lift]), np.array([x, lift - 1.0])
        line(ax, circle(centre, 1.0), SHELL, linewidth=1.4)
        dot(ax, centre)
        dot(ax, low, size=3)
        arrow(ax, centre, np.add(centre, (0.75, 0.0)), PATH, r"$\mathbf{V}$", (-0.1, 0.22))
        word(ax, (x, 2.6), name)
    draw_forces(ax)
    draw_switches(ax)
    ax.set(xlim=(-1.8, 10.6), ylim=(-2.85, 2.85))
    return figure


def draw_forces(ax) -> None:
    for name, friction in (("rolling", -0.35), ("sliding", -0.7)):
        foot = np.array([PLACES[name], -1.0])
        line(
            ax,
            [np.add(foot, (-0.77, 1.1)), foot, np.add(foot, (0.77, 1.1))],
            "0.7",
            linewidth=0.8,
            linestyle=(0, (1, 1.5)),
        )
        arrow(ax, foot, np.add(foot, (0.0, 0.82)), FORCE)
        word(ax, np.add(foot, (0.2, 0.72)), "$N$", FORCE)
        arrow(ax, foot, np.add(foot, (friction, 0.0)), FORCE)
        word(ax, np.add(foot, (friction - 0.2, -0.17)), r"$\mathbf{f}$", FORCE)
    foot = np.array([PLACES["sliding"], -1.0])
    arrow(ax, foot, np.add(foot, (0.9, 0.0)), SLIP)
    word(ax, np.add(foot, (1.05, -0.2)), r"$\mathbf{v}_\mathrm{s}$", SLIP)
    x = PLACES["flight"]
    line(ax, [(x, -1.0), (x, -0.4)], INK, linewidth=0.8)
    word(ax, (x + 0.2, -0.7), "$h$")
    laws = {
        "rolling": r"$\mathbf{v}_\mathrm{s}=0,\;|\mathbf{f}|\leq\mu_\mathrm{s}N$",
        "sliding": r"$\mathbf{f}=-\mu N\boldsymbol{\sigma}$",
        "flight": r"$\mathbf{R}=0,\;h>0$",
    }
    for name, law in laws.items():
        word(ax, (PLACES[name], 2.05), law, fontproperties=SMALL)


def draw_switches(ax) -> None:
    rolling, sliding, flight = PLACES.values()
    for start, end, height, text in [
        (rolling + 1.15, sliding - 1.15, 0.55, r"$|\mathbf{f}|>\mu_\mathrm{s}N$"),
        (sliding - 1.15, rolling + 1.15, 0.05, r"$\mathbf{v}_\mathrm{s}=0$"),
        (sliding + 1.15, flight - 1.15, 0.85, "$N=0$"),
        (flight - 1.15, sliding + 1.15, 0.35, "impact at $h=0$"),
    ]:
        arrow(ax, (start, height), (end, height), INK, linewidth=1.0)
        word(ax, ((start + end) / 2, height + 0.22), text, fontproperties=SMALL)
    low = [
        (rolling + 0.25, flight - 0.25, -1.95, "$N=0$"),
        (flight + 0.25, rolling - 0.25, -2.65, "impact at $h=0$ that ends without slip"),
    ]
    for start, end, depth, text in low:
        line(ax, [(start, -1.45), (start, depth), (end, depth)], INK, linewidth=1.0)
        arrow(ax, (end, depth), (end, -1.42), INK, linewidth=1.0)
        word(ax, ((start + end) / 2, depth + 0.2), text, fontproperties=SMALL)
