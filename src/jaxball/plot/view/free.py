"""Bodies without a plane in a view: rigid bodies, particles, and pictures of Lagrangian systems."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ... import programs
from ...numerics.arrays import to_array
from ...physics.classical import HeavyTop, RollingEllipsoid, SuslovProblem, VakonomicState
from ...simulation.trajectory import Trajectory
from ..palette import COMPONENTS
from ..record import COLOURS, Drawn, Picture, motion_panels, read_picture, require_finite_rows
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
    of_masses,
    series,
)

DOT = 1 / 50  # the radius of dots, of the largest extent of all that is drawn


def picture_scene(trajectories: Sequence[Trajectory[Any, Any]], picture: Picture) -> Scene:
    """Builds the scene of systems with a Lagrangian, which a user's function draws.

    **Raises:** ``TypeError`` and ``ValueError`` as :func:`~jaxball.plot.record.read_picture`.
    """
    everything = [read_picture(trajectory, picture) for trajectory in trajectories]
    planar = all(drawn.points.shape[1] == PAIR for drawn in everything)
    points = np.concatenate([_in_space(drawn.points) for drawn in everything])
    low, high = points.min(axis=0), points.max(axis=0)
    radius = DOT * (float(np.max(high - low)) or 1.0)
    names, changes = zip(*(law_changes(run, require_finite_rows(run)) for run in trajectories), strict=True)
    pairs = list(zip(trajectories, everything, strict=True))
    return Scene(
        # Of a plane from the side, whose second axis is upwards.
        (free_stand(-90.0, elevation=0.0) if planar else free_stand(-60.0))
        | {"corners": np.stack(np.meshgrid(*zip(low, high, strict=True)), axis=-1).reshape(-1, 3).tolist()},
        [
            make_body("drawn", run, radius, len(drawn.times))
            | {"lines": [COLOURS[k % len(COLOURS)] for k in range(len(drawn.lines_at(0)))]}
            for run, drawn in pairs
        ],
        [_numbers(run, drawn, radius, change) for (run, drawn), change in zip(pairs, changes, strict=True)],
        _graphs(trajectories, names[0]),
    )


def _in_space(points: Float[np.ndarray, "_ d"]) -> Float[np.ndarray, "_ 3"]:
    """Returns points in space; those of a plane stand upright."""
    return points if points.shape[1] > PAIR else np.insert(points, 1, 0.0, axis=1)


def _numbers(
    trajectory: Trajectory[Any, Any], drawn: Drawn, radius: float, changes: Float[np.ndarray, "T laws"]
) -> dict[str, Numbers]:
    rows, at_times = require_finite_rows(trajectory), range(len(drawn.times))
    numbers = {"time": Numbers(drawn.times, 0.0), "laws": Numbers(changes)}
    for k in range(len(drawn.lines_at(0))):
        lines = [_in_space(drawn.lines_at(i)[k]) for i in at_times]
        longest = max(map(len, lines))
        # An array has as many points at each time: a shorter line stays at its end.
        filled = [np.pad(line, ((0, longest - len(line)), (0, 0)), mode="edge") for line in lines]
        numbers[f"line_{k}"] = Numbers(np.stack(filled), radius)
    # What is traced is where the last line, or the last point, ends.
    ends = np.concatenate([_in_space(drawn.lines_at(i)[-1][-1:]) for i in at_times])
    numbers["centre"] = Numbers(ends, radius)
    numbers |= {name: Numbers(np.asarray(getattr(trajectory.state, name))[rows]) for name in ("q", "qdot")}
    forces = np.asarray(trajectory.multipliers)[rows]
    return numbers | ({"multipliers": Numbers(forces)} if forces.shape[1] else {})


def _graphs(trajectories: Sequence[Trajectory[Any, Any]], law_names: list[str]) -> list[dict[str, Any]]:
    """Returns the graphs of coordinates, rates and λ; of many runs, one of each coordinate."""
    names = trajectories[0].system.coordinates
    if len(trajectories) > PAIR:
        return [graph(name, [series(name, None, "q", [k])]) for k, name in enumerate(names)]
    graphs = []
    for title, field, dot, chosen in motion_panels(names):
        looks = [(*COMPONENTS, *COLOURS)[k % len(COLOURS)] for k in chosen]
        lines = each([f"{names[k]}{dot}" for k in chosen], looks, field)
        for line, k in zip(lines, chosen, strict=True):
            line["columns"] = [k]
        graphs.append(graph(title.capitalize(), lines))
    count = np.asarray(trajectories[0].multipliers).shape[1]
    if count:
        lines = each([f"λ{k}" for k in range(1, count + 1)], of_masses(range(1, count + 1)), "multipliers")
        graphs.append(graph("Constraint forces", lines))
    return graphs + laws(law_names)


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
