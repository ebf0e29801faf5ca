"""The ball with its frames, centres and vectors, one mass on its rail, and the schedule of that mass."""

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from scipy.spatial.transform import Rotation
from sketch import BODY, INK, MASS, PAPER, PATH, SHELL, SMALL, Camera, arrow, canvas, circle, dot, line, word

from jaxball import Circle, Pulse, SphericalFrame

SEEN = Camera(azimuth=-68.0, elevation=16.0)
TURNED = Rotation.from_euler("zyx", [12.0, 24.0, -20.0], degrees=True).as_matrix()
RAIL = Circle(0.76, frame=SphericalFrame(azimuth=2.2, elevation=0.35))
NAMED = 140  # the point of the rail at which its name is
ANGLE = 1.15  # of the mass on the rail
CONTACT, OFFSET = np.array([0.0, 0.0, -1.0]), np.array([0.24, 0.0, -0.28])
SHARE = 0.4  # of the mass on the rail in the whole


def draw() -> Figure:
    figure = Figure(figsize=(7.8, 3.5), layout="constrained")
    places = GridSpec(1, 2, figure=figure, width_ratios=(2.6, 1.0))
    with jax.enable_x64(True):
        draw_ball(canvas(figure, places[0]))
        draw_schedule(figure.add_subplot(places[1]))
    return figure


def draw_ball(ax) -> None:
    draw_plane(ax)
    line(ax, circle(SEEN([0, 0, 0]), 1.0), SHELL, linewidth=1.4)
    line(ax, SEEN(circle((0, 0, 0), 1.0, (1, 0, 0), (0, 1, 0))), "0.8", linewidth=0.7)
    rail = np.array(RAIL.points(jnp.linspace(0.0, 2 * jnp.pi, 181))) @ TURNED.T
    passed = np.array(RAIL.points(jnp.linspace(0.0, ANGLE, 61))) @ TURNED.T
    line(ax, SEEN(rail), MASS, linewidth=0.9)
    line(ax, SEEN(passed), MASS, linewidth=2.6)
    word(ax, np.add(SEEN(passed[32]), (-0.05, 0.17)), r"$\theta_i$", MASS)
    line(ax, [SEEN(rail[NAMED]), (1.14, 0.16)], MASS, linewidth=0.6)
    word(ax, (1.18, 0.18), r"rail $\boldsymbol{\zeta}_i$", MASS, ha="left")
    mass, zero = SEEN(passed[-1]), SEEN([0.0, 0.0, 0.0])
    for k, axis in enumerate(TURNED.T):
        tip = SEEN(1.35 * axis)
        arrow(ax, zero, tip, BODY, rf"$\mathbf{{E}}_{k + 1}$", 0.14 * tip / np.linalg.norm(tip), linewidth=1.0)
    arrow(ax, zero, mass, INK, linewidth=1.5)
    word(ax, np.add(0.5 * mass, (0.02, 0.13)), r"$\boldsymbol{\chi}_i$")
    arrow(ax, SEEN(CONTACT), mass, INK, linewidth=1.5)
    word(ax, np.add(0.5 * (SEEN(CONTACT) + mass), (-0.13, -0.05)), r"$\mathbf{s}_i$")
    line(ax, [SEEN(CONTACT), zero], SHELL, linestyle=(0, (4, 2)))
    word(ax, np.add(0.8 * SEEN(CONTACT), (0.15, 0.0)), r"$r\,\boldsymbol{\Gamma}$", SHELL)
    arrow(ax, zero, SEEN(OFFSET), SHELL, linewidth=1.0, mutation_scale=7)
    word(ax, np.add(SEEN(OFFSET), (0.15, -0.03)), "$m_0$", SHELL)
    word(ax, np.add(SEEN(OFFSET), (-0.13, -0.01)), r"$\boldsymbol{\chi}_0$", SHELL)
    dot(ax, SEEN(OFFSET), SHELL, 5)
    dot(ax, mass, MASS, 8)
    word(ax, np.add(mass, (-0.1, -0.15)), r"$m_i$", MASS)
    for name, place, shift in [
        ("GC", zero, (-0.1, 0.14)),
        ("CP", SEEN(CONTACT), (-0.04, -0.14)),
        ("CM", SEEN(OFFSET) + SHARE * (mass - SEEN(OFFSET)), (-0.17, -0.07)),
    ]:
        dot(ax, place)
        word(ax, place + shift, name)


def draw_plane(ax) -> None:
    corners = np.array([[-2.5, -1.3, -1], [1.7, -1.3, -1], [1.7, 1.3, -1], [-2.5, 1.3, -1]])
    ax.fill(*SEEN(corners).T, color=PAPER, zorder=-2)
    s = np.linspace(-1.9, 0.0, 60)
    path = np.stack([s, 0.32 * np.sin(1.9 * s), 0 * s - 1], axis=1)
    line(ax, SEEN(path), PATH, zorder=-1, linewidth=1.6)
    word(ax, SEEN([-1.3, -0.62, -1]), r"$\mathbf{z}(t)$", PATH)
    origin = np.array([-2.2, 0.6, 0.0])
    line(ax, SEEN([origin, origin - (0, 0, 1)]), "0.6", linewidth=0.8, linestyle=(0, (1, 1.5)))
    word(ax, np.add(SEEN(origin - (0, 0, 0.5)), (-0.08, 0)), "$r$", "0.4")
    for k, axis in enumerate(np.eye(3)):
        tip = SEEN(0.62 * axis)
        arrow(
            ax,
            SEEN(origin),
            SEEN(origin) + tip,
            INK,
            rf"$\mathbf{{e}}_{k + 1}$",
            0.13 * tip / np.linalg.norm(tip),
            linewidth=1.0,
        )


def draw_schedule(ax) -> None:
    times = np.linspace(0.0, 3.0, 201)
    pulse = Pulse(0.25, height=1.1, start=0.3, hold=0.9, end=1.5)
    angles = np.array(jax.vmap(lambda t: pulse.derivatives(t)[0])(jnp.asarray(times)))
    now = float(np.interp(ANGLE, angles, times))
    ax.plot(times, angles, color=MASS, linewidth=1.5)
    ax.plot([now, now, 0.0], [0.0, ANGLE, ANGLE], color="0.5", linewidth=0.8, linestyle=(0, (4, 2)))
    ax.plot([now], [ANGLE], "o", color=MASS, ms=7, mew=0)
    ax.set(
        xlim=(0.0, 3.0), ylim=(0.0, 2.4), xticks=[now], yticks=[ANGLE], xticklabels=["$t$"], yticklabels=[r"$\theta_i$"]
    )
    ax.set_title(r"schedule $\theta_i(t)$", fontproperties=SMALL, color=MASS)
    ax.set_box_aspect(1.0)
    ax.spines[["top", "right"]].set_visible(False)
    ax.spines[["left", "bottom"]].set_linewidth(0.6)
    for text in (*ax.get_xticklabels(), *ax.get_yticklabels()):
        text.set(fontfamily="STIXGeneral", math_fontfamily="stix", fontsize=11)
