"""Figures of quantities over time: velocities, orientation, energies, forces, and the readings of sensors."""

import itertools
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, cast

import jax
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .. import programs
from ..files.scenario.units import Units
from ..numerics.arrays import to_array
from ..physics.contact.modes import Mode
from ..physics.dynamics.footing import footing, velocity_of_centre
from ..physics.sensors import AbstractSensor
from ..simulation.trajectory import Trajectory, always_rolls
from .over_time import Series, components, over_run, over_time, share_bands, sizes_of, without_rounding
from .palette import COMPONENTS, DASHED, DOTTED, INK, TAKEN
from .record import finite_rows, record, require_one, require_one_of_body, with_jumps
from .style import (
    label_axes,
    label_of_run,
    label_with,
    legend_above,
    linestyle,
    plane_axes,
    stacked_panels,
    up_to_ticks,
    write,
)

if TYPE_CHECKING:
    from ..simulation.extremes import ContactExtremes

SHORT = 4  # entries in a row of a legend that has long ones
CONSTANT = 1e-6  # a force with a smaller relative change counts as constant
PANEL_HEIGHT = 1.5  # the height of a panel, in inches


def angular_velocity(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Draws φ̇ of the disk, ``fig_disk_dot_angle``, or the body components Ω_i of the ball, ``fig_ball_Omega``.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a reduced trajectory, a batch, or a three-dimensional ``ax``.
    """
    run = with_jumps(trajectory)
    Omega, size = record(run).observables.angular_velocity_body, 1 / sizes_of(run.system).time
    if run.system.planar:
        series, name = [Series(-Omega[:, 1], "", COMPONENTS[0])], r"$\dot{\phi}$"
    else:
        series, name = components(Omega, r"\Omega"), r"$\Omega_i$"
    return over_run(run, series, name, ax, size=size, dimension="rad/time")


def energies(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Draws kinetic energy T, potential energy V and their sum E, which is dashed so that a T beneath it is visible.

    For a run with a law of contact, the energy dissipated so far by sliding friction and impacts is drawn too.

    ``trajectory``, ``ax`` and what is raised: as for :func:`angular_velocity`.

    **Example:**

    >>> from jaxball import Disk, DiskState, plot, simulate
    >>> run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], DiskState(phidot=-1.0))
    >>> ax = run.plot("energies")
    >>> [text.get_text() for text in ax.get_legend().get_texts()]
    ['$T$', '$V$', '$E = T + V$']
    """
    run = with_jumps(trajectory)
    seen, size = record(run).observables, sizes_of(run.system).energy
    series = [
        Series(seen.kinetic_energy, "$T$", COMPONENTS[0]),
        Series(seen.potential_energy, "$V$", COMPONENTS[1]),
        Series(seen.kinetic_energy + seen.potential_energy, "$E = T + V$", INK, DASHED),
    ]
    amounts = np.asarray(energy_losses(run))[:, finite_rows(run)]
    losses = (Series(values, name, *look) for (name, look), values in zip(TAKEN.items(), amounts, strict=True))
    series += [curve for curve in losses if np.any(without_rounding(curve.values, size))]
    return over_run(run, series, "energy", ax, size=size, most=SHORT, dimension="energy")


def power(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Draws Ė, the total power of the actuation, the external force and everything else that does work.

    ``trajectory``, ``ax`` and what is raised: as for :func:`angular_velocity`.
    """
    run = with_jumps(trajectory)
    series = [Series(record(run).observables.power, "", COMPONENTS[0])]
    return over_run(run, series, r"$\dot{E}$", ax, size=sizes_of(run.system).power, jumps=True, dimension="power")


def contact_force(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Draws the force of the plane: the normal force N and the magnitude |f| of the friction.

    With dense output, the least N of the whole run is marked. For a run with a law of contact, the largest static
    friction, μ_s N, is drawn instead, if there is any.

    ``trajectory``, ``ax`` and what is raised: as for :func:`angular_velocity`.
    """
    run = with_jumps(trajectory)
    times, seen = record(run)
    N, f = seen.normal_force, np.linalg.norm(seen.friction, axis=1)
    series = [Series(N, "$N$", COMPONENTS[0]), Series(f, r"$|\,\mathbf{f}\,|$", COMPONENTS[1])]
    if (static := float(run.history.coefficients.get("static_friction", 0.0))) > 0:
        series.append(Series(static * N, r"$\mu_s N$", INK, DASHED))
    ax = over_run(run, series, "contact force", ax, size=sizes_of(run.system).force, jumps=True, dimension="force")
    up_to_ticks(ax, low=0.0)
    if trajectory.interpolant is not None and always_rolls(trajectory):
        extremes = _extremes(trajectory)
        time, least = float(extremes.least_normal_force_time), float(extremes.least_normal_force)
        # A least value within rounding of all others has no time of its own.
        constant = bool(len(times)) and bool(np.max(N) - least <= CONSTANT * abs(least))
        time, when = _moment(time, times, constant)
        _mark(ax, time, least, rf"least $N = {least:.4g}$ {when}", COMPONENTS[0])
    return ax


def friction_ratio(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Draws |f| / N, with its largest value μ_min marked: with less friction the ball would slip.

    With dense output the largest value of the whole run is marked, otherwise the largest at the saved times. Where N ≤
    0 the ball would leave the plane: nothing is drawn there, and a note replaces the mark. For a run with a law of
    contact, its coefficients are drawn instead of a mark, and nothing in flight.

    ``trajectory``, ``ax`` and what is raised: as for :func:`angular_velocity`.
    """
    run = with_jumps(trajectory)
    times, observables = record(run)
    # Where the forces are rounding, their ratio is, too.
    ratio = without_rounding(observables.friction_ratio, 1.0)
    if run.history.coefficients:
        return _within_the_cone(run, times, ratio, ax)
    on_plane = np.isfinite(ratio)
    drawn = np.where(on_plane, ratio, np.nan)
    ax = over_time(trajectory, times, [Series(drawn, "", COMPONENTS[0])], r"$|\,\mathbf{f}\,|/N$", ax)
    label_axes(ax, label_of_run(trajectory, "$t$", "time"))
    up_to_ticks(ax, low=0.0)
    if not np.all(on_plane):
        sentence = rf"not drawn where $N \leq 0$, first {_moment(float(times[~on_plane][0]), times)[1]}"
        write(ax, (0.5, 1.02), sentence, transform=ax.transAxes, ha="center", va="bottom")
    elif len(ratio):
        time, mu = _largest_ratio(trajectory, times, ratio)
        mu = float(without_rounding(np.asarray(mu), 1.0))
        time, when = _moment(time, times, bool(mu - np.min(ratio) <= CONSTANT * mu))
        _mark(ax, time, mu, rf"$\mu_{{\min}} = {mu:.4g}$ {when}", COMPONENTS[1])
        # Once more, for the mark that has been added.
        up_to_ticks(ax, low=0.0)
    return ax


def _within_the_cone(
    trajectory: Trajectory,
    times: Float[np.ndarray, " T"],
    ratio: Float[np.ndarray, " T"],
    ax: Axes | None,
) -> Axes:
    """Draws |f| / N with the coefficients of the law that are not 0; Coulomb's friction never exceeds the larger."""
    history = trajectory.history
    flies = np.asarray(history.over_time["mode"])[finite_rows(trajectory)] == Mode.FLIGHT
    static, kinetic = (float(history.coefficients[name]) for name in ("static_friction", "friction"))
    coefficients = {rf"$\mu_s = {static:.4g}$": (static, DASHED), rf"$\mu = {kinetic:.4g}$": (kinetic, DOTTED)}
    if static == kinetic:
        coefficients = {rf"$\mu_s = \mu = {static:.4g}$": (static, DASHED)}
    ends = times[[0, -1]] if len(times) else times
    ax = plane_axes(ax, shown=trajectory)
    for label, (value, dashes) in coefficients.items():
        if value == 0:
            continue  # of a smooth plane, or of friction that fades with the slip and exceeds it
        ax.plot(ends, np.full_like(ends, value), color=INK, linestyle=linestyle(dashes), linewidth=0.9, label=label)
    series = [Series(np.where(flies, np.nan, ratio), "", COMPONENTS[0])]
    ax = over_run(trajectory, series, r"$|\,\mathbf{f}\,|/N$", ax, most=SHORT, jumps=True)
    up_to_ticks(ax, low=0.0)
    return ax


def _mark(ax: Axes, t: float, value: float, label: str, color: str) -> None:
    """Draws a dot where a quantity is extreme."""
    ax.plot(t, value, "o", ms=5, color=color, linestyle="none", label=label, clip_on=False)
    legend_above(ax)


def _extremes(trajectory: Trajectory) -> "ContactExtremes":
    # Imported here, because it imports all solvers, and a saved run has no dense output.
    from ..simulation.extremes import contact_extremes

    return contact_extremes(trajectory)


def _largest_ratio(trajectory: Trajectory, times: np.ndarray, ratio: np.ndarray) -> tuple[float, float]:
    """Finds the time and the value of the largest |f| / N, of the whole run where it has dense output."""
    if trajectory.interpolant is not None and always_rolls(trajectory):
        extremes = _extremes(trajectory)
        return float(extremes.friction_needed_time), float(extremes.friction_needed)
    k = int(np.argmax(ratio))
    return float(times[k]), float(ratio[k])


def _moment(t: float, times: Float[np.ndarray, " T"], constant: bool = False) -> tuple[float, str]:
    """Returns where to mark an extreme, and the words for its time, to five digits of the duration of the run."""
    if constant:
        return float(times[0]), "throughout"
    span = float(times[-1] - times[0])
    # Five digits of the duration, which is as exact as a reader can use.
    return t, rf"at $t = {round(t, 4 - math.floor(math.log10(span))) if span > 0 else t:g}$"


def centre_velocity(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Draws the velocity V of the geometric centre, space axes: ż of the disk, V_1 and V_2 of the ball.

    For a body that leaves the plane, V_3 is drawn too.

    ``trajectory``, ``ax`` and what is raised: as for :func:`angular_velocity`.

    **Example:**

    >>> from jaxball import Disk, DiskState, plot, simulate
    >>> run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], DiskState(phidot=-1.0))
    >>> print(run.plot("centre_velocity").lines[0].get_ydata())
    [1. 1. 1.]
    """
    require_one_of_body(trajectory)
    run = with_jumps(trajectory)
    rows, speed, system = finite_rows(run), sizes_of(run.system).speed, run.system
    if "V" in run.history.over_time:
        V = np.asarray(run.history.over_time["V"])[rows]
    else:
        V = np.asarray(_of_rolling(system, to_array(np.asarray(run.times)), run.state))[rows]
    rises = bool(np.any(without_rounding(V[:, 2], speed)))
    columns = [j for j in range(3) if (j != 1 or not run.system.planar) and (j != 2 or rises)]
    labels = {j: rf"$V_{j + 1}$" for j in columns} if len(columns) > 1 else {0: ""}
    series = [Series(V[:, j], labels[j], COMPONENTS[j]) for j in columns]
    name = r"$\dot{z}$" if len(columns) == 1 else "$V_i$"
    return over_run(run, series, name, ax, size=speed, dimension="length/time")


def attitude(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Draws the orientation of the body: φ of the disk, rad; for the ball, the vertical Γ = Λ⁻¹e3 in body axes.

    ``trajectory``, ``ax`` and what is raised: as for :func:`angular_velocity`.
    """
    run = with_jumps(trajectory)
    Gamma, state = record(run).observables.vertical_body, cast(Any, run.state)
    if run.system.planar:
        series = [Series(np.asarray(state.phi)[finite_rows(run)], "", COMPONENTS[0])]
        return over_run(run, series, r"$\phi$ (rad)", ax, size=1.0)
    return over_run(run, components(Gamma, r"\Gamma"), r"$\Gamma_i$", ax, size=1.0)


def own_states(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Draws the states of one's own beside a body, its :class:`~jaxball.physics.OwnStates`, by their names and units.

    ``trajectory``, ``ax`` and what is raised: as for :func:`angular_velocity`, and for a body without such states.
    """
    require_one_of_body(trajectory)
    states = trajectory.system.own_states
    if states is None:
        raise ValueError("Argument `trajectory` must be of a body with `own_states`, but it has none.")
    run = with_jumps(trajectory)
    values, units = np.asarray(cast(Any, run.state).own)[finite_rows(run)], Units()
    if run.scenario is not None and run.scenario.units is not None:
        units = run.scenario.units
    # A unit that all have stands on the axis, others beside the names.
    own_units = states.units_in(units.of)
    shared = own_units[0] if len(set(own_units)) == 1 else ""
    names = [
        label_with(name, unit if unit != shared else "") for name, unit in zip(states.names, own_units, strict=True)
    ]
    colours = itertools.cycle(COMPONENTS)
    if len(names) == 1:
        return over_run(run, [Series(values[:, 0], "", next(colours))], label_with(names[0], shared), ax)
    series = [Series(column, name, colour) for column, name, colour in zip(values.T, names, colours, strict=False)]
    return over_run(run, series, label_with("own states", shared), ax)


@programs.filter_jit
def _of_rolling(system, times, states):
    """Computes the velocity of the centre of a body that rolls."""
    prepared = system.prepare()

    def velocity(t, state):
        return velocity_of_centre(prepared, state.in_space(), footing(prepared, t, state))

    return jax.vmap(velocity)(times, states)


def height(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Draws the height h of the body above the ground, for a run with a law of contact.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns with a ``contact``.

    **Raises:** ``ValueError`` for a run without a law of contact, a batch, or a three-dimensional ``ax``.

    **Example:**

    >>> from jaxball import Contact, Disk, DiskState, plot, simulate
    >>> from jaxball.physics import ReleasedState
    >>> thrown = ReleasedState(DiskState(), V=(1.0, 0.0, 0.0), height=0.1)
    >>> run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], thrown, contact=Contact(friction=0.2))
    >>> run.plot("height").get_ylabel()
    '$h$'
    """
    run = _of_contact(trajectory)
    h = np.asarray(run.history.over_time["height"])
    return _from_zero(run, h, "$h$", "length", sizes_of(run.system).length, ax)


def slip_speed(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Draws |v_s|, the speed of the body's lowest point along the ground, for a run with a law of contact.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns with a ``contact``.

    **Raises:** as :func:`height`, also for a three-dimensional ``ax``.

    **Example:**

    >>> from jaxball import Contact, Disk, DiskState, plot, simulate
    >>> from jaxball.physics import ReleasedState
    >>> thrown = ReleasedState(DiskState(), V=(1.0, 0.0, 0.0), height=0.1)
    >>> run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], thrown, contact=Contact(friction=0.2))
    >>> [band.get_label() for band in run.plot("slip_speed").patches]
    ['flight', 'sliding']
    """
    run = _of_contact(trajectory)
    speed = np.linalg.norm(np.asarray(run.history.over_time["slip"])[:, :2], axis=1)
    return _from_zero(run, speed, r"$|\,\mathbf{v}_s|$", "length/time", sizes_of(run.system).speed, ax)


def of_contact(trajectory: Trajectory[Any, Any]) -> list[Callable[..., Axes]]:
    """Lists the figures of height and slip speed that are not empty, none without a law of contact."""
    quantities, sizes, rows = trajectory.history.over_time, sizes_of(trajectory.system), finite_rows(trajectory)
    moves = {"height": (height, 1, sizes.length), "slip": (slip_speed, 2, sizes.speed)}
    of_run = {name: np.asarray(quantities[name])[rows].reshape(len(rows), -1) for name in moves if name in quantities}
    drawn = (moves[name] + (values,) for name, values in of_run.items())
    # A disk slips along its line only.
    return [draw for draw, along, size, values in drawn if np.any(without_rounding(values[:, :along], size))]


def energy_losses(trajectory: Trajectory[Any, Any]) -> list[Float[np.ndarray, " T"]]:
    """Returns the energies dissipated so far by sliding friction and by impacts, 0 without a law of contact."""
    quantities, nothing = trajectory.history.over_time, np.zeros(len(trajectory.times))
    return [np.asarray(quantities.get(name, nothing)) for name in ("friction_loss", "impact_loss")]


def _from_zero(
    run: Trajectory, values: Float[np.ndarray, " T"], name: str, dimension: str, size: float, ax: Axes | None
) -> Axes:
    series = [Series(values[finite_rows(run)], "", COMPONENTS[0])]
    ax = over_run(run, series, name, ax, size=size, dimension=dimension)
    up_to_ticks(ax, low=0.0)
    return ax


def _of_contact(trajectory: Trajectory) -> Trajectory:
    """Returns the run of a body that may slip and fly, with the states on both sides of its switches."""
    require_one_of_body(trajectory)
    run = with_jumps(trajectory)
    if "height" not in run.history.over_time:
        raise ValueError(
            "Argument `trajectory` must be of a run with a law of contact, but it has none; a body that rolls neither "
            "slips nor leaves the plane. Give one: simulate(..., contact=Contact(friction=0.3))."
        )
    return run


def measurements(trajectory: Trajectory[Any, Any], sensors: Mapping[str, AbstractSensor]) -> Figure:
    """Draws the readings of sensors, each in a panel under its name: a vector by its components along its axes.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.
    - ``sensors``: one or more of those of :mod:`jaxball.physics.sensors`, by name.

    **Raises:** ``ValueError`` for a batch, without sensors, and as :meth:`jaxball.Trajectory.measured`.
    """
    require_one(trajectory)
    if not sensors:
        raise ValueError("Argument `sensors` must have one sensor or more to draw, but it is empty.")
    run = with_jumps(trajectory)
    rows = finite_rows(run)
    figure, panels = stacked_panels(len(sensors), PANEL_HEIGHT, 0.5, trajectory)
    for ax, (name, leaf) in zip(panels, run.measured(sensors).items(), strict=True):
        columns = np.asarray(leaf)[rows].reshape(len(rows), -1).T
        labels = [rf"$x_{{{k}}}$" for k in range(1, len(columns) + 1)] if len(columns) > 1 else [""]
        series = [Series(*fields) for fields in zip(columns, labels, itertools.cycle(COMPONENTS), strict=False)]
        over_run(run, series, name, ax, jumps=True, dimension=sensors[name].units)
        ax.label_outer()
    share_bands(figure)
    return figure
