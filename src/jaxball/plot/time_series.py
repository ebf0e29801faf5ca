"""Figures of quantities over time: velocities, orientation, energies, forces, and the readings of sensors."""

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import jax
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..numerics import programs
from ..numerics.arrays import to_array
from ..physics.body import Disk
from ..physics.contact.body_on_plane import ContactHistory
from ..physics.contact.modes import Mode
from ..sensors import AbstractSensor
from ..simulation.trajectory import Trajectory
from .modes import modes_of, share_bands, with_breaks
from .over_time import Series, over_time, sizes_of, without_rounding
from .palette import COMPONENTS, DASHED, DOTTED, INK, TAKEN
from .record import drawn_run, finite_rows, record, require_one
from .style import WIDE, caption, legend_above, linestyle, plane_axes, up_to_ticks, write

if TYPE_CHECKING:
    from ..simulation.extremes import ContactExtremes

SHORT = 4  # entries in a row of a legend that has long ones
CONSTANT = 1e-6  # a force with a smaller relative change counts as constant
PANEL = 1.5  # the height of a panel, in inches


def angular_velocity(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """φ̇ of the disk, ``fig_disk_dot_angle``, or the body components Ω_i of the ball, ``fig_ball_Omega``.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a reduced trajectory, a batch, or a three-dimensional ``ax``.
    """
    run = drawn_run(trajectory)
    times, _, observables = record(run)
    Omega, options = observables.angular_velocity_body, {"modes": modes_of(run), "size": 1 / sizes_of(run.system).time}
    if isinstance(run.system, Disk):
        return over_time(run.system, times, [Series(-Omega[:, 1], "", COMPONENTS[0])], r"$\dot{\phi}$", ax, **options)
    series = [Series(Omega[:, j], rf"$\Omega_{j + 1}$", COMPONENTS[j]) for j in range(3)]
    return over_time(run.system, times, series, r"$\Omega_i$", ax, **options)


def energies(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Kinetic energy T, potential energy V and their sum E, which is dashed so that a T beneath it is visible.

    For a run with a law of contact, the energy dissipated so far by sliding friction and impacts is drawn too.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a reduced trajectory, a batch, or a three-dimensional ``ax``.

    **Example:**

    >>> from jaxball import Disk, DiskState, plot, simulate
    >>> run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], DiskState(phidot=-1.0))
    >>> ax = plot.energies(run)
    >>> [text.get_text() for text in ax.get_legend().get_texts()]
    ['$T$', '$V$', '$E = T + V$']
    """
    run = drawn_run(trajectory)
    times, _, observables = record(run)
    series = [
        Series(observables.kinetic_energy, "$T$", COMPONENTS[0]),
        Series(observables.potential_energy, "$V$", COMPONENTS[1]),
        Series(observables.kinetic_energy + observables.potential_energy, "$E = T + V$", INK, DASHED),
    ]
    size = sizes_of(run.system).energy
    return over_time(run.system, times, series + _taken(run, size), "energy", ax, SHORT, modes_of(run), size)


def _taken(run: Trajectory, size: float) -> list[Series]:
    """The energy dissipated by sliding friction and impacts, if any."""
    if run.contact is None:
        return []
    rows, history = finite_rows(run), run.contact
    amounts = {"to friction": history.rubbed, "to impacts": history.struck}
    series = [Series(np.asarray(amounts[name])[rows], name, *look) for name, look in TAKEN.items()]
    return [one for one in series if np.any(without_rounding(one.values, size))]


def power(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Ė, the total power of the actuation, the external force and everything else that does work.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a reduced trajectory, a batch, or a three-dimensional ``ax``.
    """
    run = drawn_run(trajectory)
    seen, modes = record(run), modes_of(run)
    times, rate = with_breaks(modes, seen.times, seen.observables.power)
    size = sizes_of(run.system).power
    return over_time(run.system, times, [Series(rate, "", COMPONENTS[0])], r"$\dot{E}$", ax, modes=modes, size=size)


def contact_force(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """The force of the plane: the normal force N and the magnitude |f| of the friction.

    With dense output, the least N of the whole run is marked. For a run with a law of contact, the largest static
    friction, μ_s N, is drawn instead.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a reduced trajectory, a batch, or a three-dimensional ``ax``.
    """
    run = drawn_run(trajectory)
    (saved, _, seen), modes = record(run), modes_of(run)
    times, N, f = with_breaks(modes, saved, seen.normal_force, np.linalg.norm(seen.friction, axis=1))
    series = [Series(N, "$N$", COMPONENTS[0]), Series(f, r"$|\,\mathbf{f}\,|$", COMPONENTS[1])]
    if trajectory.contact is not None:
        series.append(Series(float(trajectory.contact.law.static) * N, r"$\mu_s N$", INK, DASHED))
    ax = over_time(run.system, times, series, "contact force", ax, modes=modes, size=sizes_of(run.system).force)
    up_to_ticks(ax, low=0.0)
    if trajectory.interpolant is not None and trajectory.contact is None:
        extremes = _extremes(trajectory)
        time, least = float(extremes.least_normal_force_time), float(extremes.least_normal_force)
        constant = bool(len(times)) and bool(np.max(N) - least <= CONSTANT * abs(least))
        time, when = _throughout(times, constant) or (time, _when(time, times))
        _mark(ax, time, least, rf"least $N = {least:.4g}$ {when}", COMPONENTS[0])
    return ax


def friction_ratio(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """|f| / N, with its largest value μ_min marked: with less friction the ball would slip.

    With dense output the largest value of the whole run is marked, otherwise the largest at the saved times. Where N ≤
    0 the ball would leave the plane: nothing is drawn there, and a note replaces the mark. For a run with a law of
    contact, its coefficients are drawn instead of a mark, and nothing in flight.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a reduced trajectory, a batch, or a three-dimensional ``ax``.
    """
    run = drawn_run(trajectory)
    times, _, observables = record(run)
    ratio = without_rounding(observables.friction_ratio, 1.0)
    if run.contact is not None:
        return _within_the_cone(run, run.contact, times, ratio, ax)
    on_plane = np.isfinite(ratio)
    drawn = np.where(on_plane, ratio, np.nan)
    ax = over_time(trajectory.system, times, [Series(drawn, "", COMPONENTS[0])], r"$|\,\mathbf{f}\,|/N$", ax)
    up_to_ticks(ax, low=0.0)
    if not np.all(on_plane):
        sentence = rf"not drawn where $N \leq 0$, first {_when(float(times[~on_plane][0]), times)}"
        write(ax, (0.5, 1.02), sentence, transform=ax.transAxes, ha="center", va="bottom")
    elif len(ratio):
        time, mu = _largest_ratio(trajectory, times, ratio)
        mu = float(without_rounding(np.asarray(mu), 1.0))
        time, when = _throughout(times, bool(mu - np.min(ratio) <= CONSTANT * mu)) or (time, _when(time, times))
        _mark(ax, time, mu, rf"$\mu_{{\min}} = {mu:.4g}$ {when}", COMPONENTS[1])
        up_to_ticks(ax, low=0.0)
    return ax


def _within_the_cone(
    trajectory: Trajectory,
    history: ContactHistory,
    times: Float[np.ndarray, " T"],
    ratio: Float[np.ndarray, " T"],
    ax: Axes | None,
) -> Axes:
    """|f| / N with the coefficients of the law; friction never exceeds the larger."""
    modes = modes_of(trajectory)
    flies = np.asarray(history.mode)[finite_rows(trajectory)] == Mode.FLIGHT
    times, ratio = with_breaks(modes, times, np.where(flies, np.nan, ratio))
    static, sliding = float(history.law.static), float(history.law.sliding)
    coefficients = {rf"$\mu_s = {static:.4g}$": (static, DASHED), rf"$\mu = {sliding:.4g}$": (sliding, DOTTED)}
    if static == sliding:
        coefficients = {rf"$\mu_s = \mu = {static:.4g}$": (static, DASHED)}
    ends = times[[0, -1]] if len(times) else times
    ax = plane_axes(ax, system=trajectory.system)
    for label, (value, dashes) in coefficients.items():
        ax.plot(ends, np.full_like(ends, value), color=INK, linestyle=linestyle(dashes), linewidth=0.9, label=label)
    series = [Series(ratio, "", COMPONENTS[0])]
    ax = over_time(trajectory.system, times, series, r"$|\,\mathbf{f}\,|/N$", ax, SHORT, modes)
    up_to_ticks(ax, low=0.0)
    return ax


def _mark(ax: Axes, t: float, value: float, label: str, color: str) -> None:
    """A dot where a quantity is extreme."""
    ax.plot(t, value, "o", ms=5, color=color, linestyle="none", label=label, clip_on=False)
    legend_above(ax)


def _extremes(trajectory: Trajectory) -> "ContactExtremes":
    # Imported here, because it imports all solvers, and a saved run has no dense output.
    from ..simulation.extremes import contact_extremes

    return contact_extremes(trajectory)


def _largest_ratio(trajectory: Trajectory, times: np.ndarray, ratio: np.ndarray) -> tuple[float, float]:
    """The time and the value of the largest |f| / N, of the whole run where it has dense output."""
    if trajectory.interpolant is not None:
        extremes = _extremes(trajectory)
        return float(extremes.friction_needed_time), float(extremes.friction_needed)
    k = int(np.argmax(ratio))
    return float(times[k]), float(ratio[k])


def _throughout(times: Float[np.ndarray, " T"], constant: bool) -> tuple[float, str] | None:
    """Where to mark a quantity, and the words for the time; for one that is ``constant`` too."""
    return (float(times[0]), "throughout") if constant else None


def _when(t: float, times: Float[np.ndarray, " T"]) -> str:
    """A time as text, to five digits of the duration of the run."""
    span = float(times[-1] - times[0])
    return rf"at $t = {round(t, 4 - math.floor(math.log10(span))) if span > 0 else t:g}$"


def centre_velocity(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """The velocity V of the geometric centre, space axes: ż of the disk, V_1 and V_2 of the ball.

    For a body that leaves the plane, V_3 is drawn too.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a reduced trajectory, a batch, or a three-dimensional ``ax``.

    **Example:**

    >>> from jaxball import Disk, DiskState, plot, simulate
    >>> run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], DiskState(phidot=-1.0))
    >>> print(plot.centre_velocity(run).lines[0].get_ydata())
    [1. 1. 1.]
    """
    run = drawn_run(trajectory)
    rows, speed = finite_rows(run), sizes_of(run.system).speed
    V = _velocity(run) if run.contact is None else np.asarray(run.contact.V)[rows]
    rises = bool(np.any(without_rounding(V[:, 2], speed)))
    planar = isinstance(run.system, Disk)
    columns = [j for j in range(3) if (j != 1 or not planar) and (j != 2 or rises)]
    labels = {j: rf"$V_{j + 1}$" for j in columns} if len(columns) > 1 else {0: ""}
    series = [Series(V[:, j], labels[j], COMPONENTS[j]) for j in columns]
    name = r"$\dot{z}$" if len(columns) == 1 else "$V_i$"
    return over_time(run.system, np.asarray(run.times)[rows], series, name, ax, modes=modes_of(run), size=speed)


def attitude(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """The orientation of the body: φ of the disk, rad; for the ball, the vertical Γ = Λ⁻¹e3 in body axes.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a reduced trajectory, a batch, or a three-dimensional ``ax``.
    """
    run = drawn_run(trajectory)
    times, _, observables = record(run)
    if isinstance(run.system, Disk):
        state: Any = run.state
        phi = np.asarray(state.phi)[finite_rows(run)]
        series, name = [Series(phi, "", COMPONENTS[0])], r"$\phi$ (rad)"
    else:
        Gamma = observables.vertical_body
        series, name = [Series(Gamma[:, j], rf"$\Gamma_{j + 1}$", COMPONENTS[j]) for j in range(3)], r"$\Gamma_i$"
    return over_time(run.system, times, series, name, ax, modes=modes_of(run), size=1.0)


def _velocity(run: Trajectory) -> Float[np.ndarray, "T 3"]:
    """V = rω × e3, plus the velocity of a turntable under the centre."""
    omega, r = record(run).observables.angular_velocity_space, float(run.system.radius)
    V = r * np.stack([omega[:, 1], -omega[:, 0], 0.0 * omega[:, 0]], axis=1)
    drift = _drift(run.system, to_array(np.asarray(run.times)), run.state)
    if drift is not None:
        V[:, :2] += np.asarray(drift)[finite_rows(run)]
    return V


@programs.filter_jit
def _drift(system, times, states):
    return jax.vmap(system.prepare().drift)(times, states)


def height(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """The height h of the body above the plane, for a run with a law of contact.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns with a ``contact``.

    **Raises:** ``ValueError`` for a run without a law of contact, a batch, or a three-dimensional ``ax``.

    **Example:**

    >>> from jaxball import Contact, Disk, DiskState, ReleasedState, plot, simulate
    >>> thrown = ReleasedState(DiskState(), V=(1.0, 0.0, 0.0), height=0.1)
    >>> run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], thrown, contact=Contact(sliding=0.2))
    >>> plot.height(run).get_ylabel()
    '$h$'
    """
    run = _of_contact(trajectory)
    values = np.asarray(_history(run).height)
    return _one(run, values, "$h$", sizes_of(run.system).length, ax)


def slip_speed(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """|v_s|, the speed of the body's lowest point along the plane, for a run with a law of contact.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns with a ``contact``.

    **Raises:** as :func:`height`, also for a three-dimensional ``ax``.

    **Example:**

    >>> from jaxball import Contact, Disk, DiskState, ReleasedState, plot, simulate
    >>> thrown = ReleasedState(DiskState(), V=(1.0, 0.0, 0.0), height=0.1)
    >>> run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], thrown, contact=Contact(sliding=0.2))
    >>> [band.get_label() for band in plot.slip_speed(run).patches]
    ['flight', 'sliding']
    """
    run = _of_contact(trajectory)
    values = np.linalg.norm(np.asarray(_history(run).slip)[:, :2], axis=1)
    return _one(run, values, r"$|\,\mathbf{v}_s|$", sizes_of(run.system).speed, ax)


def of_contact(trajectory: Trajectory[Any, Any]) -> list[Callable[..., Axes]]:
    """The figures of height and slip speed that are not empty, none without a law of contact."""
    history, rows = trajectory.contact, finite_rows(trajectory)
    if history is None:
        return []
    sizes = sizes_of(trajectory.system)
    moves = {
        height: without_rounding(np.asarray(history.height), sizes.length),
        slip_speed: without_rounding(np.asarray(history.slip)[:, :2], sizes.speed),
    }
    return [draw for draw, values in moves.items() if np.any(values[rows])]


def _one(run: Trajectory, values: Float[np.ndarray, " T"], name: str, size: float, ax: Axes | None) -> Axes:
    rows = finite_rows(run)
    series = [Series(values[rows], "", COMPONENTS[0])]
    ax = over_time(run.system, np.asarray(run.times)[rows], series, name, ax, modes=modes_of(run), size=size)
    up_to_ticks(ax, low=0.0)
    return ax


def _of_contact(trajectory: Trajectory) -> Trajectory:
    """The run, with the states on both sides of its switches."""
    require_one(trajectory)
    if trajectory.contact is None:
        raise ValueError(
            "Argument `trajectory` must be of a run with a law of contact, but it has none; a body that rolls neither "
            "slips nor leaves the plane. Give one: simulate(..., contact=Contact(sliding=0.3))."
        )
    return drawn_run(trajectory)


def _history(run: Trajectory) -> ContactHistory:
    assert run.contact is not None
    return run.contact


def measurements(trajectory: Trajectory[Any, Any], sensors: Mapping[str, AbstractSensor]) -> Figure:
    """The readings of sensors, each in a panel under its name: a vector by its components along its axes.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.
    - ``sensors``: one or more of those of :mod:`jaxball.sensors`, by name.

    **Raises:** ``ValueError`` for a batch, without sensors, and as :meth:`jaxball.Trajectory.measured`.
    """
    require_one(trajectory)
    if not sensors:
        raise ValueError("Argument `sensors` must have one sensor or more to draw, but it is empty.")
    run = drawn_run(trajectory)
    rows, modes = finite_rows(run), modes_of(run)
    times, found = np.asarray(run.times)[rows], run.measured(sensors)
    figure = Figure(figsize=(WIDE[0], 0.5 + PANEL * len(sensors)), layout="constrained")
    caption(figure, trajectory.system)
    panels = figure.subplots(len(sensors), 1, sharex=True, squeeze=False)[:, 0]
    for ax, (name, leaf) in zip(panels, found.items(), strict=True):
        columns = np.asarray(leaf)[rows].reshape(len(rows), -1).T
        drawn, *lines = with_breaks(modes, times, *columns)
        labels = [rf"$x_{{{k}}}$" for k in range(1, len(lines) + 1)] if len(lines) > 1 else [""]
        looks = (COMPONENTS[k % len(COMPONENTS)] for k in range(len(lines)))
        series = [Series(*one) for one in zip(lines, labels, looks, strict=True)]
        over_time(trajectory.system, drawn, series, name, ax, modes=modes)
        ax.label_outer()
    share_bands(figure)
    return figure
