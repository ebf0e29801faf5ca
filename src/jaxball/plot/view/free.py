"""Bodies without a plane in a view: rigid bodies about a point at rest or their centre, and particles."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ... import programs
from ...classical import HeavyTop, RollingEllipsoid, SuslovProblem, VakonomicState
from ...numerics.arrays import to_array
from ...simulation.trajectory import Trajectory
from ..palette import COMPONENTS
from ..record import require_finite_rows
from .scene import (
    BLUE,
    PAIR,
    SUBSCRIPTS,
    Numbers,
    Scene,
    angular_velocity,
    continuous,
    each,
    energies,
    free_stand,
    graph,
    law_changes,
    laws,
    make_body,
    series,
)

THINNEST = 0.04  # of the largest semi-axis: no other is drawn smaller
BODIES_APART = 3.2  # between the fixed points of two bodies, in radii of the largest
REACH = 1.25  # of the tip whose path is drawn, in radii
ARROW_RADIUS = 1 / 24  # of the largest extent of all paths of particles: the radius that arrows and dots are drawn by

AXES = tuple({"name": f"E{k}".translate(SUBSCRIPTS), "colour": colour} for k, colour in enumerate(COMPONENTS, start=1))
THROUGH_CENTRE = {"name": "the axis through the centre of mass", "colour": "#D55E00"}


class Ellipsoid(NamedTuple):
    """An ellipsoid in the body: ``turn`` has its axes as columns, body axes."""

    semi_axes: Float[np.ndarray, "3"]
    centre: Float[np.ndarray, "3"]
    turn: Float[np.ndarray, "3 3"]

    @property
    def radius(self) -> float:
        """The radius of a ball about the fixed point that contains it."""
        return float(np.linalg.norm(self.centre) + np.max(self.semi_axes))


class Turning(NamedTuple):
    """A run of a rigid body, and the parts of it that are drawn."""

    trajectory: Trajectory[Any, Any]
    rows: np.ndarray  # of the saved times at which the state is known
    inertia: Float[np.ndarray, "3"] | None  # None where the system does not say
    shape: Ellipsoid

    @classmethod
    def of(cls, trajectory: Trajectory[Any, Any]) -> "Turning":
        rows = require_finite_rows(trajectory)
        rolls = isinstance(trajectory.system, RollingEllipsoid)  # which has a principal axis of its own
        stated: Any = () if rolls else getattr(trajectory.system, "inertia", ())
        inertia = np.asarray(stated, dtype=float) if np.shape(stated) == (3,) else None
        return cls(trajectory, rows, inertia, ellipsoid_of(trajectory.system, inertia))

    @property
    def top(self) -> HeavyTop | None:
        system = self.trajectory.system
        return system if isinstance(system, HeavyTop) else None

    @property
    def Omega(self) -> Float[np.ndarray, "T 3"]:
        return np.asarray(self.trajectory.state.Omega)[self.rows]

    @property
    def Lambda(self) -> Rotation:
        return Rotation.from_quat(np.roll(np.asarray(self.trajectory.state.q)[self.rows], -1, axis=1))


def rigid_scene(trajectories: Sequence[Trajectory[Any, Any]]) -> Scene:
    """Builds the scene of rigid bodies, side by side.

    **Raises:** ``ValueError`` for a batch, and where no state is known.
    """
    bodies = [Turning.of(trajectory) for trajectory in trajectories]
    apart = BODIES_APART * max(body.shape.radius for body in bodies)
    names, changes = zip(*(law_changes(body.trajectory, body.rows) for body in bodies), strict=True)
    return Scene(
        free_stand(-60.0 if len(bodies) == 1 else -80.0),
        [_rigid_parts(body) for body in bodies],
        [_rigid_numbers(body, k * apart, change) for k, (body, change) in enumerate(zip(bodies, changes, strict=True))],
        _rigid_graphs(bodies, names[0]),
    )


def ellipsoid_of(system: Any, inertia: Float[np.ndarray, "3"] | None) -> Ellipsoid:
    """Returns the ellipsoid drawn for a body, whose semi-axes are proportional to the spread of its mass along them.

    The second moments s_j = ∫ x_j² dm are ½ (d1 + d2 + d3) − d_j about the fixed point. Those of a heavy top about its
    centre of mass are diag(s) − m χχᵀ, and its semi-axes are the standard deviations of its mass, at its own scale. For
    other bodies, whose mass is unknown, the largest semi-axis is 1. Impossible moments give a thin one. That of a
    rolling ellipsoid is its surface.
    """
    if isinstance(system, RollingEllipsoid):
        return Ellipsoid(np.asarray(system.semiaxes, dtype=float), np.zeros(3), np.eye(3))
    if inertia is None:
        return Ellipsoid(np.ones(3), np.zeros(3), np.eye(3))
    # Moments sum to twice the second moments: d1 = s2 + s3, and so on.
    second = np.sum(inertia) / 2 - inertia
    if not isinstance(system, HeavyTop):
        size = np.sqrt(np.maximum(second, 0.0) / np.max(second))
        return Ellipsoid(np.maximum(size, THINNEST), np.zeros(3), np.eye(3))
    mass, chi = float(system.mass), np.asarray(system.chi, dtype=float)
    about_centre = np.diag(second) - mass * np.outer(chi, chi)
    squares, turn = np.diag(about_centre), np.eye(3)
    # Left as it is up to rounding: `eigh` would sort the axes, and exchange them.
    if np.any(np.abs(about_centre - np.diag(squares)) > 1e-12 * np.max(second)):
        squares, turn = np.linalg.eigh(about_centre)
        # Eigenvectors may be left-handed, which is no rotation.
        turn = turn * np.sign(np.linalg.det(turn))
    size = np.sqrt(np.maximum(squares, 0.0) / mass)
    # Where nothing has an extent, the distance of the centre stands for it, and else 1.
    return Ellipsoid(np.maximum(size, THINNEST * (np.max(size) or np.linalg.norm(chi) or 1.0)), chi, turn)


def _rigid_parts(body: Turning) -> dict[str, Any]:
    """Returns the parts of the body: ``tip`` is the end of the axis whose path is drawn."""
    shape, top = body.shape, body.top
    arm = np.zeros(3) if top is None else np.asarray(top.chi)
    length = np.linalg.norm(arm)
    k = axis_of_revolution(body.trajectory.system)
    # A little beyond the surface, so that its path is seen.
    tip = (arm / length if length > 0 else np.eye(3)[k]) * REACH * shape.radius
    return make_body("rigid", body.trajectory, shape.radius, len(body.rows)) | {
        "ellipsoid": {
            "semi_axes": shape.semi_axes.tolist(),
            "centre": shape.centre.tolist(),
            "quaternion": Rotation.from_matrix(shape.turn).as_quat().tolist(),
        },
        "centre_of_mass": None if top is None else arm.tolist(),
        "tip": {"place": tip.tolist()} | (THROUGH_CENTRE if length > 0 else AXES[k]),
    }


def axis_of_revolution(system: Any) -> int:
    """Returns the index of the body axis whose path is drawn: the axis of a spheroid, and the third one of another
    body.
    """
    if not isinstance(system, RollingEllipsoid):
        return 2
    semiaxes = np.asarray(system.semiaxes)
    # The one that differs most from the middle one: of a spheroid, its axis.
    return int(np.argmax(np.abs(semiaxes - np.median(semiaxes))))


def _rigid_numbers(body: Turning, x: float, changes: Float[np.ndarray, "T laws"]) -> dict[str, Numbers]:
    """Returns the numbers of the body whose fixed point is at ``x``."""
    Omega, Lambda, system, count = body.Omega, body.Lambda, body.trajectory.system, len(body.rows)
    times = np.asarray(body.trajectory.times)[body.rows]
    numbers = {
        "time": Numbers(times, 0.0),
        "centre": Numbers(np.tile([x, 0.0, 0.0], (count, 1)), body.shape.radius),
        "quaternion": Numbers(continuous(Lambda.as_quat()), 1.0),
        "angular_velocity": Numbers(Omega),
        "vertical": Numbers(Lambda.inv().apply([0.0, 0.0, 1.0])),
        "laws": Numbers(changes),
    }
    if body.inertia is not None:
        momentum = body.inertia * Omega
        kinetic = 0.5 * np.sum(momentum * Omega, axis=1)
        potential = np.zeros(count)
        if body.top is not None:
            weight = float(body.top.mass * body.top.gravity)
            potential = weight * numbers["vertical"].values @ np.asarray(body.top.chi)
        numbers |= {
            "angular_momentum": Numbers(momentum),
            "momentum_in_space": Numbers(Lambda.apply(momentum)),
            "energies": Numbers(np.stack([kinetic, potential], axis=1)),
        }
    if isinstance(system, SuslovProblem):
        xi = np.asarray(_xi(system, to_array(times)))
        numbers["xi"] = Numbers(xi / np.linalg.norm(xi, axis=1, keepdims=True))
    return numbers


@programs.filter_jit
def _xi(system, times):
    return jax.vmap(system.xi)(times)


def _rigid_graphs(bodies: Sequence[Turning], names: list[str]) -> list[dict[str, Any]]:
    """Returns the graphs of rigid bodies, with the laws of the first where all are of its kind."""
    count, has_inertia = len(bodies), any(rigid_body.inertia is not None for rigid_body in bodies)
    tops = any(rigid_body.top is not None for rigid_body in bodies)
    graphs = [angular_velocity(count)]
    if has_inertia:
        kinetic = graph("Kinetic energy", [series("T", None if count > PAIR else BLUE, "energies", [0])])
        graphs.append(energies(count) if tops else kinetic)
        whole = graph("Angular momentum", [series("|L|", None, "angular_momentum", [0, 1, 2], norm=True)])
        each_axis = each(("L1", "L2", "L3"), COMPONENTS, "momentum_in_space")
        graphs.append(whole if count > PAIR else graph("Angular momentum, space axes", each_axis))
    if tops:
        third = graph("Vertical", [series("Γ3", None, "vertical", [2])])
        each_axis = each(("Γ1", "Γ2", "Γ3"), COMPONENTS, "vertical")
        graphs.append(third if count > PAIR else graph("Vertical, body axes", each_axis))
    alike = all(type(rigid_body.trajectory.system) is type(bodies[0].trajectory.system) for rigid_body in bodies)
    return graphs + (laws(names) if count <= PAIR and alike else [])


def particle_scene(trajectories: Sequence[Trajectory[Any, Any]]) -> Scene:
    """Builds the scene of particles.

    **Raises:** ``ValueError`` for a batch, and where no state is known.
    """
    pairs = [(trajectory, require_finite_rows(trajectory)) for trajectory in trajectories]
    places = np.concatenate([_columns(trajectory, rows, "x", "y", "z") for trajectory, rows in pairs])
    # A particle has no size of its own; without any motion, 1.
    radius = ARROW_RADIUS * (float(np.max(np.ptp(places, axis=0))) or 1.0)
    names, changes = zip(*(law_changes(*pair) for pair in pairs), strict=True)
    alike = all(isinstance(run.state, type(trajectories[0].state)) for run in trajectories)
    return Scene(
        free_stand(-60.0),
        [make_body("particle", trajectory, radius, len(rows)) for trajectory, rows in pairs],
        [_particle_numbers(*pair, radius, change) for pair, change in zip(pairs, changes, strict=True)],
        _particle_graphs(trajectories, names[0] if alike else []),
    )


def _columns(trajectory: Trajectory[Any, Any], rows: np.ndarray, *names: str) -> Float[np.ndarray, "T k"]:
    return np.stack([np.asarray(getattr(trajectory.state, name))[rows] for name in names], axis=1)


def _particle_numbers(
    trajectory: Trajectory[Any, Any], rows: np.ndarray, radius: float, changes: Float[np.ndarray, "T laws"]
) -> dict[str, Numbers]:
    numbers = {
        "time": Numbers(np.asarray(trajectory.times)[rows], 0.0),
        "centre": Numbers(_columns(trajectory, rows, "x", "y", "z"), radius),
        "velocity": Numbers(_columns(trajectory, rows, "xdot", "ydot", "zdot")),
        "laws": Numbers(changes),
    }
    if isinstance(trajectory.state, VakonomicState):
        numbers["multiplier"] = Numbers(_columns(trajectory, rows, "multiplier"))
    return numbers


def _particle_graphs(trajectories: Sequence[Trajectory[Any, Any]], names: list[str]) -> list[dict[str, Any]]:
    """Returns the graphs of particles, with the laws ``names`` where all have them; the constraint is ż = y ẋ."""
    if len(trajectories) > PAIR:
        coordinates = [graph(name, [series(name, None, "centre", [k])]) for k, name in enumerate("xyz")]
        return [*coordinates, graph("Speed", [series("|v|", None, "velocity", [0, 1, 2], norm=True)])]
    graphs = [
        graph("Coordinates", each("xyz", COMPONENTS, "centre")),
        graph("Velocity", each(("ẋ", "ẏ", "ż"), COMPONENTS, "velocity")),
    ]
    if any(isinstance(trajectory.state, VakonomicState) for trajectory in trajectories):
        graphs.append(graph("Multiplier", [series("λ", COMPONENTS[0], "multiplier", [0])]))
    return graphs + laws(names)
