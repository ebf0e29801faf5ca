"""A run as one plain dictionary of JSON's types: all that a page needs to show it, and nothing else.

``format`` and ``version`` say what the dictionary is. ``axes`` are three rows that take space axes to those of the
page, whose third axis points against gravity; ``floor`` is the plane, in axes of the page. ``arrays`` holds the numbers
at each saved time that the solve reached, each entry with its ``type``, float32 or float64, its ``shape`` and its
``data``: the bytes, the least significant first, in base64. They are

- ``time`` (T,); ``centre`` (T, 3), of the shell, and ``quaternion`` (T, 4), the scalar last: from body axes to those of
  the page; ``moved`` (T, 3) and ``turned`` (T,), of a plane that moves and of a turntable;
- ``masses`` (T, n, 3), ``centre_of_mass`` (T, 3) and ``arms_j`` (T, n_j, points, 3), of the j-th mechanism, in body
  axes from the centre; ``rail_j`` (points, 3), which is at rest there;
- ``normal_force`` (T,), ``friction`` (T, 2) in space axes, ``angular_velocity`` (T, 3) in body axes, and what else the
  ``plots`` draw, each of whose ``series`` names an array and the columns of it whose sum is drawn.
"""

import base64
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ...physics.body import AbstractBody, Disk, System
from ...physics.state import ReducedState
from ...simulation.trajectory import Trajectory
from ..actuation import mass_angles
from ..floor import Setting, floor_under, place, setting_of
from ..mechanisms import arms_of_run
from ..record import Record, record, require_one
from ..shapes import rails_of
from ..style import COMPONENTS, TRAIL, described, dimensionless, mass_colour

FORMAT, VERSION = "jaxball view", 1
CLOSE = 1e-6  # how far from where it is a point may be shown, in radii
SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
ELEVATION, AZIMUTH = {False: 20.0, True: 8.0}, {False: -60.0, True: -90.0}  # degrees, of a ball and of a disk


def view_document(trajectory: Trajectory, title: str = "", friction: float | None = None) -> dict[str, Any]:
    """The dictionary of a run.

    **Raises:** ``ValueError`` for a trajectory that is not of a ball or a disk, for a reduced one, for a batch, for one
    without a finite state, and for a ``friction`` that is not a positive number.
    """
    if friction is not None and not 0 < friction < np.inf:
        raise ValueError(f"Argument `friction` must be a positive number, but it is {friction}.")
    check_shown(trajectory)
    run, system = record(trajectory), trajectory.system
    if not len(run.times):
        raise ValueError(
            f"Argument `trajectory` must have a finite state to show, but it has none. {trajectory.message}"
        )
    setting, planar = setting_of(system, run.times), isinstance(system, Disk)
    angles = mass_angles(trajectory)
    arrays = _pose(trajectory, run, setting) | _quantities(trajectory, run, angles)
    rails = rails_of(system)
    arrays |= {f"rail_{j}": packed(points, float(system.radius)) for j, (_, points) in enumerate(rails)}
    return {
        "format": FORMAT,
        "version": VERSION,
        "title": title or described(system),
        "units": "dimensionless, m₀ = r = g = 1" if dimensionless(system) else "in the units of its parameters",
        "ok": trajectory.ok,
        "message": trajectory.message,
        "body": "disk" if planar else "ball",
        "radius": float(system.radius),
        "friction": friction,
        "axes": setting.page.tolist(),
        "floor": _floor(system, run, setting),
        "camera": {"elevation": ELEVATION[planar], "azimuth": AZIMUTH[planar] + (0 if planar else setting.downhill)},
        "masses": _masses(system),
        "rails": [{"colour": mass_colour(members[0])} for members, _ in rails],
        "arms": [mass_colour(j) for j in range(system.n_masses + 1, system.n_masses + len(system.mechanisms) + 1)],
        "palette": {"trail": TRAIL, "components": list(COMPONENTS)},
        "plots": _plots(system, list(angles)),
        "arrays": arrays,
    }


def check_shown(trajectory: Trajectory[Any, Any]) -> None:
    """Raises a ``ValueError`` for a trajectory that knows of no body at a place."""
    if not isinstance(trajectory.system, AbstractBody):
        raise ValueError(
            "Argument `trajectory` must be of a ball or a disk, which have a shell to show, but it is of a "
            f"{type(trajectory.system).__name__}; its method plot() draws its motion."
        )
    require_one(trajectory)
    if isinstance(trajectory.state, ReducedState):
        raise ValueError(
            "Argument `trajectory` must know where the ball is, but it is of a ReducedState; simulate with a BallState."
        )


def packed(values: Any, scale: float | None = None) -> dict[str, Any]:
    """An array as the page reads it, in float32.

    With a ``scale``, in float64 where float32 would be off by more than a millionth of that.
    """
    exact = np.asarray(values, dtype="<f8")
    with np.errstate(over="ignore"):
        short = exact.astype("<f4")
    off = np.max(np.abs(short - exact), initial=0.0) if scale is not None else 0.0
    kept = short if scale is None or off <= CLOSE * scale else exact
    data = base64.b64encode(kept.tobytes()).decode("ascii")
    return {"type": kept.dtype.name, "shape": list(kept.shape), "data": data}


def _pose(trajectory: Trajectory, run: Record, setting: Setting) -> dict[str, Any]:
    r, placed, seen = float(trajectory.system.radius), place(run, setting), run.observables
    arrays = {
        "time": packed(run.times, 0.0),
        "centre": packed(placed.centre, r),
        "quaternion": packed(_continuous(Rotation.from_matrix(placed.Lambda).as_quat()), 1.0),
        "masses": packed(seen.mass_positions_body, r),
        "centre_of_mass": packed(seen.centre_of_mass_body, r),
    }
    arrays |= {f"arms_{j}": packed(points, r) for j, points in enumerate(arms_of_run(trajectory))}
    if np.any(setting.moved):
        arrays["moved"] = packed(setting.moved, r)
    if setting.turned is not None:
        arrays["turned"] = packed(setting.turned, 1.0)
    return arrays


def _continuous(quaternions: Float[np.ndarray, "T 4"]) -> Float[np.ndarray, "T 4"]:
    """The same turns, with the signs that make each near the one before."""
    flips = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0
    return quaternions * np.where(np.cumsum(np.concatenate([[0], flips])) % 2, -1.0, 1.0)[:, None]


def _quantities(trajectory: Trajectory, run: Record, angles: dict[int, np.ndarray]) -> dict[str, Any]:
    seen = run.observables
    arrays = {
        "angular_velocity": seen.angular_velocity_body,
        "normal_force": seen.normal_force,
        "friction": seen.friction,
        "friction_ratio": seen.friction_ratio,
        "energies": np.stack([seen.kinetic_energy, seen.potential_energy], axis=1),
    }
    if angles:
        arrays["mass_angles"] = np.stack(list(angles.values()), axis=1)
    if trajectory.system.mechanisms:
        arrays["joint_angles"] = seen.joint_angles
    return {name: packed(values) for name, values in arrays.items()}


def _floor(system: System, run: Record, setting: Setting) -> dict[str, Any]:
    floor = floor_under(run.observables.contact_point, float(system.radius), setting)
    return {
        "low": floor.low.tolist(),
        "high": floor.high.tolist(),
        "height": floor.height,
        "table": floor.table,
        "centre": setting.centre.tolist(),
        "tilted": setting.tilted,
        "top": floor.block.top.tolist(),
        "base": floor.block.base.tolist(),
    }


def _masses(system: System) -> list[dict[str, Any]]:
    """Name, colour and mass of each, in the order of the observables."""
    found = [(f"m{i}", i, mass.mass) for i, mass in enumerate(system.point_masses, start=1)]
    for j, mechanism in enumerate(system.mechanisms, start=1):
        found += [(f"M{j}", system.n_masses + j, mass) for mass in np.asarray(mechanism.mass)]
    return [
        {"name": name.translate(SUBSCRIPTS), "colour": mass_colour(k), "mass": float(mass)} for name, k, mass in found
    ]


def _plots(system: System, masses: list[int]) -> list[dict[str, Any]]:
    """What is drawn over time, with the angles of these ``masses``."""
    plots = [
        _plot("Energies", "energies", ("T", "V", "E"), COMPONENTS, [[0], [1], [0, 1]]),
        _plot("Angular velocity", "angular_velocity", ("Ω₁", "Ω₂", "Ω₃"), COMPONENTS),
        _plot("Normal force", "normal_force", ("N",), COMPONENTS),
        _plot("Friction needed", "friction_ratio", ("|f| / N",), COMPONENTS[1:]) | {"level": "μ"},
    ]
    if masses:
        plots.append(_plot("Angles of the masses", "mass_angles", [f"θ{i}" for i in masses], map(mass_colour, masses)))
    joints = [f"θ{j},{a}" for j, one in enumerate(system.mechanisms, start=1) for a in range(1, one.n_joints + 1)]
    if joints:
        plots.append(_plot("Joints", "joint_angles", joints, map(mass_colour, range(1, len(joints) + 1))))
    return plots


def _plot(
    title: str, array: str, names: Sequence[str], colours: Iterable[str], columns: list[list[int]] | None = None
) -> dict[str, Any]:
    """Without ``columns``, one of the array for each name."""
    columns = columns or [[k] for k in range(len(names))]
    series = [
        {"name": name.translate(SUBSCRIPTS), "colour": colour, "array": array, "columns": drawn}
        for name, colour, drawn in zip(names, colours, columns, strict=False)
    ]
    return {"title": title, "series": series}
