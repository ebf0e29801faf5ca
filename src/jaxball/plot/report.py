"""The standard figures of a trajectory: written into a folder, or together on one page."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..interface.output import replacing
from ..physics.body import AbstractBody, Disk
from ..physics.system import AbstractSystem
from ..sensors import AbstractSensor
from ..simulation.trajectory import Trajectory
from .actuation import acceleration, accelerations
from .classical import classical_motion, law_errors
from .contact import of_contact
from .mechanisms import joint_angles, joint_efforts
from .modes import share_bands
from .paths import body_paths, centre_path, space_paths
from .rails import configuration
from .record import record
from .sensors import measurements
from .style import LABEL, caption
from .time_series import angular_velocity, contact_force, energies, friction_ratio, power

CLASSICAL = (classical_motion, law_errors)
STANDARD = (
    acceleration,
    configuration,
    body_paths,
    space_paths,
    angular_velocity,
    centre_path,
    energies,
    power,
    contact_force,
    friction_ratio,
)
OF_JOINTS = (joint_angles, joint_efforts)


def figures(
    trajectory: Trajectory[Any, Any],
    folder: str | Path,
    title: str = "",
    *,
    formats: Sequence[str] = ("png",),
    sensors: Mapping[str, AbstractSensor] | None = None,
) -> list[Path]:
    """Writes the standard figures of a trajectory into ``folder``, and returns their paths.

    Each file is named after the body and the function, as in ``ball_energies.png``, and written in each format. The
    acceleration is left out where no mass has an angle to draw. A run with a law of contact also has its height and its
    slip speed, unless they are zero all the time. For a classical system, the motion and its conserved
    quantities are drawn.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.
    - ``folder``: where to write; it is created if it does not exist.
    - ``title``: a line that says which system it is, such as that of a scenario.
    - ``formats``: png, pdf or svg.
    - ``sensors``: those of :mod:`jaxball.sensors`, by their names, whose readings are drawn too.

    **Raises:** ``ValueError`` for a reduced trajectory or a batch.
    """
    classical = not isinstance(trajectory.system, AbstractBody)
    if not classical:
        record(trajectory)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    kind = trajectory.system.title.lower().replace(" ", "_")
    drawn: dict[str, Axes | Figure] = {}
    joints = OF_JOINTS if not classical and trajectory.system.mechanisms else ()
    for draw in CLASSICAL if classical else (*STANDARD, *of_contact(trajectory), *joints):
        if (draw is acceleration and not accelerations(trajectory)) or (draw is law_errors and not trajectory.laws):
            continue
        drawn[draw.__name__] = draw(trajectory)
    if sensors:
        drawn[measurements.__name__] = measurements(trajectory, sensors)
    files = {folder / f"{kind}_{name}.{suffix}": one for name, one in drawn.items() for suffix in formats}
    for path, one in files.items():
        write_figure(one, path, trajectory.system, title)
    return list(files)


def write_figure(drawn: Axes | Figure, path: Path, system: AbstractSystem, title: str = "") -> None:
    """Writes a figure, with a caption that says which system it shows."""
    caption(drawn if isinstance(drawn, Figure) else drawn.figure, system, title)
    save_figure(drawn, path)


def save_figure(drawn: Axes | Figure, path: Path) -> None:
    """Writes a figure, or that of some Axes."""
    figure = drawn if isinstance(drawn, Figure) else drawn.figure
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=200)  # pyright: ignore[reportAttributeAccessIssue]


def overview(trajectory: Trajectory, title: str = "") -> Figure:
    """One page: configuration, trajectories, path, angular velocity, energies and friction, under a ``title``.

    A run with a law of contact that slips or flies has a row more, with its height, its slip speed and its forces.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a reduced trajectory or a batch.
    """
    planar = isinstance(trajectory.system, Disk)
    of_modes = of_contact(trajectory)
    more = (*of_modes, contact_force) if of_modes else ()
    figure = Figure(figsize=(10.5, 9.6 if more else 6.8), layout="constrained")
    caption(figure, trajectory.system, title)
    grid = figure.add_gridspec(3 if more else 2, 3, height_ratios=(1.25, 1, 1)[: 3 if more else 2])
    in_space = {} if planar else {"projection": "3d", "computed_zorder": False}
    panels = (
        (configuration, in_space),
        (space_paths, in_space),
        (centre_path, {}),
        (angular_velocity, {}),
        (energies, {}),
        (friction_ratio, {}),
        *((draw, {}) for draw in more),
    )
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
