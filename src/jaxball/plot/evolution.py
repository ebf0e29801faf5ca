"""Quantities over time: rates, energies and forces."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from ..physics.body import Disk
from ..physics.system import AbstractSystem
from ..simulation.extremes import contact_extremes
from ..simulation.trajectory import Trajectory
from .record import record
from .style import COMPONENTS, DASHED, INK, legend_above, named, plane_axes, up_to_ticks, write

CONSTANT = 1e-6  # a force that changes by less, relative to itself, is the same throughout


class Series(NamedTuple):
    """What is drawn over time as one line."""

    values: Float[np.ndarray, " T"]
    label: str
    colour: str
    dashes: Any = "-"


def angular_velocity(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """φ̇ of the disk, ``fig_disk_dot_angle``, or the body components Ω_i of the ball, ``fig_ball_Omega``.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a reduced trajectory, a batch, or a three-dimensional ``ax``.
    """
    times, _, seen = record(trajectory)
    Omega = seen.angular_velocity_body
    if isinstance(trajectory.system, Disk):
        series = [Series(-Omega[:, 1], "", COMPONENTS[0])]
        return over_time(trajectory.system, times, series, r"$\dot{\phi}$", ax)
    series = [Series(Omega[:, j], rf"$\Omega_{j + 1}$", COMPONENTS[j]) for j in range(3)]
    return over_time(trajectory.system, times, series, r"$\Omega_i$", ax)


def energies(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Kinetic energy T, potential energy V and their sum E, dashed, so that a T that it covers is seen.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a reduced trajectory, a batch, or a three-dimensional ``ax``.
    """
    times, _, seen = record(trajectory)
    series = [
        Series(seen.kinetic_energy, "$T$", COMPONENTS[0]),
        Series(seen.potential_energy, "$V$", COMPONENTS[1]),
        Series(seen.kinetic_energy + seen.potential_energy, "$E = T + V$", INK, DASHED),
    ]
    return over_time(trajectory.system, times, series, "energy", ax)


def power(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Ė, the power of the actuation and of the external force together.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a reduced trajectory, a batch, or a three-dimensional ``ax``.
    """
    times, _, seen = record(trajectory)
    return over_time(trajectory.system, times, [Series(seen.power, "", COMPONENTS[0])], r"$\dot{E}$", ax)


def contact_force(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """The force of the plane: the normal force N and the magnitude |f| of the friction.

    With dense output, the least N of the whole run is marked.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a reduced trajectory, a batch, or a three-dimensional ``ax``.
    """
    times, _, seen = record(trajectory)
    series = [
        Series(seen.normal_force, "$N$", COMPONENTS[0]),
        Series(np.linalg.norm(seen.friction, axis=1), r"$|\,\mathbf{f}\,|$", COMPONENTS[1]),
    ]
    ax = over_time(trajectory.system, times, series, "contact force", ax)
    up_to_ticks(ax, low=0.0)
    if trajectory.interpolant is not None:
        extremes = contact_extremes(trajectory)
        at, least = float(extremes.least_normal_force_time), float(extremes.least_normal_force)
        if len(times) and np.max(seen.normal_force) - least <= CONSTANT * abs(least):
            at, when = float(times[0]), "throughout"
        else:
            when = _when(at, times)
        _mark(ax, at, least, rf"least $N = {least:.4g}$ {when}", COMPONENTS[0])
    return ax


def friction_ratio(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """|f| / N, with its largest value μ_min marked: with less friction the ball would slip.

    That of the whole run is marked where there is dense output, and otherwise the largest at the saved times.
    Where N ≤ 0 the ball would leave the plane: nothing is drawn there, and a note takes the place of
    the mark.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a reduced trajectory, a batch, or a three-dimensional ``ax``.
    """
    times, _, seen = record(trajectory)
    ratio = seen.friction_ratio
    held = np.isfinite(ratio)
    drawn = np.where(held, ratio, np.nan)
    ax = over_time(trajectory.system, times, [Series(drawn, "", COMPONENTS[0])], r"$|\,\mathbf{f}\,|/N$", ax)
    up_to_ticks(ax, low=0.0)
    if not np.all(held):
        sentence = rf"not drawn where $N \leq 0$, first {_when(float(times[~held][0]), times)}"
        write(ax, (0.5, 1.02), sentence, transform=ax.transAxes, ha="center", va="bottom")
    elif len(ratio):
        at, mu = _largest_ratio(trajectory, times, ratio)
        _mark(ax, at, mu, rf"$\mu_{{\min}} = {mu:.4g}$ {_when(at, times)}", COMPONENTS[1])
        up_to_ticks(ax, low=0.0)
    return ax


def _mark(ax: Axes, t: float, value: float, label: str, color: str) -> None:
    """A dot where a quantity is extreme."""
    ax.plot(t, value, "o", ms=5, color=color, linestyle="none", label=label, clip_on=False)
    legend_above(ax)


def _largest_ratio(trajectory: Trajectory, times: np.ndarray, ratio: np.ndarray) -> tuple[float, float]:
    """When |f| / N is largest, and how large: of the whole run where it has dense output."""
    if trajectory.interpolant is not None:
        extremes = contact_extremes(trajectory)
        return float(extremes.friction_needed_time), float(extremes.friction_needed)
    k = int(np.argmax(ratio))
    return float(times[k]), float(ratio[k])


def _when(t: float, times: Float[np.ndarray, " T"]) -> str:
    """A time in words, to five digits of the time of the whole run."""
    span = float(times[-1] - times[0])
    return rf"at $t = {round(t, 4 - math.floor(math.log10(span))) if span > 0 else t:g}$"


def over_time(
    system: AbstractSystem,
    times: Float[np.ndarray, " T"],
    series: Sequence[Series],
    name: str,
    ax: Axes | None,
    most: int = 5,
) -> Axes:
    """Several series of a system over time, ``name`` on the axis upwards, and ``most`` of their labels to a row."""
    ax = plane_axes(ax, system=system)
    for values, label, colour, dashes in series:
        ax.plot(times, values, color=colour, linestyle=dashes, linewidth=1.2, label=label or None)
    drawn = np.concatenate([one.values for one in series])
    drawn = drawn[np.isfinite(drawn)]
    if drawn.size and drawn.min() < 0 < drawn.max():
        ax.axhline(0.0, color="0.75", linewidth=0.6, zorder=0)
    ax.margins(x=0)
    up_to_ticks(ax)
    named(ax, "$t$", name)
    legend_above(ax, most)
    return ax
