"""Files as an own reading of URDF has them: masses, forces, and accelerations of rolling, by d'Alembert's principle.

The reading here follows each link along a motion by the frames of the file, and differentiates what it sees in time.
"""

import xml.etree.ElementTree as ET

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxball import BallState, observe
from jaxball.files.urdf import read_urdf

from .robots import rotation, turned

VARIANTS = 12  # of each tree, whose equations compile once
STEP = 0.003
# Of order 8: accelerations of 100, which light shells have, leave 1e-11 of truncation.
FIRST = np.array([3, -32, 168, -672, 0, 672, -168, 32, -3]) / 840
SECOND = np.array([-9, 128, -1008, 8064, -14350, 8064, -1008, 128, -9]) / 5040
CLOSE = 1e-9  # of the largest; rounding over STEP² is 1e-11, in sums of some dozens
GRAVITY = np.array([0.0, 0.0, -9.81])
TREES = {
    "shell first": [("shell", "arm", "continuous"), ("arm", "tip", "prismatic"), ("shell", "plate", "fixed")],
    "frame first": [("frame", "shell", "continuous"), ("frame", "arm", "revolute"), ("arm", "plate", "fixed")],
}


def numbers(values):
    return " ".join(repr(float(x)) for x in values)


def robot(tree, rng):
    """A file in which every number is random."""

    def origin(size=0.05):
        return f'<origin xyz="{numbers(rng.uniform(-size, size, 3))}" rpy="{numbers(rng.normal(size=3))}"/>'

    text = []
    for link in dict.fromkeys(name for parent, child, _ in TREES[tree] for name in (parent, child)):
        size = 0.05 if link == "shell" else 0.003
        diagonal, off = size * rng.uniform(1.0, 1.3, 3), size * rng.uniform(-0.2, 0.2, 3)
        values = zip(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), [*diagonal, *off], strict=True)
        inertia = " ".join(f'{name}="{float(value)!r}"' for name, value in values)
        mass = f'<mass value="{float(rng.uniform(0.2, 2.0))!r}"/>'
        ball = (
            f'<collision>{origin(0.02)}<geometry><sphere radius="0.4"/></geometry></collision>'
            if link == "shell"
            else ""
        )
        text.append(f'<link name="{link}"><inertial>{origin()}{mass}<inertia {inertia}/></inertial>{ball}</link>')
    for index, (parent, child, kind) in enumerate(TREES[tree]):
        damping = f'<dynamics damping="{float(rng.uniform(0.01, 0.1))!r}"/>' if kind != "fixed" else ""
        limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>' if kind in ("revolute", "prismatic") else ""
        axis = f'<axis xyz="{numbers(rng.normal(size=3))}"/>'
        text.append(
            f'<joint name="{index}" type="{kind}">{origin()}<parent link="{parent}"/><child link="{child}"/>{axis}'
            f"{damping}{limit}</joint>"
        )
    return f"<robot name='{tree}'>{''.join(text)}</robot>"


def floats(element, name, default="0 0 0"):
    return np.array(
        [float(word) for word in ("" if element is None else element.get(name, "")).split() or default.split()]
    )


def frame(element):
    """A frame as a matrix of 4 × 4."""
    origin = element.find("origin")
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turned(*floats(origin, "rpy")), floats(origin, "xyz")
    return matrix


class Reading:
    """The links of a file with their masses, and where joints put them."""

    def __init__(self, text):
        self.robot = ET.fromstring(text)
        self.links = {link.get("name"): link for link in self.robot.findall("link")}
        self.joints = self.robot.findall("joint")
        self.moving = [joint for joint in self.joints if joint.get("type") != "fixed"]

    def poses(self, theta):
        """Where the links are in the root; the file lists parents first."""
        (root,) = set(self.links) - {joint.find("child").get("link") for joint in self.joints}
        places, angles = {root: np.eye(4)}, iter(theta)
        for joint in self.joints:
            moved = np.eye(4)
            if joint.get("type") != "fixed":
                axis = floats(joint.find("axis"), "xyz")
                along = axis / np.linalg.norm(axis) * next(angles)
                if joint.get("type") == "prismatic":
                    moved[:3, 3] = along
                else:
                    moved[:3, :3] = Rotation.from_rotvec(along).as_matrix()
            places[joint.find("child").get("link")] = places[joint.find("parent").get("link")] @ frame(joint) @ moved
        return places

    def inertia(self, name):
        """The mass of a link, and its frame and its inertia at its centre of mass."""
        inertial = self.links[name].find("inertial")
        xx, yy, zz, xy, xz, yz = (
            float(inertial.find("inertia").get(k)) for k in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        )
        full = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        return float(inertial.find("mass").get("value")), frame(inertial), full

    def motion(self, R, axes, theta, u, udot):
        """v, a, ω, α and R of each link at its centre of mass, where the ball rolls with (Ω, θ̇) and their rates."""
        collision = self.links["shell"].find("collision")
        radius = float(collision.find("geometry/sphere").get("radius"))
        up = np.array([0.0, 0.0, radius])
        seen = {name: [] for name in self.links}
        for t in STEP * np.arange(-4, 5):
            shell = np.eye(4)  # the collision's frame, whose origin is the centre of the ball, in space
            turn = R @ Rotation.from_rotvec(u[:3] * t + udot[:3] * t**2 / 2).as_matrix()
            shell[:3, :3] = turn @ axes.T
            shell[:3, 3] = np.cross(R @ u[:3], up) * t + np.cross(R @ udot[:3], up) * t**2 / 2
            places = self.poses(theta + u[3:] * t + udot[3:] * t**2 / 2)
            to_space = shell @ np.linalg.inv(places["shell"] @ frame(collision))
            for name in self.links:
                seen[name].append(to_space @ places[name] @ self.inertia(name)[1])
        moved = {}
        for name, poses in seen.items():
            now = poses[4]
            rate, second = (np.tensordot(c, poses, 1) / STEP**k for k, c in ((1, FIRST), (2, SECOND)))
            W = rate[:3, :3] @ now[:3, :3].T
            A = second[:3, :3] @ now[:3, :3].T - W @ W
            moved[name] = rate[:3, 3], second[:3, 3], vector(W), vector(A), now[:3, :3]
        return moved


def vector(skew):
    return np.array([skew[2, 1] - skew[1, 2], skew[0, 2] - skew[2, 0], skew[1, 0] - skew[0, 1]]) / 2


@jax.jit
def energy_and_rates(system, state):
    t = jnp.array(0.0)
    return observe(system, t, state).kinetic_energy, type(system).field(system, t, state)


@pytest.mark.parametrize("tree", [pytest.param(name, marks=pytest.mark.thorough) for name in TREES])
def test_files_have_the_masses_forces_and_accelerations_of_an_own_reading(tree):
    """The energy of random velocities, and no work left on any motion that rolls."""
    rng = np.random.default_rng(7)
    for _ in range(VARIANTS):
        text = robot(tree, rng)
        reading, scenario = Reading(text), read_urdf(text).scenario
        order = joints_in_order(scenario.system, reading)
        n = len(reading.moving)
        q, theta, u = rng.normal(size=4), 0.5 * rng.normal(size=n), rng.normal(size=3 + n)
        state = BallState(q=q / np.linalg.norm(q), Omega=u[:3], theta=theta[order], thetadot=u[3:][order])
        energy, rates = energy_and_rates(scenario.system, state)
        udot = np.zeros(3 + n)
        udot[:3], udot[3 + order] = rates.Omega, rates.thetadot
        # The axes of the ball in those of the collision: where the root is upright and the joints are at 0.
        upright = reading.poses(np.zeros(n))["shell"] @ frame(reading.links["shell"].find("collision"))
        axes = rotation(np.asarray(scenario.state.q)).T @ upright[:3, :3]
        moved = reading.motion(rotation(q), axes.T, theta, u, udot)
        parts = [reading.motion(rotation(q), axes.T, theta, unit, np.zeros(3 + n)) for unit in np.eye(3 + n)]
        damping = [float(joint.find("dynamics").get("damping")) for joint in reading.moving]
        left, scale = np.append(np.zeros(3), damping) * u, 0.0
        kinetic = 0.0
        for name in reading.links:
            m, _, full = reading.inertia(name)
            v, a, omega, alpha, R = moved[name]
            inertia = R @ full @ R.T
            kinetic += (m * v @ v + omega @ inertia @ omega) / 2
            force, torque = m * (a - GRAVITY), inertia @ alpha + np.cross(omega, inertia @ omega)
            work = np.array([part[name][0] @ force + part[name][2] @ torque for part in parts])
            left, scale = left + work, scale + np.max(np.abs(work))
        assert abs(float(energy) - kinetic) <= CLOSE * kinetic
        assert np.max(np.abs(left)) <= CLOSE * scale


def joints_in_order(system, reading):
    """For each joint of the system, the index of the joint of the file that it is, by its damping."""
    dampers = [float(drive.coefficient) for mechanism in system.mechanisms for drive in mechanism.drives]
    of_file = [float(joint.find("dynamics").get("damping")) for joint in reading.moving]
    return np.array([of_file.index(damping) for damping in dampers])
