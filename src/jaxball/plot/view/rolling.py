"""Balls or disks in a view: the parts of each and its numbers at the saved times, their ground, and their graphs."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ...physics.body import System
from ...physics.grounds import AbstractSurface
from ...physics.state import ReducedState
from ...simulation.trajectory import Trajectory
from ..coordinates import ANGLE, LENGTH, UNKNOWN, angles_of, joint_units, joints_of, mass_units
from ..over_time import Sizes, modes_of, sizes_of, without_rounding
from ..palette import TAKEN, mass_colour
from ..record import Record, finite_rows, record, require_finite_rows, require_one, with_jumps
from ..shapes import Placed, Setting, floor_under, on_surface, place, rails_of
from ..surface import Contacts, Mesh, contacts_of, mesh_grid, mesh_points, nodes
from ..time_series import energy_losses, height, of_contact, slip_speed
from .feedback import feedback_graphs, feedback_numbers
from .scene import (
    BLUE,
    PAIR,
    RED,
    SUBSCRIPTS,
    Discs,
    Numbers,
    Scene,
    angular_velocity,
    continuous,
    each,
    energies,
    graph,
    make_body,
    of_masses,
    series,
    thin_curve,
)

ON_RAILS = 1e-3  # radii, the allowed error of a rail between its points
ELEVATION, AZIMUTH = {False: 20.0, True: 8.0}, {False: -60.0, True: -90.0}  # degrees, of a ball and of a disk
ELEVATION_ON_SURFACES = 28.0
POINTS = 65  # points of the edge of a disc on a surface
_POLAR, _AZIMUTH = np.meshgrid(np.linspace(0.0, np.pi, 49), np.linspace(0.0, 2 * np.pi, 97), indexing="ij")
_NORMALS = np.stack(  # where the surface of a body is drawn: row by row from E3 down, each from E1 around E3
    [np.sin(_POLAR) * np.cos(_AZIMUTH), np.sin(_POLAR) * np.sin(_AZIMUTH), np.cos(_POLAR)], axis=-1
).reshape(-1, 3)


class Shown(NamedTuple):
    """A run, and the parts of it that are drawn."""

    trajectory: Trajectory
    run: Record
    placed: Placed
    angles: dict[int, np.ndarray]  # θ of the masses on rails

    @property
    def system(self) -> System:
        return self.trajectory.system

    @property
    def radius(self) -> float:
        return float(self.system.radius)


def prepare_view(trajectory: Trajectory[Any, Any]) -> Shown:
    """Prepares a run to be shown.

    **Raises:** ``ValueError`` if it cannot be shown.
    """
    require_one(trajectory)
    if isinstance(trajectory.state, ReducedState):
        raise ValueError(
            "Argument `trajectory` must contain the position of the ball, but it is of a ReducedState; simulate with a "
            "BallState."
        )
    require_finite_rows(trajectory)
    trajectory = with_jumps(trajectory)
    run = record(trajectory)
    return Shown(trajectory, run, place(trajectory, run), angles_of(trajectory))


def body_document(one: Shown) -> dict[str, Any]:
    """Returns the parts of the body."""
    system = one.system
    kind = "disk" if system.planar else "ball"
    parts = make_body(kind, one.trajectory, one.radius, len(one.run.times)) | {
        "shell": {"mass": float(system.mass), "centre_of_mass": np.asarray(system.offset).tolist()},
        "masses": _masses(system),
        "rails": [{"colour": mass_colour(members[0])} for members, _ in rails_of(system)],
        "arms": [mass_colour(j) for j in range(system.n_masses + 1, system.n_masses + len(system.mechanisms) + 1)],
    }
    modes = modes_of(one.trajectory)
    if not modes.spells:
        return parts
    spells = [[spell.mode.name.lower(), spell.start, spell.end] for spell in modes.spells]
    return parts | {"spells": spells, "switches": modes.switches.tolist()}


def body_numbers(one: Shown, plane: float, grid: Float[np.ndarray, "rows columns 2"] | None) -> dict[str, Numbers]:
    """Returns the numbers of the body above a plane at ``plane`` below the origin, which may differ from its own
    radius.

    On a surface ``grid`` has the coordinates of its mesh.
    """
    system, run, placed, r = one.system, one.run, one.placed, one.radius
    setting, seen, rows = placed.setting, run.observables, finite_rows(one.trajectory)
    numbers = {
        "time": Numbers(run.times, 0.0),
        # Bodies of other radii stand on the floor of the first one, which is a radius below the origin.
        "centre": Numbers(placed.centre + (0.0 if grid is not None else r - plane) * setting.page[:, 2], r),
        "quaternion": Numbers(continuous(Rotation.from_matrix(placed.Lambda).as_quat()), 1.0),
        "masses": Numbers(seen.mass_positions_body, r),
    }
    numbers |= {f"arms_{j}": Numbers(points, r) for j, points in enumerate(placed.arms)}
    if system.shape is not None:
        numbers |= {
            "surface": Numbers(on_surface(system, _NORMALS), r, over_time=False),
            "foot": Numbers(_feet(one), r),
        }
    if np.any(setting.moved):
        numbers["moved"] = Numbers(setting.moved, r)
    if grid is not None and setting.contacts is not None:
        numbers |= _surface_numbers(system.ground, run.times, setting.contacts, grid, r)
    if setting.turned is not None:
        numbers["turned"] = Numbers(setting.turned, 1.0)
    if setting.carried is not None:
        numbers["belt"] = Numbers(setting.carried, r)
    numbers |= {
        f"rail_{j}": Numbers(thin_curve(points, ON_RAILS * r), r, over_time=False)
        for j, (_, points) in enumerate(rails_of(system))
    }
    numbers |= {
        "angular_velocity": Numbers(seen.angular_velocity_body),
        "angular_momentum": Numbers(seen.contact_momentum),
        "normal_force": Numbers(seen.normal_force),
        "friction": Numbers(seen.friction),
        "energies": Numbers(np.stack([seen.kinetic_energy, seen.potential_energy], axis=1)),
    }
    if system.planar:
        # Turning about −E2 is positive for φ.
        numbers["turning"] = Numbers(-seen.angular_velocity_body[:, 1])
    quantities = one.trajectory.history.over_time
    if "height" in quantities:
        numbers |= {
            "height": Numbers(np.asarray(quantities["height"])[rows], r),
            "slip": Numbers(np.asarray(quantities["slip"])[rows, :2]),
            "taken": Numbers(np.stack(energy_losses(one.trajectory), axis=1)[rows]),
        }
    numbers |= feedback_numbers(one.trajectory, setting, r, r - plane)
    if one.angles:
        numbers["mass_angles"] = Numbers(np.stack(list(one.angles.values()), axis=1))
    if system.mechanisms:
        numbers["joint_angles"] = Numbers(seen.joint_angles)
    return numbers


def _feet(one: Shown) -> Float[np.ndarray, "T 3"]:
    """Computes the vector from the centre of a body that is no ball to its lowest point, axes of the page."""
    Lambda = one.placed.Lambda
    downwards = -np.einsum("tji,j->ti", Lambda, one.placed.setting.page[:, 2])
    return np.einsum("tij,tj->ti", Lambda, on_surface(one.system, downwards))


def _surface_numbers(
    surface: Any,
    times: Float[np.ndarray, " T"],
    contacts: Contacts,
    grid: Float[np.ndarray, "rows columns 2"],
    r: float,
) -> dict[str, Numbers]:
    """Returns the mesh of a surface, where it is, and its axes at the contact point."""
    deforms = contacts.deforms
    points = mesh_points(surface, times if deforms else times[:1], grid)
    numbers = {
        "normal": Numbers(contacts.normals, 1.0),
        "tangent": Numbers(contacts.tangents, 1.0),
        "mesh": Numbers(points.reshape(len(points), -1, 3), r, over_time=deforms),
    }
    if deforms:
        # A mesh that changes its form carries the contact points along, each by its row and column.
        numbers["nodes"] = Numbers(nodes(grid, contacts.coordinates))
    if np.any(contacts.turns != np.eye(3)):
        numbers["carried"] = Numbers(continuous(Rotation.from_matrix(contacts.turns).as_quat()), 1.0)
    return numbers


def _masses(system: System) -> list[dict[str, Any]]:
    """Lists name, colour and mass of each mass, in the order of the observables."""
    entries = [(f"m{i}", i, mass.mass) for i, mass in enumerate(system.point_masses, start=1)]
    for j, mechanism in enumerate(system.mechanisms, start=1):
        entries += [(f"M{j}", system.n_masses + j, mass) for mass in np.asarray(mechanism.mass)]
    return [
        {"name": name.translate(SUBSCRIPTS), "colour": mass_colour(k), "mass": float(mass)} for name, k, mass in entries
    ]


def rolling_scene(
    named: Mapping[str, Trajectory[Any, Any]], wanted: Float[np.ndarray, "k 2"] | None, discs: Discs = ()
) -> Scene:
    """Builds the scene of balls or disks, with a desired path and discs to avoid.

    **Raises:** ``ValueError`` for bodies that do not roll on the same ground, and as :func:`prepare_view`.
    """
    bodies, names = [prepare_view(trajectory) for trajectory in named.values()], list(named)
    other = other_ground([body.system for body in bodies])
    if other is not None:
        raise ValueError(
            f'Argument `trajectories` must have runs on the same ground, but the ground of "{names[other]}" differs '
            f'from that of "{names[0]}"; show them one by one.'
        )
    first = bodies[0]
    make = _on_plane if first.placed.setting.contacts is None else _on_surface
    stand, goal, grid = make(bodies, wanted, discs)
    return Scene(
        stand,
        [body_document(body) for body in bodies],
        [body_numbers(body, first.radius, grid) for body in bodies],
        _graphs(bodies),
        None if goal is None else Numbers(goal, first.radius, over_time=False),
    )


Stand = tuple[dict[str, Any], Float[np.ndarray, "k 3"] | None, Float[np.ndarray, "rows columns 2"] | None]


def _on_plane(bodies: Sequence[Shown], desired_path: Float[np.ndarray, "k 2"] | None, discs: Discs) -> Stand:
    """Returns the stand of bodies on a plane, and the desired path, axes of the page."""
    first, setting, planar = bodies[0], bodies[0].placed.setting, bodies[0].system.planar
    # On the plane a disk's line is at e2 = 0.
    # At the floor, a radius below the centre; `setting.page` turns it onto the page.
    goal = None if desired_path is None else np.column_stack([desired_path, np.full(len(desired_path), -first.radius)])
    corners = [[*(np.asarray(centre) + side * r), -first.radius] for centre, r in discs for side in (-1, 1)]
    coefficients = _coefficients(bodies)
    azimuth = AZIMUTH[planar] if planar else bodies[0].placed.azimuth(AZIMUTH[planar])
    stand = {
        "axes": setting.page.tolist(),
        "floor": _floor(bodies, setting, [*([] if goal is None else [goal]), np.reshape(corners, (-1, 3))]),
        "obstacles": [[float(centre[0]), float(centre[1]), float(radius)] for centre, radius in discs],
        **({"cone": coefficients["static_friction"]} if coefficients.get("static_friction", 0.0) > 0 else {}),
        "camera": {"elevation": ELEVATION[planar], "azimuth": azimuth},
    }
    return stand, None if goal is None else goal @ setting.page.T, None


def _on_surface(bodies: Sequence[Shown], desired_path: Float[np.ndarray, "k 2"] | None, discs: Discs) -> Stand:
    """Returns the stand of balls or disks on a surface, the desired path, and the grid of the mesh.

    The path and the edges of discs are on the pieces of the ground with their coordinates, where they are at the start.
    """
    first, surface = bodies[0], bodies[0].system.ground
    assert isinstance(surface, AbstractSurface)
    times, every = first.run.times, [body.placed.setting.contacts for body in bodies if body.placed.setting.contacts]
    around = np.linspace(0.0, 2 * np.pi, POINTS)
    circle = np.stack([np.cos(around), np.sin(around)], axis=1)
    edges = [np.asarray(centre) + radius * circle for centre, radius in discs]
    curves = edges if desired_path is None else [desired_path, *edges]
    marks = [contacts_of(surface, np.full(len(curve), times[0]), np.asarray(curve)) for curve in curves]
    goal, rings = (None, marks) if desired_path is None else (marks[0].points, marks[1:])
    grid = mesh_grid(surface, [*every, *marks], times, first.radius)
    everywhere = Mesh(mesh_points(surface, times[:1], grid), grid, every[0]).everywhere()
    low, high = everywhere.min(axis=0), everywhere.max(axis=0)
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
    stand = {
        "axes": np.eye(3).tolist(),
        "floor": {"height": 0.0, "mesh": list(grid.shape[:2]), "corners": corners.tolist()},
        "obstacles": [ring.points.ravel().tolist() for ring in rings],
        "camera": {"elevation": ELEVATION_ON_SURFACES, "azimuth": AZIMUTH[first.system.planar]},
    }
    return stand, goal, grid


def other_ground(systems: Sequence[System]) -> int | None:
    """Returns the index of the first body whose ground differs from the ground of the first of all; None if all have
    the same.
    """
    others = (k for k, system in enumerate(systems) if not eqx.tree_equal(system.ground, systems[0].ground))
    return next(others, None)


def _floor(bodies: Sequence[Shown], setting: Setting, drawn: Sequence[Float[np.ndarray, "_ 3"]]) -> dict[str, Any]:
    r = bodies[0].radius
    paths = [body.run.observables.contact_point + np.array([0.0, 0.0, body.radius - r]) for body in bodies]
    path = np.concatenate([*paths, *drawn])
    floor = floor_under(path, max(body.radius for body in bodies), setting)
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


def _graphs(bodies: Sequence[Shown]) -> list[dict[str, Any]]:
    """Returns the graphs of bodies; each is drawn if its numbers exist."""
    count, sizes = len(bodies), sizes_of(bodies[0].system)
    several, planar = count > PAIR, bodies[0].system.planar
    ratio = series("|f| / N", None if several else RED, "friction", [0, 1], norm=True) | {"over": "normal_force"}
    levels = _levels(bodies)
    needed = graph("Friction" if levels else "Friction needed", [ratio], 1.0, gaps=True) | {"level": "μ"}
    N = series("N", None if several else BLUE, "normal_force", [0])
    phidot = graph("Angular velocity", [series("φ̇", BLUE, "turning", [0])], 1 / sizes.time)
    graphs = [
        energies(count, sizes.energy),
        phidot if planar and not several else angular_velocity(count, 1 / sizes.time),
        graph("Normal force", [N], sizes.force, gaps=True),
        needed | ({"levels": levels} if levels else {}),
        *_of_contact(bodies, sizes),
    ]
    if several:
        return graphs
    # The energy dissipated by sliding friction and by impacts, if any is, beside the energies.
    losses = zip(*(energy_losses(entry.trajectory) for entry in bodies), strict=True)
    for entry, amounts in zip(each(TAKEN, TAKEN.values(), "taken"), losses, strict=True):
        if any(np.any(without_rounding(np.nan_to_num(np.asarray(leaf)), sizes.energy)) for leaf in amounts):
            graphs[0]["series"].append(entry)
    of_feedback = feedback_graphs([entry.trajectory for entry in bodies])
    return [*graphs, *of_feedback, *_of_masses(bodies), *_of_joints(bodies)]


def _of_masses(bodies: Sequence[Shown]) -> list[dict[str, Any]]:
    """Returns the graphs of θ of masses on rails: of angles, and of positions along tubes."""
    fullest = max(bodies, key=lambda body: len(body.angles))
    units, masses = mass_units(fullest.system), list(fullest.angles)
    titles = {ANGLE: "Angles of the masses (rad)", LENGTH: "Positions of the masses", UNKNOWN: "Places of the masses"}
    graphs = []
    for unit, title in titles.items():
        these = [i for i in masses if units[i] == unit]
        lines = each([f"θ{i}" for i in these], of_masses(these), "mass_angles")
        for line, i in zip(lines, these, strict=True):
            line["columns"] = [masses.index(i)]
        graphs += [graph(title, lines, 1.0)] if lines else []
    return graphs


def _of_joints(bodies: Sequence[Shown]) -> list[dict[str, Any]]:
    fullest = max((body.system for body in bodies), key=lambda system: len(joints_of(system)))
    names = [f"θ{joint}" for joint in joints_of(fullest)]
    lines = each(names, of_masses(range(1, len(names) + 1)), "joint_angles")
    return [graph(f"Joints{joint_units(fullest)}", lines, 1.0)] if lines else []


def _coefficients(bodies: Sequence[Shown]) -> dict[str, float]:
    """Returns the coefficients of friction of all bodies; none if they differ."""
    each_body = (body.trajectory.history.coefficients.items() for body in bodies)
    first, *others = ({name: float(value) for name, value in items} for items in each_body)
    return first if all(other == first for other in others) else {}


def _levels(bodies: Sequence[Shown]) -> list[dict[str, Any]]:
    """Lists the coefficients of friction that a law gives and that are not 0."""
    coefficients = _coefficients(bodies)
    if not coefficients:
        return []
    static, kinetic = coefficients["static_friction"], coefficients["friction"]
    named = {"μₛ": static, "μ": kinetic} if static != kinetic else {"μₛ = μ": static}
    return [{"name": name, "value": value} for name, value in named.items() if value > 0]


def _of_contact(bodies: Sequence[Shown], sizes: Sizes) -> list[dict[str, Any]]:
    """Returns the graphs of the height and of the slip speed, unless they are always zero."""
    colour = None if len(bodies) > PAIR else BLUE
    figures = {figure for body in bodies for figure in of_contact(body.trajectory)}
    graphs = {
        height: graph("Height", [series("h", colour, "height", [0])], sizes.length),
        slip_speed: graph("Slip speed", [series("|vₛ|", colour, "slip", [0, 1], norm=True)], sizes.speed),
    }
    return [drawn for figure, drawn in graphs.items() if figure in figures]
