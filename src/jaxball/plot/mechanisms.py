"""Mechanisms in figures: the names and colours of their masses, their arms, and their joints over time."""

from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float
from matplotlib.axes import Axes

from ..numerics import programs
from ..numerics.arrays import to_array
from ..physics.body import System
from ..simulation.trajectory import Trajectory
from .coordinates import unit_of, units_of
from .modes import modes_of
from .over_time import Series, over_time, sizes_of
from .palette import mass_colour, mass_look
from .record import drawn_run, finite_rows, record
from .style import zero_line


class Look(NamedTuple):
    """The name of a mass, and the number that determines its colour."""

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
    """θ of every joint of the mechanisms: rad for a hinge, a length for a slider.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a body without mechanisms, a reduced trajectory, a batch, or a three-dimensional
    ``ax``.
    """
    run = _run(trajectory)
    units = units_of([unit_of(joint) for one in run.system.mechanisms for joint in getattr(one, "joints", ())])
    name = rf"$\theta_{{j,a}}${units}"
    return _of_joints(run, record(run).observables.joint_angles, r"\theta", name, 1.0, ax)


def joint_efforts(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Q of every joint of the mechanisms: the torque of a hinge, the force along a slider.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** as :func:`joint_angles`, also for a three-dimensional ``ax``.
    """
    run = _run(trajectory)
    size = sizes_of(run.system).energy
    ax = _of_joints(run, record(run).observables.joint_efforts, "Q", "joint effort", size, ax)
    zero_line(ax)
    return ax


def _run(trajectory: Trajectory) -> Trajectory:
    run = drawn_run(trajectory)
    if not run.system.mechanisms:
        raise ValueError("Argument `trajectory` must be of a body with mechanisms, whose joints are drawn.")
    return run


def _of_joints(
    run: Trajectory, values: Float[np.ndarray, "T joints"], symbol: str, label: str, size: float, ax: Axes | None
) -> Axes:
    joints = [(j, a) for j, one in enumerate(run.system.mechanisms, start=1) for a in range(1, one.n_joints + 1)]
    series = [Series(values[:, k], rf"${symbol}_{{{j},{a}}}$", *mass_look(k + 1)) for k, (j, a) in enumerate(joints)]
    return over_time(run.system, record(run).times, series, label, ax, modes=modes_of(run), size=size)
