"""PyBullet: the robot as a multibody made by calls, stepped with ``stepSimulation``."""

import importlib
import time
from typing import Any

import numpy as np

from ...mjcf import MJCFError, to_mjcf
from ...mjcf.elements import LEAST
from ...numerics.arrays import to_array
from ...physics.body import Ball
from ...physics.contact.released import ReleasedState, released
from ...physics.mechanisms import Hinge, Mechanism
from ...scenario import Scenario
from .contract import Case, Motion, Row, Setting, motion_of

# Untyped, because it need not be installed where types are checked.
bullet: Any = importlib.import_module("pybullet")

TABLE = (20.0, 1.0)  # the radius and half the height of a turntable, in radii of the ball
STRONG = 1e9  # the torque that keeps its rate


def run(case: Case, setting: Setting, timestep: float) -> Motion:
    """The motion of a robot; raises a ``ValueError`` where this file cannot express it."""
    scenario = case.scenario()
    system: Any = scenario.system
    exported = to_mjcf(scenario)
    _check(system, exported.notes)
    client = bullet.connect(bullet.DIRECT)
    try:
        ground = system.ground
        up = np.array([0.0, 0.0, 1.0]) if ground is None else np.asarray(ground.up())
        bullet.setGravity(*(-float(system.gravity) * up).tolist())
        bullet.setPhysicsEngineParameter(fixedTimeStep=timestep, **setting.values)
        _add_ground(scenario)
        robot = _add_robot(scenario, scenario.friction_or(case.friction))
        steps = np.rint(np.diff(scenario.times) / timestep).astype(int)
        controls = exported.controls_at(timestep * np.arange(steps.sum()))
        rows, seconds, step = [_row(robot, system)], 0.0, 0
        for count in steps:
            begin = time.process_time()
            for control in controls[step : step + count]:
                for joint, torque in enumerate(control):
                    bullet.setJointMotorControl2(robot, joint, bullet.TORQUE_CONTROL, force=float(torque))
                bullet.stepSimulation()
            seconds += time.process_time() - begin
            step += count
            rows.append(_row(robot, system))
        return motion_of(rows, seconds)
    finally:
        bullet.disconnect(client)


def _check(system: Any, notes: tuple[str, ...]) -> None:
    if not isinstance(system, Ball) or any("servos" in note for note in notes):
        raise MJCFError("Disks and prescribed masses are left out, because this file makes balls with pendulums only.")
    for mechanism in system.mechanisms:
        one_hinge = isinstance(mechanism, Mechanism) and isinstance(mechanism.joints[0], Hinge)
        if not one_hinge or mechanism.n_joints != 1 or len(mechanism.mass) != 1:
            raise MJCFError("Mechanisms other than a mass on a hinge are left out, because this file makes no others.")


def _add_ground(scenario: Scenario) -> None:
    system: Any = scenario.system
    ground, r = system.ground, float(system.radius)
    if ground is None or ground.turntable is None:
        plane = bullet.createMultiBody(0.0, bullet.createCollisionShape(bullet.GEOM_PLANE))
        bullet.changeDynamics(plane, -1, lateralFriction=1.0)
        return
    disk = bullet.createCollisionShape(bullet.GEOM_CYLINDER, radius=TABLE[0] * r, height=2 * TABLE[1] * r)
    centre = (*np.asarray(ground.turntable.centre).tolist(), -TABLE[1] * r)
    table = bullet.createMultiBody(
        0.0, -1, basePosition=centre, **_link(1.0, disk, np.zeros(3), np.zeros(3), (0, 0, 1))
    )
    bullet.changeDynamics(table, 0, lateralFriction=1.0, jointDamping=0.0)
    rate = float(ground.turntable.turning.derivatives(to_array(0.0))[1])
    bullet.resetJointState(table, 0, 0.0, rate)
    bullet.setJointMotorControl2(table, 0, bullet.VELOCITY_CONTROL, targetVelocity=rate, force=STRONG)


def _link(mass: float, shape: int, point: np.ndarray, place: np.ndarray, axis: Any) -> dict[str, Any]:
    """The arguments that add a link on a hinge through ``point``, with its centre of mass at ``place``."""
    return {
        "linkMasses": [mass],
        "linkCollisionShapeIndices": [shape],
        "linkVisualShapeIndices": [-1],
        "linkPositions": [point.tolist()],
        "linkOrientations": [[0, 0, 0, 1]],
        "linkInertialFramePositions": [(place - point).tolist()],
        "linkInertialFrameOrientations": [[0, 0, 0, 1]],
        "linkParentIndices": [0],
        "linkJointTypes": [bullet.JOINT_REVOLUTE],
        "linkJointAxis": [axis],
    }


def _add_robot(scenario: Scenario, friction: float) -> int:
    """The robot in the initial state, without damping and with its own inertia."""
    system: Any = scenario.system
    state: Any = scenario.state
    state = state if isinstance(state, ReleasedState) else released(system, to_array(0.0), state)
    body, r = state.body, float(system.radius)
    links: dict[str, Any] = {}
    for mechanism in system.mechanisms:
        joint = mechanism.joints[0]
        mass, place = float(mechanism.mass[0]), np.asarray(mechanism.place[0])
        links = _link(mass, -1, np.asarray(joint.point), place, np.asarray(joint.axis).tolist())
    centre, q = (*np.asarray(body.z).tolist(), r + float(state.height)), np.roll(np.asarray(body.q), -1).tolist()
    sphere = bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=r)
    robot = bullet.createMultiBody(float(system.mass), sphere, basePosition=centre, baseOrientation=q, **links)
    undamped = {"linearDamping": 0.0, "angularDamping": 0.0, "jointDamping": 0.0, "restitution": 0.0}
    inertia = np.asarray(system.inertia).tolist()
    bullet.changeDynamics(robot, -1, lateralFriction=friction, localInertiaDiagonal=inertia, **undamped)
    omega = np.asarray(body.Lambda) @ np.asarray(body.Omega)
    bullet.resetBaseVelocity(robot, np.asarray(state.V).tolist(), omega.tolist())
    for index, (theta, rate) in enumerate(zip(np.asarray(body.theta), np.asarray(body.thetadot), strict=True)):
        bullet.changeDynamics(robot, index, localInertiaDiagonal=[LEAST] * 3, **undamped)
        bullet.setJointMotorControl2(robot, index, bullet.VELOCITY_CONTROL, force=0.0)
        bullet.resetJointState(robot, index, float(theta), float(rate))
    return robot


def _row(robot: int, system: Any) -> Row:
    centre, quaternion = bullet.getBasePositionAndOrientation(robot)
    V, omega = bullet.getBaseVelocity(robot)
    joints = [bullet.getJointState(robot, joint)[:2] for joint in range(bullet.getNumJoints(robot))]
    theta, thetadot = np.asarray(joints, dtype=float).reshape(-1, 2).T
    turn = np.asarray(bullet.getMatrixFromQuaternion(quaternion)).reshape(3, 3)
    return np.roll(quaternion, 1), turn.T @ np.asarray(omega), np.asarray(centre), np.asarray(V), theta, thetadot
