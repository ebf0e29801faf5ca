"""Reads a URDF file as a scenario: a ball with mechanisms, on a plane."""

import xml.etree.ElementTree as ET
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ...interface.wording import all_of, did_you_mean
from ...numerics.arrays import Numbers
from ...physics.body import Ball
from ...physics.mechanisms import (
    AbstractJoint,
    AbstractJointForce,
    CarriedMass,
    Damper,
    Hinge,
    JointFriction,
    Mechanism,
    Slider,
)
from ...physics.state import BallState
from ..mjcf.elements import Frame, Source, label
from ..mjcf.inside import masses_of, sum_forces
from ..mjcf.reading import Imported
from ..mjcf.writing import TIMES
from ..scenario.scenario import Scenario
from .tree import (
    CONTACT,
    HINGES,
    LOOK,
    Joint,
    Shape,
    Tree,
    URDFError,
    check_names,
    number,
    numbers,
    parse,
    reach,
    read_tree,
    shapes_of,
)

GRAVITY = 9.81  # in m/s², the units of every URDF file
WITHIN = 1 + 1e-9  # of the radius, up to which shapes are inside the shell
READ = ("link", "joint", "material")


class Shell(NamedTuple):
    """The link that rolls, the radius of its sphere, and the sphere's frame in that of the link."""

    link: str
    radius: float
    frame: Frame


def read_urdf(
    source: Source, *, shell: str | None = None, times: Numbers = TIMES, gravity: float = GRAVITY
) -> Imported:
    """Reads the scenario of a ball with mechanisms that a URDF file describes, at rest on a level plane.

    The shell is the link with a sphere as its collision, or, where no link has one, as its visual. All other links are
    inside, on joints that are revolute, continuous, prismatic or fixed, to whichever side of the shell the root is.
    `damping` and `friction` of joints are read. The root stands upright, with its z up.

    **Arguments:**

    - ``source``: the path of the file, which xacro has expanded, or its text.
    - ``shell``: the name of the link that rolls, where several have a sphere; the others must be within its own.
    - ``times``: the save times, increasing, in s; 0 to 10 by 0.1 if not given.
    - ``gravity``: in m/s², which URDF does not state.

    **Raises:** :class:`URDFError` for anything else, with the name of the element; ``ValueError`` for a ``gravity``
    that is negative or not finite.

    **Example:**

    >>> from jaxball.files.urdf import read_urdf
    >>> ball = '''<robot name="ball"><link name="shell">
    ...   <inertial><mass value="2"/><inertia ixx="0.05" iyy="0.05" izz="0.05"/></inertial>
    ...   <collision><geometry><sphere radius="0.2"/></geometry></collision>
    ... </link></robot>'''
    >>> float(read_urdf(ball).scenario.system.radius)
    0.2
    """
    robot = parse(source)
    unread = check_names(robot)
    if not 0 <= gravity < np.inf:
        raise ValueError(f"Argument `gravity` must be a number that is not negative, but it is {gravity:g}.")
    tree = read_tree(robot)
    shapes = {name: shapes_of(link) for name, link in tree.links.items()}
    rolls = _shell(tree, shapes, shell)
    _check_inside(tree, shapes, rolls)
    shell_inertia = tree.inertial(rolls.link)
    if shell_inertia is None:
        raise URDFError(f"Element {label(tree.links[rolls.link])} must have an <inertial>, but it has none.")
    # The axes must be the principal ones, as a ball here has only three moments.
    ball = Frame(shell_inertia.axes.turn, tree.frames[rolls.link].of_point(rolls.frame.shift))
    inside = _Inside(tree, ball)
    inside.read_joints(rolls.link)
    system = Ball(
        mass=shell_inertia.mass,
        radius=rolls.radius,
        inertia=shell_inertia.moments,
        gravity=gravity,
        offset=ball.turn.T @ (shell_inertia.axes.shift - ball.shift),
        mechanisms=tuple(inside.mechanisms),
    )
    still = np.array_equal(ball.turn, np.eye(3))
    q = (1.0, 0.0, 0.0, 0.0) if still else np.roll(Rotation.from_matrix(ball.turn).as_quat(), 1)
    zeros = np.zeros(sum(mechanism.n_joints for mechanism in inside.mechanisms))
    state = BallState(q=q, theta=zeros, thetadot=zeros)
    scenario = Scenario(robot.get("name", ""), system, state, np.asarray(times, dtype=float))
    return Imported(scenario, (*_notes(robot, tree, shapes), *unread))


def _shell(tree: Tree, shapes: dict[str, list[Shape]], asked: str | None) -> Shell:
    spheres = {
        purpose: [(name, shape) for name, entries in shapes.items() for shape in entries if _is_sphere(shape, purpose)]
        for purpose in (CONTACT, LOOK)
    }
    if asked is not None and asked not in tree.links:
        others = did_you_mean(asked, tuple(tree.links), f"its links are {', '.join(tree.links)}")
        raise URDFError(f'Argument `shell` must be a link of the file, but it is "{asked}"{others}')
    # Contacts come first: a sphere that is only shown counts where nothing else rolls.
    for candidates in spheres.values():
        entries = [(name, shape) for name, shape in candidates if asked in (None, name)]
        if len(entries) > 1:
            which = all_of([label(tree.links[name]) for name, _ in entries])
            out = "leave all but one out" if asked else "name the link that rolls, `shell`, which contains the others"
            raise URDFError(f"There must be one sphere, the shell, but {len(entries)} are in {which}; {out}.")
        if entries:
            ((name, shape),) = entries
            radius = number(shape.element, "radius", tree.links[name])
            if not 0 < radius < np.inf:
                raise URDFError(
                    f"Attribute `radius` of the sphere in {label(tree.links[name])} must be positive, but it is "
                    f"{radius:g}."
                )
            return Shell(name, radius, shape.frame)
    who = f"Element {label(tree.links[asked])} must have" if asked else "There must be a link with"
    raise URDFError(
        f'{who} a sphere, which rolls, but there is none; give the <collision> of the shell a <sphere radius="…"/>.'
    )


def _is_sphere(shape: Shape, purpose: str) -> bool:
    return shape.element.tag == "sphere" and shape.purpose == purpose


def _check_inside(tree: Tree, shapes: dict[str, list[Shape]], shell: Shell) -> None:
    """Raises unless nothing but the shell can touch the plane, and for meshes of links that state no inertia."""
    centre = tree.frames[shell.link].of_point(shell.frame.shift)
    for name, link_shapes in shapes.items():
        link, frame = tree.links[name], tree.frames[name]
        if link.find("inertial") is None and any(shape.element.tag == "mesh" for shape in link_shapes):
            raise URDFError(
                f"Element {label(link)} must have an <inertial>, because the mass of its mesh is not computed here, "
                "but it has none; state its mass and its inertia."
            )
        for shape in link_shapes:
            if shape.purpose == LOOK or shape.element.tag == "mesh":
                continue
            far = reach(shape, link, frame.turn.T @ (centre - frame.shift))
            if far > WITHIN * shell.radius:
                raise URDFError(
                    f"The <collision> of {label(link)} must be inside the shell, a sphere of radius {shell.radius:g}, "
                    f"because only the shell rolls here, but it reaches {far:g} from its centre; wheels on the ground "
                    "have no counterpart, and what never touches it needs no <collision>."
                )


class _Inside:
    """The mechanisms in a shell, while they are read; ``ball`` is the frame of the ball in that of the root."""

    def __init__(self, tree: Tree, ball: Frame):
        self.tree, self.mechanisms = tree, list[Mechanism]()
        self.into = Frame(ball.turn.T, -ball.turn.T @ ball.shift)

    def read_joints(self, shell: str) -> None:
        """Reads each joint on the links that are fixed to the shell, and what is on it, as a mechanism."""
        # All joints on the shell's rigid part: whatever is fixed to the shell is the shell.
        for joint in self._joints_on(shell, None):
            self.joints: list[AbstractJoint] = []
            self.masses: list[CarriedMass] = []
            self.names: list[str] = []
            # By a list, because a chain may be longer than calls of functions may be nested.
            waiting: list[tuple[Joint, str, int | None]] = [(joint, shell, None)]
            while waiting:
                waiting += reversed(self._read_joint(*waiting.pop()))
            try:
                self.mechanisms.append(Mechanism(self.joints, self.masses))
            except ValueError as error:
                raise URDFError(f"The links on {all_of(self.names)} are no mechanism: {error}") from None

    def _joints_on(self, link: str, but: Joint | None) -> list[Joint]:
        rigid = self.tree.rigid
        ends = ((joint, rigid[joint.parent], rigid[joint.child]) for joint in self.tree.joints if joint is not but)
        return [joint for joint, parent, child in ends if rigid[link] in (parent, child)]

    def _read_joint(self, joint: Joint, inner: str, on: int | None) -> list[tuple[Joint, str, int | None]]:
        """Reads a joint on the link ``inner``, which the joint with the index ``on`` carries, None if it is the shell.

        Where the shell is on the side of the child, the joint turns the other way. Returns the joints further out, with
        what they are on.
        """
        before, forward = len(self.joints) - 1, self.tree.rigid[joint.parent] == self.tree.rigid[inner]
        # URDF puts a joint at the origin of its child, also where the shell is the child.
        frame = self.into.then(self.tree.frames[joint.child])
        axis = frame.turn @ _axis(joint) * (1.0 if forward else -1.0)
        drive, carrier = _forces(joint), None if on in (None, before) else on
        hinged = joint.kind in HINGES
        self.joints.append(Hinge(axis, frame.shift, drive, carrier) if hinged else Slider(axis, drive, carrier))
        self.names.append(label(joint.element))
        # The tree is walked outwards from the shell, not from the root.
        outer = joint.child if forward else joint.parent
        inertia = self.tree.inertial(outer)
        if inertia is not None:
            self.masses += masses_of(inertia._replace(axes=self.into.then(inertia.axes)), before + 1)
        return [(further, outer, before + 1) for further in self._joints_on(outer, joint)]


def _axis(joint: Joint) -> np.ndarray:
    element = joint.element.find("axis")
    axis = np.array([1.0, 0.0, 0.0]) if element is None else numbers(element, "xyz", 3, joint.element)
    if not np.any(axis != 0):
        raise URDFError(f"The <axis> of {label(joint.element)} must be a direction, but it is 0.")
    return axis


def _forces(joint: Joint) -> AbstractJointForce | None:
    """Reads the damper and the dry friction of a joint."""
    element = joint.element.find("dynamics")
    if element is None:
        return None
    forces: list[AbstractJointForce] = []
    for name, kind in (("damping", Damper), ("friction", JointFriction)):
        value = number(element, name, joint.element, 0.0)
        if value < 0:
            raise URDFError(f"The `{name}` of {label(joint.element)} must be 0 or positive, but it is {value:g}.")
        forces += [kind(value)] if value else []
    return sum_forces(forces)


def _notes(robot: ET.Element, tree: Tree, shapes: dict[str, list[Shape]]) -> list[str]:
    """Returns the sentences about the parts of the file that were left out."""
    notes = []
    for joint in tree.joints:
        limit = joint.element.find("limit")
        if limit is not None and joint.kind != "continuous":
            ends = [number(limit, name, joint.element, 0.0) for name in ("lower", "upper")]
            notes.append(
                f"The limits of {label(joint.element)}, {ends[0]:g} and {ends[1]:g}, were not imported, because URDF "
                "gives them no stiffness; add `end-stops` to the joint in the scenario."
            )
    limited = [joint for joint in tree.joints if joint.element.find("limit") is not None]
    if limited:
        notes.append(
            f"The `effort` and `velocity` of {all_of([label(joint.element) for joint in limited])} were not imported, "
            "because URDF has no motors; give them to those that you add."
        )
    meshes = [
        label(tree.links[name])
        for name, link_shapes in shapes.items()
        if any(shape.element.tag == "mesh" and shape.purpose == CONTACT for shape in link_shapes)
    ]
    if meshes:
        notes.append(f"The meshes of {all_of(meshes)} were not read; they are taken to be inside the shell.")
    light = [label(link) for name, link in tree.links.items() if link.find("inertial") is None and shapes[name]]
    if light:
        notes.append(f"The mass of {all_of(light)} is 0, because there is no <inertial>.")
    others = sorted({element.tag for element in robot if element.tag not in READ})
    if others:
        notes.append(f"{all_of([f'<{tag}>' for tag in others])} in <robot> were not read.")
    return notes
