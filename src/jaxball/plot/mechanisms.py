"""Mechanisms in figures: the names and colours of their masses, their arms, and their joints over time."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float
from matplotlib.axes import Axes

from ..numerics import programs
from ..numerics.arrays import to_array
from ..physics.body import System
from ..simulation.trajectory import Trajectory
from .modes import draw_modes, modes_of
from .record import Record, finite_rows, record
from .style import legend_above, mass_colour, mass_line, named, plane_axes, sharing, up_to_ticks, zero_line

ROUNDING = 1e-12  # of M g r, below which an effort is drawn as none
COINCIDENT = 1e-9  # of the largest value, by which curves on one another may differ


class Look(NamedTuple):
    """How a mass is shown: its name, and the number whose colour it has."""

    name: str
    number: int

    @property
    def colour(self) -> str:
        return mass_colour(self.number)


def looks(system: System) -> list[Look]:
    """Each mass of a body: point masses m_i one by one, and those of a mechanism together as M_j."""
    shown = [Look(f"$m_{{{i}}}$", i) for i in range(1, system.n_masses + 1)]
    for j, mechanism in enumerate(system.mechanisms, start=1):
        shown += [Look(f"$M_{{{j}}}$", system.n_masses + j)] * mechanism.mass.shape[-1]
    return shown


def arms(
    system: System, times: Float[np.ndarray, " T"], theta: Float[np.ndarray, "T coordinates"]
) -> list[Float[np.ndarray, "T n points 3"]]:
    """For each mechanism, the arms of its masses, body vectors from the geometric centre."""
    return [np.asarray(found) for found in _arms(system, to_array(times), to_array(theta))]


def arms_of_run(trajectory: Trajectory) -> list[Float[np.ndarray, "T n points 3"]]:
    """The arms along a run, at the times that are drawn."""
    rows = finite_rows(trajectory)
    return arms(trajectory.system, np.asarray(trajectory.times)[rows], np.asarray(trajectory.state.theta)[rows])


@programs.filter_jit
def _arms(system: System, times, theta) -> list[Array]:
    prepared = system.prepare()
    places: dict[int, Array] = {}
    for group, order in zip(prepared.mechanism_groups, prepared.mechanism_order, strict=True):
        slots = prepared.slots(order, group.in_state)

        def one(mechanism, t, own):
            return mechanism.arms(mechanism.rates(t, (own, own, own))[0])

        found = jax.vmap(
            lambda t, theta, group=group, slots=slots, one=one: eqx.filter_vmap(one, in_axes=(0, None, 0))(
                group, t, theta[slots]
            )
        )(times, theta)
        places |= {index: found[:, k] for k, index in enumerate(order)}
    return [places[index] for index in sorted(places)]


def joint_angles(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """θ of every joint of the mechanisms: rad of a hinge, a length of a slider.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a body without mechanisms, a reduced trajectory, a batch, or a three-dimensional
    ``ax``.
    """
    run = _record(trajectory)
    return _over_time(trajectory, run.times, run.observables.joint_angles, r"\theta", "joint angle", ax)


def joint_efforts(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Q of every joint of the mechanisms: the torque of a hinge, the force along a slider.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** as :func:`joint_angles`, also for a three-dimensional ``ax``.
    """
    run, system = _record(trajectory), trajectory.system
    least = ROUNDING * float(system.total_mass * system.gravity * system.radius)
    efforts = run.observables.joint_efforts
    ax = _over_time(trajectory, run.times, np.where(np.abs(efforts) > least, efforts, 0.0), "Q", "joint effort", ax)
    zero_line(ax)
    return ax


def _record(trajectory: Trajectory) -> Record:
    run = record(trajectory)
    if not trajectory.system.mechanisms:
        raise ValueError("Argument `trajectory` must be of a body with mechanisms, whose joints are drawn.")
    return run


def _over_time(trajectory: Trajectory, times, values: Float[np.ndarray, "T joints"], symbol, label, ax) -> Axes:
    system = trajectory.system
    ax = plane_axes(ax, system=system)
    joints = [(j, a) for j, one in enumerate(system.mechanisms, start=1) for a in range(1, one.n_joints + 1)]
    for k, (j, a) in enumerate(joints):
        ax.plot(times, values[:, k], label=rf"${symbol}_{{{j},{a}}}$", **mass_line(k + 1, **_dashes(values, k)))
    draw_modes(ax, modes_of(trajectory))
    ax.margins(x=0)
    up_to_ticks(ax)
    named(ax, "$t$", label)
    legend_above(ax)
    return ax


def _dashes(values: Float[np.ndarray, "T joints"], k: int) -> dict[str, Any]:
    """The dashes of a curve that lies on others, which all show."""
    near = np.max(np.abs(values - values[:, [k]]), axis=0, initial=0.0)
    same = near <= COINCIDENT * np.max(np.abs(values), initial=0.0)
    return sharing(int(np.sum(same[:k])), int(np.sum(same)))
