"""Figures of the motion of a body: the velocity of its centre, and its orientation."""

from typing import Any

import jax
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from ..numerics import programs
from ..numerics.arrays import to_array
from ..physics.body import Disk
from ..simulation.trajectory import Trajectory
from .modes import modes_of
from .over_time import Series, over_time, sizes_of, without_rounding
from .palette import COMPONENTS
from .record import drawn_run, finite_rows, record


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
    """V = rω × e3, plus the velocity of the plane under the centre."""
    omega, r = record(run).observables.angular_velocity_space, float(run.system.radius)
    V = r * np.stack([omega[:, 1], -omega[:, 0], 0.0 * omega[:, 0]], axis=1)
    ground = run.system.ground
    if ground is None or (ground.motion is None and ground.turntable is None):
        return V
    drift = np.asarray(_drift(run.system, to_array(np.asarray(run.times)), run.state))[finite_rows(run)]
    V[:, : drift.shape[1]] += drift
    return V


@programs.filter_jit
def _drift(system, times, states):
    prepared = system.prepare()
    return jax.vmap(prepared.drift)(times, states)
