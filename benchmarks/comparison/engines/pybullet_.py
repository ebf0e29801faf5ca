"""PyBullet: the robot as a multibody made by calls, stepped with ``stepSimulation``."""

import importlib
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxball import Scenario
from jaxball.files.mjcf import to_mjcf
from jaxball.files.mjcf.elements import MINVAL
from jaxball.numerics.arrays import to_array
from jaxball.physics.contact.released import ReleasedState, release

from .contract import Case, Motion, Row, Setting, motion_of
from .inside import Hung, angles_by_schedule, in_space, masses_on_hinges

# Untyped, because it need not be installed where types are checked.
bullet: Any = importlib.import_module("pybullet")

TABLE_SIZE = (20.0, 1.0)  # the radius and half the height of a turntable, in radii of the ball
STRONG = 1e9  # the torque of motors that keep what is prescribed


def run(case: Case, setting: Setting, timestep: float) -> Motion:
    """The motion of a robot; raises a ``ValueError`` where this file cannot express it.

    Motors keep prescribed masses where they are to be at the end of each step.
    """
    scenario = in_space(case.scenario())
    system: Any = scenario.system
    exported = to_mjcf(scenario)
    links = masses_on_hinges(exported)
    client = bullet.connect(bullet.DIRECT)
    try:
        ground = system.ground
        up = np.array([0.0, 0.0, 1.0]) if ground is None else np.asarray(ground.up())
        bullet.setGravity(*(-float(system.gravity) * up).tolist())
        bullet.setPhysicsEngineParameter(fixedTimeStep=timestep, **setting.values)
        _add_ground(scenario)
        steps = np.rint(np.diff(scenario.times) / timestep).astype(int)
        times = scenario.times[0] + timestep * np.arange(steps.sum() + 1)
        torques = dict(zip(exported.controls, exported.controls_at(times).T, strict=True))
        driving = Driving(links, angles_by_schedule(system, times), torques)
        robot = _add_robot(scenario, links, driving, scenario.friction_or(case.friction))
        rows, seconds, step = [_row(robot, links, system)], 0.0, 0
        for count in steps:
            begin = time.process_time()
            for k in range(step, step + count):
                driving.apply(robot, k)
                bullet.stepSimulation()
            seconds += time.process_time() - begin
            step += count
            rows.append(_row(robot, links, system))
        return motion_of(rows, seconds)
    finally:
        bullet.disconnect(client)


@dataclass(frozen=True)
class Driving:
    """What drives the joints of a robot: prescribed angles with their rates, or torques, at the ends of all steps."""

    links: list[Hung]
    angles: dict[str, tuple[np.ndarray, np.ndarray]]
    torques: dict[str, np.ndarray]

    def start(self, name: str, otherwise: tuple[float, float]) -> tuple[float, float]:
        """The angle and the rate with which a joint starts: ``otherwise`` where they are not prescribed."""
        return (float(self.angles[name][0][0]), float(self.angles[name][1][0])) if name in self.angles else otherwise

    def apply(self, robot: int, step: int) -> None:
        """Sets the motors for a step."""
        for joint, link in enumerate(self.links):
            if link.name in self.angles:
                theta, rate = (float(values[step + 1]) for values in self.angles[link.name])
                target = {"targetPosition": theta, "targetVelocity": rate, "positionGain": 1.0, "velocityGain": 0.0}
                bullet.setJointMotorControl2(robot, joint, bullet.POSITION_CONTROL, force=STRONG, **target)
            elif link.name in self.torques:
                torque = float(self.torques[link.name][step])
                bullet.setJointMotorControl2(robot, joint, bullet.TORQUE_CONTROL, force=torque)


def _add_ground(scenario: Scenario) -> None:
    system: Any = scenario.system
    ground, r = system.ground, float(system.radius)
    if ground is None or ground.turntable is None:
        plane = bullet.createMultiBody(0.0, bullet.createCollisionShape(bullet.GEOM_PLANE))
        bullet.changeDynamics(plane, -1, lateralFriction=1.0)
        return
    disk = bullet.createCollisionShape(bullet.GEOM_CYLINDER, radius=TABLE_SIZE[0] * r, height=2 * TABLE_SIZE[1] * r)
    centre = (*np.asarray(ground.turntable.centre).tolist(), -TABLE_SIZE[1] * r)
    turning = Hung("turntable", 1.0, np.zeros(3), np.zeros(3), np.array([0.0, 0.0, 1.0]))
    table = bullet.createMultiBody(0.0, -1, basePosition=centre, **_links([turning], disk))
    bullet.changeDynamics(table, 0, lateralFriction=1.0, jointDamping=0.0)
    rate = float(ground.turntable.turning.derivatives(to_array(0.0))[1])
    bullet.resetJointState(table, 0, 0.0, rate)
    bullet.setJointMotorControl2(table, 0, bullet.VELOCITY_CONTROL, targetVelocity=rate, force=STRONG)


def _links(links: Sequence[Hung], shape: int) -> dict[str, Any]:
    """The arguments that add links on hinges."""
    n = len(links)
    return {
        "linkMasses": [link.mass for link in links],
        "linkCollisionShapeIndices": [shape] * n,
        "linkVisualShapeIndices": [-1] * n,
        "linkPositions": [link.point.tolist() for link in links],
        "linkOrientations": [[0, 0, 0, 1]] * n,
        "linkInertialFramePositions": [(link.place - link.point).tolist() for link in links],
        "linkInertialFrameOrientations": [[0, 0, 0, 1]] * n,
        "linkParentIndices": [0] * n,
        "linkJointTypes": [bullet.JOINT_REVOLUTE] * n,
        "linkJointAxis": [link.axis.tolist() for link in links],
    }


def _add_robot(scenario: Scenario, links: list[Hung], driving: Driving, friction: float) -> int:
    """The robot in the initial state, without damping and with its own inertia."""
    system: Any = scenario.system
    state: Any = scenario.state
    state = state if isinstance(state, ReleasedState) else release(system, to_array(0.0), state)
    body, r = state.body, float(system.radius)
    Lambda, offset = np.asarray(body.Lambda), np.asarray(system.offset)
    centre, q = (*np.asarray(body.z).tolist(), r + float(state.height)), np.roll(np.asarray(body.q), -1).tolist()
    sphere = bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=r)
    placed = {"basePosition": centre, "baseOrientation": q, "baseInertialFramePosition": offset.tolist()}
    robot = bullet.createMultiBody(float(system.mass), sphere, **placed, **_links(links, -1))
    undamped = {"linearDamping": 0.0, "angularDamping": 0.0, "jointDamping": 0.0, "restitution": 0.0}
    inertia = np.asarray(system.inertia).tolist()
    bullet.changeDynamics(robot, -1, lateralFriction=friction, localInertiaDiagonal=inertia, **undamped)
    omega = Lambda @ np.asarray(body.Omega)
    V = np.asarray(state.V) + np.cross(omega, Lambda @ offset)  # of its centre of mass
    bullet.resetBaseVelocity(robot, V.tolist(), omega.tolist())
    own = dict(zip(system.coordinates, zip(body.theta.tolist(), body.thetadot.tolist(), strict=True), strict=True))
    for index, link in enumerate(links):
        theta, rate = driving.start(link.name, own.get(link.name, (0.0, 0.0)))
        bullet.changeDynamics(robot, index, localInertiaDiagonal=[MINVAL] * 3, **undamped)
        bullet.setJointMotorControl2(robot, index, bullet.VELOCITY_CONTROL, force=0.0)
        bullet.resetJointState(robot, index, theta, rate)
    return robot


def _row(robot: int, links: list[Hung], system: Any) -> Row:
    centre, quaternion = bullet.getBasePositionAndOrientation(robot)
    V, omega = bullet.getBaseVelocity(robot)
    names = [link.name for link in links]
    joints = [bullet.getJointState(robot, names.index(name))[:2] for name in system.coordinates]
    theta, thetadot = np.asarray(joints, dtype=float).reshape(-1, 2).T
    turn = np.asarray(bullet.getMatrixFromQuaternion(quaternion)).reshape(3, 3)
    arm = -turn @ np.asarray(system.offset)  # from the centre of mass, of which the engine tells
    V = np.asarray(V) + np.cross(omega, arm)
    return np.roll(quaternion, 1), turn.T @ np.asarray(omega), np.asarray(centre) + arm, V, theta, thetadot
