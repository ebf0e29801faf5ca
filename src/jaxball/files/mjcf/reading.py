"""Reads an MJCF file as a scenario: a ball or a disk with mechanisms, on a plane.

``jaxball import`` prints the notes of ``read_mjcf``. A URDF file is
read to the same ``Imported``.
"""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ...interface.wording import all_of
from ...numerics.arrays import Numbers, to_array
from ...physics.body import Ball, Disk, System
from ...physics.contact.law import Contact
from ...physics.contact.released import ReleasedState, release
from ...physics.forces.resistance import Resistance
from ...physics.grounds.ground import Ground
from ...physics.state import BallState, DiskState
from ..scenario.scenario import Scenario
from .drives import TIMES as SAVES, Recording, read_recordings
from .elements import (
    Angles,
    Frame,
    Inertial,
    MJCFError,
    Settings,
    Source,
    frame_of,
    label,
    number,
    numbers,
    read_settings,
    read_xml,
    refuse_others,
    refuse_values,
    refuse_what_holds,
    word_of,
)
from .forces import read_actuators
from .inside import IN_BODY, Inside, bits_of, read_inside, replace_ratios, touches
from .schema import apply_defaults, check_names, check_values, notes_of
from .sensors import read_sensors
from .writing import ROOT, TIMES

TOP = ("compiler", "option", "default", "worldbody", "actuator", "keyframe", "contact", "sensor")
UNREAD = ("size", "visual", "statistic", "asset", "custom")
IN_WORLD = ("geom", "body", "light", "camera", "site")
IN_SHELL = (*IN_BODY, "freejoint")
# Relative to √(g r) or the speed: a slip velocity, and to r: a height, up to which the body rolls. Six digits, which
# MuJoCo writes, leave up to 2e-5 of each.
ROLLS = 2e-5
LEAST_FRICTION = 1e-5  # MuJoCo's mjMINMU
FRICTION = (1.0, 0.005, 0.0001)


class OwnFrame(NamedTuple):
    """The inertia of the shell, and the frame of the ball in that of the shell's element."""

    inertial: Inertial
    frame: Frame

    @property
    def inverse(self) -> Frame:
        """The frame of the element in that of the ball."""
        turn = self.frame.turn.T
        return Frame(turn, -turn @ self.frame.shift)


class Imported(NamedTuple):
    """A robot of an MJCF file.

    - ``scenario``: what can be simulated.
    - ``notes``: a sentence for each thing that was set to 0, or that was not imported and may act in MuJoCo.
    """

    scenario: Scenario
    notes: tuple[str, ...]


def read_mjcf(source: Source, *, times: Numbers | None = None, contact: bool = False) -> Imported:
    """Reads the scenario of a ball or a disk with mechanisms that an MJCF file describes.

    The file must have a plane; one body on it with a free joint (for a disk, two slides and a hinge) and a sphere; and
    in it bodies on hinges and slides without contacts. Bodies state their inertias, or have those of their geoms,
    spheres, capsules, cylinders, boxes and ellipsoids. The first keyframe, if there is one, is the initial state, and
    its controls are kept. What acts in MuJoCo is read, told by one of its ``notes``, or refused.

    **Arguments:**

    - ``source``: the path of the file, or its text.
    - ``times``: the save times, increasing, in the units of the file; if not given, those that :func:`to_mjcf` wrote
      into it, and for other files 0 to 10 by 0.1 from the time of the keyframe on.
    - ``contact``: whether the body may slip and fly, with MuJoCo's coefficient of friction; otherwise only one that
      does not start by rolling may, and all others always roll.

    **Raises:** :class:`MJCFError` for anything else, with the name of the element.

    **Example:**

    >>> from jaxball import load_scenario
    >>> from jaxball.files.mjcf import read_mjcf, to_mjcf
    >>> again = read_mjcf(to_mjcf(load_scenario("three-rotors")).text).scenario
    >>> len(again.system.mechanisms), again.state.Omega
    (3, Array([0., 0., 0.], dtype=float64))
    """
    root = read_xml(source, "an MJCF file", "mujoco", MJCFError)
    refuse_others(root, (*TOP, *UNREAD), "it has no counterpart here")
    check_names(root)
    apply_defaults(root)
    check_values(root)
    settings, key = read_settings(root), root.find("keyframe/key")
    shell, plane, sphere = _outside(root, settings)
    _check_alignment(shell, key, settings)
    body_frame = _own_frame(shell, sphere, settings)
    actuators = [element for group in root.findall("actuator") for element in group]
    recordings = read_recordings(root)
    controls = _controls(actuators, key, recordings)
    inside, notes = _read_inside(shell, body_frame, actuators, controls, settings)
    notes = [*_notes(shell, actuators, key, root.findall("contact/pair"), settings), *notes]
    notes += notes_of([plane, sphere, *(joint for joint in inside.elements if number(joint, "frictionloss", 0.0))])
    friction = _friction(plane, sphere)
    system = _system(shell, sphere, body_frame, settings, inside, float(friction[2]))
    state = _state(system, shell, body_frame, settings.angles, key, inside.joints)
    rolls = not contact and _rolls(system, state)
    law = None if rolls else Contact(friction=friction[0])
    if law is not None and "frictionloss" not in settings.disabled:
        for joint in inside.elements:
            refuse_values(joint, ("frictionloss",), "joints cannot stick in a body that slips and flies")
    start = state.body if rolls else state
    sensors = read_sensors(root, inside.sites, dict(zip(inside.joints, system.coordinates, strict=True)))
    scenario = Scenario(
        root.get("model", ""), system, start, _times(times, key, recordings), contact=law, sensors=sensors
    )
    return Imported(scenario, tuple(notes))


def _outside(root: ET.Element, settings: Settings) -> tuple[ET.Element, ET.Element, ET.Element]:
    """Returns the shell, and the plane and the sphere that touch each other."""
    world = _only(root, "worldbody", "the file")
    refuse_others(world, IN_WORLD, "only geoms and one body are read")
    shell = _only(world, "body", "the world")
    refuse_others(shell, IN_SHELL, "it has no counterpart here")
    plane, sphere = _touching(world, "plane"), _touching(shell, "sphere")
    if not _is_at(frame_of(plane, settings.angles), np.eye(3), 2):
        raise MJCFError(f"Element {label(plane)} must be the plane z = 0, but it is elsewhere; tilt gravity instead.")
    _check_contact(root, shell, plane, sphere)
    return shell, plane, sphere


def _times(
    times: Numbers | None, key: ET.Element | None, recordings: Mapping[str, Recording]
) -> Float[np.ndarray, " T"]:
    """Returns the save times that were given, or else those of the file, or else some from its keyframe on."""
    if times is not None:
        return np.asarray(times, dtype=float)
    if SAVES in recordings:
        return recordings[SAVES].times
    return TIMES + (0.0 if key is None else number(key, "time", 0.0))


def _read_inside(
    shell: ET.Element, body_frame: OwnFrame, actuators: list[ET.Element], controls: list[Recording], settings: Settings
) -> tuple[Inside, list[str]]:
    """Reads what is in the shell, with the forces of actuators, and a sentence for each thing that was left out."""
    in_ball = body_frame.inertial._replace(axes=body_frame.inverse.then(body_frame.inertial.axes))

    def read() -> tuple[Inside, list[str]]:
        forces, notes = read_actuators(actuators, controls, settings)
        return read_inside(shell, body_frame.inverse, settings, forces), notes

    inside, notes = read()
    # Ratios of damping need the inertias of all that has been read.
    if replace_ratios(inside, actuators, in_ball, shell.find("freejoint") is None):
        return read()
    return inside, notes


def _controls(
    actuators: list[ET.Element], key: ET.Element | None, recordings: Mapping[str, Recording]
) -> list[Recording]:
    """Returns the controls of actuators: those that the file has of all save times, or else of its first keyframe."""
    at_start = np.zeros(len(actuators))
    at_start = at_start if key is None else numbers(key, "ctrl", at_start)
    return [
        recordings.get(actuator.get("name", ""), Recording.constant(float(control)))
        for actuator, control in zip(actuators, at_start, strict=True)
    ]


def _notes(
    shell: ET.Element,
    actuators: list[ET.Element],
    key: ET.Element | None,
    pairs: list[ET.Element],
    settings: Settings,
) -> list[str]:
    """Returns the sentences about controls that the file does not have, limits of joints and contact pairs."""
    notes = []
    if actuators and (key is None or key.get("ctrl") is None):
        names = all_of([label(element) for element in actuators])
        are = "control of {} is" if len(actuators) == 1 else "controls of {} are"
        notes.append(f"The {are.format(names)} 0, because no keyframe has {'it' if len(actuators) == 1 else 'them'}.")
    for joint in shell.iter("joint"):
        if settings.limits(joint, "actuatorfrc") is not None:
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


def _check_contact(root: ET.Element, shell: ET.Element, plane: ET.Element, sphere: ET.Element) -> None:
    """Raises a :class:`MJCFError` where the shell would fall through the plane in MuJoCo."""
    bits = {(geom, name): bits_of(geom, name) for geom in (plane, sphere) for name in ("contype", "conaffinity")}
    if not (
        bits[plane, "contype"] & bits[sphere, "conaffinity"] or bits[sphere, "contype"] & bits[plane, "conaffinity"]
    ):
        raise MJCFError(
            f"The `contype` of {label(plane)} or {label(sphere)} must have a bit of the `conaffinity` of the other, "
            "because the plane holds the shell here, but they have none in common."
        )
    bodies = {"world", *(body.get("name", "") for body in root.iter("body"))} - {""}
    for exclude in root.findall("contact/exclude"):
        pair = [exclude.get(name, "") for name in ("body1", "body2")]
        for name in pair:
            if name not in bodies:
                raise MJCFError(f'Element {label(exclude)} must name two bodies, but one that it names is "{name}".')
        # All others have no contacts here in any case.
        if {"world", shell.get("name")} == set(pair):
            raise MJCFError(
                f"Element {label(exclude)} must not be of the world and the shell, because the plane holds the shell "
                "here; leave it out."
            )


def _check_alignment(shell: ET.Element, key: ET.Element | None, settings: Settings) -> None:
    """Raises a :class:`MJCFError` where a keyframe is of a frame of the shell that MuJoCo chooses, not the file."""
    free = shell.find("freejoint")
    word = "auto" if free is None else word_of(free, "align", ("auto", "true", "false"))
    moves = word == "true" or (word == "auto" and settings.alignfree)
    # MuJoCo aligns no shell with bodies in it; and without numbers of a keyframe the place of the shell remains.
    if free is None or not moves or shell.find("body") is not None or key is None:
        return
    if key.get("qpos") is not None or key.get("qvel") is not None:
        raise MJCFError(
            f"Element {label(shell)} must not be aligned with its principal axes, because the numbers of {label(key)} "
            "are then of other axes than those of the file; leave `align` and `alignfree` out, and change the keyframe."
        )


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


def _friction(plane: ET.Element, sphere: ET.Element) -> Float[np.ndarray, "3"]:
    """Returns the coefficients of sliding, spinning and rolling of the geom with the higher priority, else the larger
    of the two, as MuJoCo has it; 0 for those that it does not heed.
    """
    highest = max(number(geom, "priority", 0.0) for geom in (plane, sphere))
    deciding = [geom for geom in (plane, sphere) if number(geom, "priority", 0.0) == highest]
    # Coefficients that are left out at the end are MuJoCo's.
    coefficients = [numbers(geom, "friction") if geom.get("friction") else np.zeros(0) for geom in deciding]
    friction = np.max([np.append(values, FRICTION[len(values) :])[:3] for values in coefficients], axis=0)
    condim = max(number(geom, "condim", 3.0) for geom in deciding)
    # A contact of one dimension has a normal force alone; MuJoCo heeds friction against spinning from 4 dimensions on,
    # and against rolling with 6.
    friction = np.where([condim > 1, condim >= 4, condim == 6], friction, 0.0)
    if friction[1] > LEAST_FRICTION:
        raise MJCFError(
            f"The friction of {label(plane)} and {label(sphere)} against spinning must be 0, because it has no "
            f"counterpart here, but it is {friction[1]:g}."
        )
    return friction


def _own_frame(shell: ET.Element, sphere: ET.Element, settings: Settings) -> OwnFrame:
    """Returns the frame of the ball in the frame of the element: at the centre of the sphere, along the
    principal axes.
    """
    inertia = settings.inertial_of(shell)
    if inertia is None:
        raise MJCFError(f"Element {label(shell)} must have an <inertial>, or geoms with a mass, but it has none.")
    # The axes must be the principal ones, as a ball here has only three moments.
    return OwnFrame(inertia, Frame(inertia.axes.turn, numbers(sphere, "pos", np.zeros(3))))


def _system(
    shell: ET.Element,
    sphere: ET.Element,
    body_frame: OwnFrame,
    settings: Settings,
    inside: Inside,
    dry: float,
) -> System:
    radius, g = float(numbers(sphere, "size")[0]), float(np.linalg.norm(settings.gravity))
    arguments: dict[str, Any] = {
        "mass": body_frame.inertial.mass,
        "radius": radius,
        "gravity": g,
        "offset": body_frame.inverse.of_point(body_frame.inertial.axes.shift),
        "masses": inside.masses,
        "mechanisms": inside.mechanisms,
        "ground": _ground(settings.gravity),
        "resistance": Resistance(dry=dry / radius) if dry > LEAST_FRICTION else None,  # a length there
    }
    if shell.find("freejoint") is not None:
        return Ball(inertia=body_frame.inertial.moments, **arguments)
    _check_disk(shell, body_frame, settings.angles)
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
    speed = max(np.sqrt(float(system.gravity) * r), float(np.max(np.abs(state.V))))
    slowest, lowest = ROLLS * speed, ROLLS * r
    return bool(np.all(np.abs(slip) <= slowest)) and abs(float(state.height)) <= lowest
