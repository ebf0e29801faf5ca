"""Reads an MJCF file as a scenario: a ball or a disk with mechanisms, on a plane.

Users call ``from_mjcf``, and ``jaxball import`` calls ``read_mjcf``, whose notes it prints. A URDF file is
read to the same ``Imported``.
"""

import xml.etree.ElementTree as ET
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ..interface.arguments import require
from ..interface.wording import all_of
from ..numerics.arrays import Numbers, to_array
from ..physics.body import Ball, Disk, System
from ..physics.contact.law import Contact
from ..physics.contact.released import ReleasedState, release
from ..physics.forces.resistance import Resistance
from ..physics.grounds.ground import Ground
from ..physics.state import BallState, DiskState
from ..scenario import Scenario
from .drives import read_actuators
from .elements import (
    Angles,
    Frame,
    Inertial,
    MJCFError,
    apply_defaults,
    frame_of,
    label,
    number,
    numbers,
    refuse_others,
    refuse_values,
    refuse_what_holds,
)
from .inside import IN_BODY, Inside, read_inside, touches
from .sensors import read_sensors
from .shapes import Inertias
from .writing import ROOT

TOP = ("compiler", "option", "default", "worldbody", "actuator", "keyframe", "contact", "sensor")
UNREAD = ("size", "visual", "statistic", "asset", "custom")
IN_WORLD = ("geom", "body", "light", "camera", "site")
IN_SHELL = (*IN_BODY, "freejoint")
FLUID = ("density", "viscosity", "wind", "magnetic")
CHANGED = ("boundmass", "boundinertia", "settotalmass")
ROLLS = 1e-9  # relative to √(g r): a slip velocity, and to r: a height, up to which the body rolls
LEAST_FRICTION = 1e-5  # MuJoCo's mjMINMU
FRICTION = (1.0, 0.005, 0.0001)
TIMES = tuple(np.linspace(0.0, 10.0, 101))


class OwnFrame(NamedTuple):
    """The inertia of the shell, and the frame of the ball in that of the shell's element."""

    inertial: Inertial
    frame: Frame

    @property
    def inverse(self) -> Frame:
        """The frame of the element in that of the ball."""
        turn = self.frame.turn.T
        return Frame(turn, -turn @ self.frame.shift)


class Surface(NamedTuple):
    """The friction of a geom: of how many dimensions, and its coefficients of sliding, spinning and rolling."""

    condim: float
    friction: Float[np.ndarray, "3"]


class Imported(NamedTuple):
    """A robot of an MJCF file.

    - ``scenario``: what can be simulated.
    - ``notes``: a sentence for each thing that was set to 0, or that was not imported and may act in MuJoCo.
    """

    scenario: Scenario
    notes: tuple[str, ...]


def from_mjcf(text: str, *, times: Numbers = TIMES, contact: bool = False) -> Scenario:
    """Reads the scenario of a ball or a disk with mechanisms that an MJCF file describes.

    The file must have a plane; one body on it with a free joint (for a disk, two slides and a hinge) and a sphere; and
    in it bodies on hinges and slides without contacts. Bodies state their inertias, or have those of their geoms,
    spheres, capsules, cylinders, boxes and ellipsoids. The first keyframe, if there is one, is the initial state, and
    its controls are kept.

    **Arguments:**

    - ``text``: of the file.
    - ``times``: the save times, increasing, in the units of the file; 0 to 10 by 0.1 if not given.
    - ``contact``: whether the body may slip and fly, with MuJoCo's coefficient of friction; otherwise only one that
      does not start by rolling may, and all others always roll.

    **Raises:** :class:`MJCFError` for anything else, with the name of the element.

    **Example:**

    >>> from jaxball import load_scenario
    >>> from jaxball.mjcf import from_mjcf, to_mjcf
    >>> again = from_mjcf(to_mjcf(load_scenario("three-rotors")).text)
    >>> len(again.system.mechanisms), again.state.Omega
    (3, Array([0., 0., 0.], dtype=float64))
    """
    return read_mjcf(text, times=times, contact=contact).scenario


def read_mjcf(text: str, *, times: Numbers = TIMES, contact: bool = False) -> Imported:
    """Reads the scenario of a file as :func:`from_mjcf` returns it, with notes on what is not in it.

    **Arguments:**

    - ``text``: the text of the file.
    - ``times``: as for :func:`from_mjcf`.
    - ``contact``: as for :func:`from_mjcf`.

    **Raises:** as :func:`from_mjcf`.

    **Example:**

    >>> from jaxball import load_scenario
    >>> from jaxball.mjcf import read_mjcf, to_mjcf
    >>> read_mjcf(to_mjcf(load_scenario("three-rotors")).text).notes
    ()
    """
    require("text", text, str, "the text of an MJCF file")
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise MJCFError(f"The file must be XML, but it is not: {error}.") from None
    if root.tag != "mujoco":
        raise MJCFError(f"The file must have <mujoco> as its root, but it has {label(root)}.")
    refuse_others(root, (*TOP, *UNREAD), "it has no counterpart here")
    apply_defaults(root)
    inertias, world = _inertias(root), _only(root, "worldbody", "the file")
    angles = inertias.angles
    refuse_others(world, IN_WORLD, "only geoms and one body are read")
    shell = _only(world, "body", "the world")
    refuse_others(shell, IN_SHELL, "it has no counterpart here")
    plane, sphere = _touching(world, "plane"), _touching(shell, "sphere")
    if not _is_at(frame_of(plane, angles), np.eye(3), 2):
        raise MJCFError(f"Element {label(plane)} must be the plane z = 0, but it is elsewhere; tilt gravity instead.")
    key = root.find("keyframe/key")
    actuators = [element for group in root.findall("actuator") for element in group]
    controls = np.zeros(len(actuators))
    controls = controls if key is None else numbers(key, "ctrl", controls)
    actuated = read_actuators(actuators, controls)
    notes = [*_notes(shell, actuators, key, root.findall("contact/pair")), *actuated.notes]
    body_frame = _own_frame(shell, sphere, inertias)
    inside = read_inside(shell, body_frame.inverse, inertias, actuated.forces)
    surface = _surface(plane, sphere)
    system = _system(shell, sphere, body_frame, angles, inside, surface, _gravity(root))
    state = _state(system, shell, body_frame, angles, key, inside.joints)
    rolls = not contact and _rolls(system, state)
    law = None if rolls else Contact(friction=surface.friction[0])
    if law is not None:
        for joint in shell.iter("joint"):
            refuse_values(joint, ("frictionloss",), "joints cannot stick in a body that slips and flies")
    start = state.body if rolls else state
    sensors = read_sensors(root, inside.sites, dict(zip(inside.joints, system.coordinates, strict=True)))
    times = np.asarray(times, dtype=float)
    scenario = Scenario(root.get("model", ""), system, start, times, contact=law, sensors=sensors)
    return Imported(scenario, tuple(notes))


def _notes(
    shell: ET.Element, actuators: list[ET.Element], key: ET.Element | None, pairs: list[ET.Element]
) -> list[str]:
    """Returns the sentences about controls that the file does not have, limits of joints and contact pairs."""
    notes = []
    if actuators and (key is None or key.get("ctrl") is None):
        names = all_of([label(element) for element in actuators])
        are = "control of {} is" if len(actuators) == 1 else "controls of {} are"
        notes.append(f"The {are.format(names)} 0, because no keyframe has {'it' if len(actuators) == 1 else 'them'}.")
    for joint in shell.iter("joint"):
        if joint.get("actuatorfrcrange") is not None and joint.get("actuatorfrclimited") != "false":
            notes.append(
                f"The `actuatorfrcrange` of {label(joint)} was not imported, because limits here are those of single "
                "motors; give them to the actuators as `forcerange`."
            )
    for pair in pairs:
        notes.append(
            f'The {label(pair)} of "{pair.get("geom1")}" and "{pair.get("geom2")}" was not imported, because only the '
            "shell and the plane touch here, with the friction of their geoms; give it to these as `friction`."
        )
    return notes


def _inertias(root: ET.Element) -> Inertias:
    angle, sequence, from_geoms = "degree", "xyz", "auto"
    for compiler in root.findall("compiler"):
        refuse_values(compiler, CHANGED, "inertias must be those that the file states")
        if compiler.get("balanceinertia") == "true":
            raise MJCFError("Element <compiler> must leave inertias as the file states them, but it changes them.")
        if compiler.get("inertiagrouprange") is not None:
            raise MJCFError(
                "Attribute `inertiagrouprange` of <compiler> must be left out, because all geoms of a body have mass "
                f'here, but it is "{compiler.get("inertiagrouprange")}"; give mass 0 to the others.'
            )
        from_geoms = compiler.get("inertiafromgeom", from_geoms)
        angle = compiler.get("angle", angle)
        sequence = compiler.get("eulerseq", sequence)
    unit = 1.0 if angle == "radian" else np.pi / 180
    return Inertias(Angles(unit, sequence.swapcase()), from_geoms)


def _gravity(root: ET.Element) -> Float[np.ndarray, "3"]:
    gravity = np.array([0.0, 0.0, -9.81])
    for option in root.findall("option"):
        refuse_values(option, FLUID, "a medium has no counterpart here; add `resistance` to the scenario")
        gravity = numbers(option, "gravity", gravity)
    return gravity


def _only(parent: ET.Element, tag: str, where: str) -> ET.Element:
    children = parent.findall(tag)
    if len(children) != 1:
        raise MJCFError(
            f"There must be one <{tag}> in {where}, the robot itself in the world, but there are {len(children)}."
        )
    return children[0]


def _touching(parent: ET.Element, kind: str) -> ET.Element:
    """Returns the one geom of an element that others touch."""
    geoms = [geom for geom in parent.findall("geom") if touches(geom)]
    if len(geoms) != 1 or geoms[0].get("type", "sphere") != kind:
        which = ", ".join(f"{label(geom)} of type {geom.get('type', 'sphere')}" for geom in geoms) or "none"
        raise MJCFError(
            f"Element {label(parent)} must have one geom that others touch, a {kind}, but it has {which}; the others "
            "must have contype and conaffinity 0."
        )
    return geoms[0]


def _surface(plane: ET.Element, sphere: ET.Element) -> Surface:
    """Returns the friction of the geom with the higher priority, else the larger of the two, as MuJoCo has it."""
    highest = max(number(geom, "priority", 0.0) for geom in (plane, sphere))
    deciding = [geom for geom in (plane, sphere) if number(geom, "priority", 0.0) == highest]
    # Coefficients that are left out at the end are MuJoCo's.
    coefficients = [numbers(geom, "friction") if geom.get("friction") else np.zeros(0) for geom in deciding]
    friction = np.max([np.append(values, FRICTION[len(values) :])[:3] for values in coefficients], axis=0)
    condim = max(number(geom, "condim", 3.0) for geom in deciding)
    # A contact of one dimension has a normal force alone.
    friction[0] = friction[0] if condim > 1 else 0.0
    # MuJoCo heeds friction against spinning from 4 dimensions on, and against rolling with 6.
    if condim >= 4 and friction[1] > LEAST_FRICTION:
        raise MJCFError(
            f"The friction of {label(plane)} and {label(sphere)} against spinning must be 0, because it has no "
            f"counterpart here, but it is {friction[1]:g}."
        )
    return Surface(condim, friction)


def _own_frame(shell: ET.Element, sphere: ET.Element, inertias: Inertias) -> OwnFrame:
    """Returns the frame of the ball in the frame of the element: at the centre of the sphere, along the
    principal axes.
    """
    inertia = inertias.of(shell)
    if inertia is None:
        raise MJCFError(f"Element {label(shell)} must have an <inertial>, or geoms with a mass, but it has none.")
    # The axes must be the principal ones, as a ball here has only three moments.
    return OwnFrame(inertia, Frame(inertia.axes.turn, numbers(sphere, "pos", np.zeros(3))))


def _system(
    shell: ET.Element,
    sphere: ET.Element,
    body_frame: OwnFrame,
    angles: Angles,
    inside: Inside,
    surface: Surface,
    gravity: Float[np.ndarray, "3"],
) -> System:
    radius, g = float(numbers(sphere, "size")[0]), float(np.linalg.norm(gravity))
    dry = surface.friction[2] if surface.condim == 6 else 0.0
    arguments: dict[str, Any] = {
        "mass": body_frame.inertial.mass,
        "radius": radius,
        "gravity": g,
        "offset": body_frame.inverse.of_point(body_frame.inertial.axes.shift),
        "masses": inside.masses,
        "mechanisms": inside.mechanisms,
        "ground": _ground(gravity),
        "resistance": Resistance(dry=dry / radius) if dry > LEAST_FRICTION else None,  # a length there
    }
    if shell.find("freejoint") is not None:
        return Ball(inertia=body_frame.inertial.moments, **arguments)
    _check_disk(shell, body_frame, angles)
    return Disk(inertia=body_frame.inertial.moments[1], **arguments)


def _ground(gravity: Float[np.ndarray, "3"]) -> Ground | None:
    across = float(np.hypot(*gravity[:2]))
    if across == 0 and gravity[2] <= 0:
        return None
    if gravity[2] >= 0:
        raise MJCFError(f"Gravity must pull towards the plane, but it is {gravity.tolist()}.")
    # The plane stays level in the file, so the ground is tilted here by the angle of gravity.
    return Ground(angle=np.arctan2(across, -gravity[2]), heading=np.arctan2(gravity[1], gravity[0]))


def _check_disk(shell: ET.Element, body_frame: OwnFrame, angles: Angles) -> None:
    """Raises unless the joints of the shell are those of a disk."""
    joints = [
        (joint.get("type", "hinge"), tuple(numbers(joint, "axis", (0.0, 0.0, 1.0)))) for joint in shell.findall("joint")
    ]
    if joints != [(root["type"], root["axis"]) for root in ROOT.values()]:
        raise MJCFError(
            f"Element {label(shell)} must have a <freejoint>, or, for a disk, slides along x and z and a hinge about "
            "−y in this order, but it does not."
        )
    for joint in shell.findall("joint"):
        refuse_what_holds(joint)
    still = _is_at(frame_of(shell, angles), np.eye(3), 1) and _is_at(body_frame.frame, np.eye(3), 0, 1, 2)
    if not still:
        raise MJCFError(
            f"Element {label(shell)} of a disk must have the axes of the world, and its sphere and inertia the same, "
            "but it is turned or shifted."
        )


def _is_at(frame: Frame, turn: Float[np.ndarray, "3 3"], *axes: int) -> bool:
    """Returns whether a frame has an orientation, and no position along some axes."""
    return bool(np.array_equal(frame.turn, turn) and np.all(frame.shift[list(axes)] == 0))


def _state(
    system: System,
    shell: ET.Element,
    body_frame: OwnFrame,
    angles: Angles,
    key: ET.Element | None,
    joints: tuple[str, ...],
) -> ReleasedState:
    """Reads the state of the first keyframe, or at rest where the file has its bodies."""
    placed, radius = frame_of(shell, angles), float(system.radius)
    n = len(joints)
    if system.planar:
        qpos, qvel = np.zeros(3 + n), np.zeros(3 + n)
    else:
        quat = np.roll(Rotation.from_matrix(placed.turn).as_quat(), 1)
        qpos, qvel = np.concatenate([placed.shift, quat, np.zeros(n)]), np.zeros(6 + n)
    if key is not None:
        qpos, qvel = numbers(key, "qpos", qpos), numbers(key, "qvel", qvel)
    theta, thetadot = qpos[len(qpos) - n :], qvel[len(qvel) - n :]
    if system.planar:
        x, height = placed.shift[0] + qpos[0], placed.shift[2] + qpos[1] - radius
        disk = DiskState(phi=qpos[2], phidot=qvel[2], z=x, theta=theta, thetadot=thetadot)
        return ReleasedState(disk, V=(qvel[0], 0.0, qvel[1]), height=height)
    # A file has few digits, and MuJoCo normalises, too.
    q = qpos[3:7] / np.linalg.norm(qpos[3:7])
    turn = Rotation.from_quat(np.roll(q, -1))
    arm = turn.apply(body_frame.frame.shift)
    # The velocity in the file is that of the body's own origin, in space; its ω is in the axes of the body.
    centre, V = qpos[:3] + arm, qvel[:3] + np.cross(turn.apply(qvel[3:6]), arm)
    if not np.array_equal(body_frame.frame.turn, np.eye(3)):
        q = np.roll((turn * Rotation.from_matrix(body_frame.frame.turn)).as_quat(), 1)
    Omega = body_frame.frame.turn.T @ qvel[3:6]
    body = BallState(q=q, Omega=Omega, z=centre[:2], theta=theta, thetadot=thetadot)
    return ReleasedState(body, V=V, height=centre[2] - radius)


def _rolls(system: System, state: ReleasedState) -> bool:
    r = float(system.radius)
    slip = np.asarray(release(system, to_array(0.0), state.body).V - state.V)
    # In the scales of the body, for files in any units.
    slowest, lowest = ROLLS * np.sqrt(float(system.gravity) * r), ROLLS * r
    return bool(np.all(np.abs(slip) <= slowest)) and abs(float(state.height)) <= lowest
