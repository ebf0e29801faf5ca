"""One body of a view: its parts, and its numbers at the saved times that its solve reached."""

from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ...numerics import programs
from ...numerics.arrays import to_array
from ...numerics.vectors import apply, cross
from ...physics.body import Disk, System
from ...physics.load import in_three
from ...physics.moments import velocity_moments
from ...physics.momentum import contact_momentum
from ...physics.state import ReducedState
from ...simulation.trajectory import Trajectory
from ..coordinates import angles_of
from ..floor import Setting, place, setting_of
from ..mechanisms import arms_of_run
from ..modes import modes_of
from ..palette import mass_colour
from ..record import Record, drawn_run, finite_rows, known_rows, record_to_show, require_one
from ..shapes import rails_of
from .packing import Numbers, sampled
from .scene import SUBSCRIPTS, continuous, made

ON_RAILS = 1e-3  # radii, the allowed error of a rail between its points


class Shown(NamedTuple):
    """A run, and the parts of it that are drawn."""

    trajectory: Trajectory
    run: Record
    setting: Setting
    angles: dict[int, np.ndarray]  # θ of the masses on rails

    @property
    def system(self) -> System:
        return self.trajectory.system

    @property
    def radius(self) -> float:
        return float(self.system.radius)


def shown(trajectory: Trajectory[Any, Any]) -> Shown:
    """A run to be shown.

    **Raises:** ``ValueError`` if it cannot be shown.
    """
    require_one(trajectory)
    if isinstance(trajectory.state, ReducedState):
        raise ValueError(
            "Argument `trajectory` must contain the position of the ball, but it is of a ReducedState; simulate with a "
            "BallState."
        )
    known_rows(trajectory)
    trajectory = drawn_run(trajectory)
    run = record_to_show(trajectory)
    return Shown(trajectory, run, setting_of(trajectory.system, run.times), angles_of(trajectory))


def body_document(one: Shown) -> dict[str, Any]:
    """The parts of the body."""
    system = one.system
    kind = "disk" if isinstance(system, Disk) else "ball"
    parts = made(kind, one.trajectory, one.radius, len(one.run.times)) | {
        "shell": {"mass": float(system.mass), "centre_of_mass": np.asarray(system.offset).tolist()},
        "masses": _masses(system),
        "rails": [{"colour": mass_colour(members[0])} for members, _ in rails_of(system)],
        "arms": [mass_colour(j) for j in range(system.n_masses + 1, system.n_masses + len(system.mechanisms) + 1)],
    }
    modes = modes_of(one.trajectory)
    if modes is None:
        return parts
    spells = [[spell.mode.name.lower(), spell.start, spell.end] for spell in modes.spells]
    return parts | {"spells": spells, "switches": modes.switches.tolist()}


def body_numbers(one: Shown, plane: float) -> dict[str, Numbers]:
    """The numbers of the body above a plane at ``plane`` below the origin, which may differ from its own radius."""
    system, run, setting, r = one.system, one.run, one.setting, one.radius
    placed, seen = place(run, setting), run.observables
    numbers = {
        "time": Numbers(run.times, 0.0),
        "centre": Numbers(placed.centre + (r - plane) * setting.page[:, 2], r),
        "quaternion": Numbers(continuous(Rotation.from_matrix(placed.Lambda).as_quat()), 1.0),
        "masses": Numbers(seen.mass_positions_body, r),
    }
    numbers |= {f"arms_{j}": Numbers(points, r) for j, points in enumerate(arms_of_run(one.trajectory))}
    if np.any(setting.moved):
        numbers["moved"] = Numbers(setting.moved, r)
    if setting.turned is not None:
        numbers["turned"] = Numbers(setting.turned, 1.0)
    numbers |= {
        f"rail_{j}": Numbers(sampled(points, ON_RAILS * r), r, over_time=False)
        for j, (_, points) in enumerate(rails_of(system))
    }
    numbers |= {
        "angular_velocity": Numbers(seen.angular_velocity_body),
        "angular_momentum": Numbers(_momentum_of(one)),
        "normal_force": Numbers(seen.normal_force),
        "friction": Numbers(seen.friction),
        "energies": Numbers(np.stack([seen.kinetic_energy, seen.potential_energy], axis=1)),
    }
    if isinstance(system, Disk):
        numbers["turning"] = Numbers(-seen.angular_velocity_body[:, 1])
    history, rows = one.trajectory.contact, finite_rows(one.trajectory)
    if history is not None:
        numbers |= {
            "height": Numbers(np.asarray(history.height)[rows], r),
            "slip": Numbers(np.asarray(history.slip)[rows, :2]),
            "taken": Numbers(np.stack([history.rubbed, history.struck], axis=1)[rows]),
        }
    if one.angles:
        numbers["mass_angles"] = Numbers(np.stack(list(one.angles.values()), axis=1))
    if system.mechanisms:
        numbers["joint_angles"] = Numbers(seen.joint_angles)
    return numbers


def _momentum_of(one: Shown) -> Float[np.ndarray, "T 3"]:
    trajectory = one.trajectory
    slips = None if trajectory.contact is None else trajectory.contact.slip
    found = _momentum(one.system, to_array(trajectory.times), trajectory.state, slips)
    return np.asarray(found)[finite_rows(trajectory)]


@programs.filter_jit
def _momentum(system, times, states, slips):
    """Π about the body's lowest point at each time, in body axes; velocities are relative to the plane."""
    prepared = system.prepare()

    def at_time(t, state, slip):
        in_space, r = state.in_space(), prepared.radius
        Gamma = in_space.Lambda[2]
        at = velocity_moments(prepared, t, (state.theta, state.thetadot))
        Pi = contact_momentum(at, r, in_space.Omega, Gamma)
        u = prepared.drift(t, in_space)
        for v in (None if u is None else in_three(u), slip):  # of the lowest point
            if v is not None:
                Pi = Pi + cross(at.M * r * Gamma + at.p, apply(in_space.Lambda.T, v))
        return Pi

    return jax.vmap(at_time)(times, states, slips)


def _masses(system: System) -> list[dict[str, Any]]:
    """Name, colour and mass of each, in the order of the observables."""
    found = [(f"m{i}", i, mass.mass) for i, mass in enumerate(system.point_masses, start=1)]
    for j, mechanism in enumerate(system.mechanisms, start=1):
        found += [(f"M{j}", system.n_masses + j, mass) for mass in np.asarray(mechanism.mass)]
    return [
        {"name": name.translate(SUBSCRIPTS), "colour": mass_colour(k), "mass": float(mass)} for name, k, mass in found
    ]
