"""The standard figures of a trajectory: written to a folder, or together on one page."""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..files.scenario.units import Units
from ..interface.wording import did_you_mean
from ..physics.body import AbstractBody
from ..physics.classical import LagrangianState
from ..physics.sensors import AbstractSensor
from ..physics.system import AbstractSystem
from ..simulation.trajectory import Trajectory
from .classical import classical_motion, lagrangian_motion, law_errors
from .coordinates import acceleration, accelerations, joint_angles, joint_efforts, mass_angles, mass_units
from .files import plain_name, run_mark, save_figure, save_figures
from .over_time import share_bands
from .record import record, require_one_of_body
from .space import body_paths, centre_path, configuration, space_paths
from .style import LABEL, ShownFigure, caption, captioned, describe_units, in_words, title_of
from .time_series import (
    angular_velocity,
    attitude,
    centre_velocity,
    contact_force,
    energies,
    friction_ratio,
    height,
    measurements,
    of_contact,
    own_states,
    power,
    slip_speed,
)

STANDARD = (
    acceleration,
    mass_angles,
    configuration,
    body_paths,
    space_paths,
    attitude,
    angular_velocity,
    centre_path,
    centre_velocity,
    energies,
    power,
    contact_force,
    friction_ratio,
)
OF_JOINTS = (joint_angles, joint_efforts)
PANELS = {draw.__name__: draw for draw in (*STANDARD, *OF_JOINTS, height, slip_speed, own_states)}


def save_figures_of(
    trajectory: Trajectory[Any, Any],
    folder: str | Path,
    title: str = "",
    *,
    name: str = "",
    formats: Sequence[str] = ("png",),
    sensors: Mapping[str, AbstractSensor] | None = None,
    svg_text: bool = False,
    replace: bool = False,
) -> list[Path]:
    if isinstance(trajectory.system, AbstractBody):
        # Raises for what cannot be drawn, before a folder is made.
        record(trajectory)
    begin = plain_name(name, trajectory.system.title.lower().replace(" ", "_"))
    named = [(draw.__name__, functools.partial(draw, trajectory)) for draw in standard_figures(trajectory)]
    if sensors:
        named.append((measurements.__name__, functools.partial(measurements, trajectory, sensors)))

    about = trajectory.system, title, describe_units(trajectory)
    drawings = [(f"{begin}_{figure_name}", captioned(draw, *about)) for figure_name, draw in named]
    return save_figures(drawings, folder, run_mark(trajectory), formats, svg_text=svg_text, replace=replace)


def standard_figures(trajectory: Trajectory[Any, Any]) -> list[Callable[[Trajectory[Any, Any]], Axes | Figure]]:
    """Returns the functions that draw the standard figures of a run, without empty ones."""
    system = trajectory.system
    if not isinstance(system, AbstractBody):
        motion = lagrangian_motion if isinstance(trajectory.state, LagrangianState) else classical_motion
        return [motion, *([law_errors] if trajectory.laws else [])]
    joints = OF_JOINTS if system.mechanisms else ()
    of_users = () if system.own_states is None else (own_states,)
    empty = {acceleration: not accelerations(trajectory), mass_angles: not mass_units(trajectory.system)}
    if not (system.n_masses or system.mechanisms):
        central = _is_central(system)
        empty |= {configuration: central, body_paths: True, space_paths: central}
    return [draw for draw in (*STANDARD, *of_contact(trajectory), *joints, *of_users) if not empty.get(draw, False)]


def _is_central(system: AbstractBody) -> bool:
    """Returns whether nothing is in the shell, and its centre of mass is the geometric centre."""
    return not (system.n_masses or system.mechanisms or np.any(np.asarray(system.offset)))


def write_figure(
    drawn: Axes | Figure, path: Path, system: AbstractSystem, title: str = "", units: Units | None = None
) -> None:
    """Writes a figure, with a caption that says which system it shows, and in what units."""
    save_figure(captioned(lambda: drawn, system, title, in_words(units))(), path)


def draw(
    trajectory: Trajectory[Any, Any], panel: str | None = None, ax: Axes | None = None, *, title: str = ""
) -> Figure | Axes:
    """Draws a run as :meth:`jaxball.Trajectory.plot` says."""
    if panel is not None:
        if not isinstance(panel, str) or panel not in PANELS:
            raise ValueError(
                f"Argument `panel` must be one of {', '.join(PANELS)}, but it is {panel!r}{did_you_mean(panel, PANELS)}"
            )
        if title:
            raise ValueError("Argument `title` is for the page of panels; a panel alone has the title of its `ax`.")
        return PANELS[panel](trajectory, ax)
    if isinstance(trajectory.system, AbstractBody):
        return overview(trajectory, title)
    if isinstance(trajectory.state, LagrangianState):
        return lagrangian_motion(trajectory)
    return classical_motion(trajectory).figure  # pyright: ignore[reportReturnType]


def overview(trajectory: Trajectory, title: str = "") -> Figure:
    """Draws one page of panels of a body; see :meth:`jaxball.Trajectory.plot`."""
    require_one_of_body(trajectory)
    of_modes = of_contact(trajectory)
    more = (*of_modes, contact_force) if of_modes else ()
    more += () if trajectory.system.own_states is None else (own_states,)
    in_space = {} if trajectory.system.planar else {"projection": "3d", "computed_zorder": False}
    panels: list[tuple[Callable[..., Axes], dict[str, Any]]] = [
        (configuration, in_space),
        (space_paths, in_space),
        (centre_path, {}),
        *((draw, {}) for draw in (angular_velocity, energies, friction_ratio, *more)),
    ]
    if _is_central(trajectory.system):
        panels[:3] = (centre_path, {}), (centre_velocity, {})
    rows = math.ceil(len(panels) / 3)
    figure = ShownFigure(figsize=(10.5, round(1.2 + 2.8 * rows, 1)), layout="constrained")
    caption(figure, trajectory.system, title or title_of(trajectory), describe_units(trajectory))
    grid = figure.add_gridspec(rows, 3, height_ratios=(1.25, 1, 1, 1)[:rows])
    for k, (draw, kind) in enumerate(panels):
        ax = draw(trajectory, figure.add_subplot(grid[k // 3, k % 3], **kind))
        ax.annotate(
            f"({chr(97 + k)})",
            (0.0, 1.0),
            xytext=(-22, 6),
            xycoords="axes fraction",
            textcoords="offset points",
            fontproperties=LABEL,
        )
    share_bands(figure)
    return figure
