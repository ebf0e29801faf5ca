"""Pictures of a scenario for the gallery, a page of graphs and a small one, each with words for what is seen."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from PIL import Image, ImageOps
from scipy.spatial.transform import Rotation

from jaxball import Disk, Scenario, Trajectory, plot
from jaxball.physics import AbstractSurface
from jaxball.physics.body import System
from jaxball.physics.classical import HeavyTop, LagrangianState, RollingEllipsoid
from jaxball.physics.classical.state import OrientedState
from jaxball.plot.palette import FAINT, INK, SHELL, TRAIL
from jaxball.plot.shapes import split, view, wireframe
from jaxball.plot.style import describe
from jaxball.plot.view.free import REACH, THROUGH_CENTRE, axis_of_revolution, ellipsoid_of

FAR = 3.0  # radii from the start to where a body is shown, which is the smaller the longer its path is
SHARE = 0.3  # of the run of a rigid body, after which its path covers it
SMALLER = 0.4  # than a snapshot, with lines as wide
SIZE, DPI = 2.6, 300
BLADES, BLADE = 13, 0.05  # how many lines show a heading, and their length relative to the path's extent
# What a panel shows, by the label of its vertical axis without a unit or a direction.
SEEN = {
    r"$\mathbf{E}_2$": "the configuration in the body",
    r"$\mathbf{E}_3$": "the configuration in the body",
    r"$\mathbf{e}_2$": "the paths of the masses and of the centre of mass beside the centre",
    r"$\mathbf{e}_3$": "the paths of the masses and of the centre of mass beside the centre",
    r"$\Gamma_i$": "the vertical in body axes",
    r"$\phi$": "the angle of rolling",
    "$V_i$": "the velocity of the centre",
    r"$\dot{z}$": "the velocity of the centre",
    "$z_2$": "the path on the plane",
    "$z$": "the place over time",
    r"$\Omega_i$": "the angular velocity",
    r"$\dot{\phi}$": "the angular velocity",
    "energy": "the energies",
    r"$|\,\mathbf{f}\,|/N$": "friction over the normal force",
    "$h$": "the height",
    r"$|\,\mathbf{v}_s|$": "the slip speed",
    "contact force": "the contact force",
    "state": "the coordinates and their rates",
    "positions": "the positions",
    "angles": "the angles",
    "rates": "the rates of the positions",
    "angular rates": "the rates of the angles",
    "constraint forces": "the constraint forces",
}


def write_overview(run: Trajectory[Any, Any], title: str, folder: Path) -> None:
    """``overview.png``, and ``overview.txt`` with what is seen there."""
    figure = run.plot()
    plot.caption(figure, run.system, title)
    figure.savefig(folder / "overview.png", dpi=110)
    shown = [SEEN[ax.get_ylabel().partition(" (")[0]] for ax in figure.axes]
    listed = f"{', '.join(shown[:-1])} and {shown[-1]}" if len(shown) > 1 else f"{shown[0]} over time"
    (folder / "overview.txt").write_text(f"{'Panels' if len(shown) > 1 else 'A graph'} of the run: {listed}")


def write_thumbnail(scenario: Scenario, run: Trajectory[Any, Any], folder: Path) -> None:
    """``thumbnail.png``, and ``thumbnail.txt`` with what is seen there."""
    if isinstance(scenario.system, System):
        figure, words = rolling(scenario, run)
    elif isinstance(run.state, OrientedState):
        figure, words = rigid_body(scenario, run)
    elif isinstance(run.state, LagrangianState):
        figure, words = vehicle(run)
    else:
        figure, words = particle(run)
    figure.savefig(folder / "thumbnail.png", dpi=DPI)
    with Image.open(folder / "thumbnail.png") as picture:
        whole = picture.convert("RGB")
    box = ImageOps.invert(whole).getbbox()
    ImageOps.expand(whole.crop(box), border=4, fill="white").save(folder / "thumbnail.png")
    (folder / "thumbnail.txt").write_text(words)


def rolling(scenario: Scenario, run: Trajectory[Any, Any]) -> tuple[Figure, str]:
    """A body soon after its start."""
    path = np.asarray(run.observables.contact_point)
    far = np.linalg.norm(path - path[0], axis=1) > FAR * float(scenario.system.radius)
    until = int(np.argmax(far)) if far.any() else int(0.7 * len(far))
    times = np.linspace(run.times[0], run.times[until], 101)
    figure = dataclasses.replace(scenario, times=times).simulate(throw=True).snapshot()
    for one in [*figure.legends, *figure.texts, *(text for ax in figure.axes for text in ax.texts)]:
        one.remove()
    figure.set_size_inches(SMALLER * figure.get_size_inches())
    ground = _ground_of(scenario.system)
    return figure, f"{describe(scenario.system)}, {ground}, with the path of its contact point behind it"


def _ground_of(system: Any) -> str:
    if isinstance(system, Disk):
        return "on the ground line"
    return "on its surface" if isinstance(system.ground, AbstractSurface) else "on its plane"


def rigid_body(scenario: Scenario, whole: Trajectory[Any, Any]) -> tuple[Figure, str]:
    """An ellipsoid with the body's principal axes, and the path of the tip of one of its axes."""
    until = whole.times[0] + SHARE * (whole.times[-1] - whole.times[0])
    run = dataclasses.replace(scenario, times=np.linspace(whole.times[0], until, 601)).simulate(throw=True)
    system, Lambda = run.system, Rotation.from_quat(np.roll(np.asarray(run.state.q), -1, axis=1))
    shape = ellipsoid_of(system, np.asarray(system.inertia, dtype=float) if hasattr(system, "inertia") else None)
    arm = np.asarray(system.chi) if isinstance(system, HeavyTop) else np.eye(3)[axis_of_revolution(system)]
    tips = REACH * shape.radius * Lambda.apply(arm / np.linalg.norm(arm))
    now = Lambda[-1]
    figure = Figure(figsize=(SIZE, SIZE))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d", computed_zorder=False, proj_type="ortho")
    half = REACH * shape.radius
    ax.set(xlim=(-half, half), ylim=(-half, half), zlim=(-half, half))
    ax.set_box_aspect((1, 1, 1), zoom=1.3)
    ax.set_axis_off()
    unit = wireframe()
    drawn = shape.centre + (unit * shape.semi_axes) @ shape.turn.T
    front, _ = split(now.apply((unit / shape.semi_axes) @ shape.turn.T), view(ax))  # normals
    back = np.where(np.isnan(front), now.apply(drawn), np.nan)
    ax.plot(*back.T, color=FAINT, linewidth=0.6, zorder=1)
    ax.plot(*np.where(np.isnan(front), np.nan, now.apply(drawn)).T, color=SHELL, linewidth=0.7, zorder=2)
    ax.plot(*np.stack([np.zeros(3), tips[-1]]).T, color=INK, linewidth=1.0, zorder=3)
    ax.plot(*np.zeros((3, 1)), "o", color=INK, ms=3.0, zorder=3)
    ax.plot(*tips.T, color=TRAIL, linewidth=1.2, zorder=4)
    axis = THROUGH_CENTRE["name"] if isinstance(system, HeavyTop) else f"its axis E{axis_of_revolution(system) + 1}"
    point = "its centre" if isinstance(system, RollingEllipsoid) else "the fixed point"
    return figure, f"{describe(system)}: an ellipsoid about {point}, and the path of the tip of {axis}"


def particle(run: Trajectory[Any, Any]) -> tuple[Figure, str]:
    """A particle at the end of its path in space, in a box."""
    path = np.stack([np.asarray(getattr(run.state, name)) for name in "xyz"], axis=1)
    figure = Figure(figsize=(SIZE, SIZE))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d", computed_zorder=False, proj_type="ortho")
    ax.plot(*path.T, color=TRAIL, linewidth=1.6, zorder=3)
    ax.plot(path[:, 0], path[:, 1], path[:, 2].min(), color=FAINT, linewidth=1.6, zorder=2)
    ax.plot(*path[-1:].T, "o", color=INK, ms=6.0, zorder=4)
    ax.set(xticks=[], yticks=[], zticks=[], xlabel="$x$", ylabel="$y$", zlabel="$z$")
    for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
        axis.labelpad = -14
    ax.set_box_aspect((1, 1, 1), zoom=0.85)
    return figure, f"{describe(run.system)} at the end of its path in a box, with the path's shadow on the bottom"


def vehicle(run: Trajectory[Any, Any]) -> tuple[Figure, str]:
    """A path on the plane from above, with short lines that show the heading, whose coordinates are the first three."""
    x, y, heading = np.asarray(run.state.q[:, :3]).T
    half = 0.5 * BLADE * max(np.ptp(x), np.ptp(y))
    figure = Figure(figsize=(SIZE, SIZE))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.plot(x, y, color=TRAIL, linewidth=1.6)
    for row in np.linspace(0, len(x) - 1, BLADES).astype(int):
        along = half * np.array([np.cos(heading[row]), np.sin(heading[row])])
        ends = np.array([x[row], y[row]]) + np.array([[-1.0], [1.0]]) * along
        ax.plot(*ends.T, color=INK, linewidth=2.0, solid_capstyle="round")
    ax.set_aspect("equal")
    ax.set_axis_off()
    return figure, f"{describe(run.system)}: its path from above, with short lines along its blade"
