"""Drake: the robot as MJCF, in a MultibodyPlant that is discrete or continuous."""

import importlib
import logging
import re
import time
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np

from jaxball import Scenario
from jaxball.files.mjcf import MJCFError, to_mjcf
from jaxball.files.mjcf.writing import Exported
from jaxball.numerics.arrays import to_array
from jaxball.physics.contact.released import ReleasedState, release
from jaxball.physics.mechanisms import Hinge

from .contract import Case, Motion, Row, Setting, motion_of
from .inside import angles_by_schedule, in_space

# Untyped, because it need not be installed where types are checked.
drake: Any = importlib.import_module("pydrake.all")

TORQUE_SAMPLES = 20  # of a torque, in each interval between save times


def run(case: Case, setting: Setting, timestep: float) -> Motion:
    """The motion of a robot; raises :class:`~jaxball.files.mjcf.MJCFError` where Drake cannot express it.

    Of a continuous plant, ``timestep`` is the accuracy that its integrator is asked for.
    """
    scenario, continuous = in_space(case.scenario()), setting.values.get("continuous", False)
    exported = to_mjcf(scenario) if continuous else to_mjcf(scenario, timestep=timestep)
    angles = angles_by_schedule(scenario.system, scenario.times[:1])
    _check(scenario, bool(angles), setting)
    step = 0.0 if continuous else timestep
    config = drake.MultibodyPlantConfig(time_step=step, contact_model="point", **setting.values.get("plant", {}))
    builder = drake.DiagramBuilder()
    plant, scene = drake.AddMultibodyPlant(config, builder)
    sliding = scenario.friction_or(case.friction)
    text = re.sub('friction="[^"]*"', f'friction="{sliding!r} 0 0"', exported.text)
    _parse(plant, text)
    if "stiffness" in setting.values:
        _stiffen(plant, scene, setting.values["stiffness"])
    _add_servos(plant, exported)
    _set_gravity(plant, scenario)
    plant.Finalize()
    if exported.controls:
        _connect(builder, plant, scenario, exported, servos=bool(angles), ahead=step)
    simulator = drake.Simulator(builder.Build())
    if continuous:
        accurate = {"accuracy": timestep, "use_error_control": True, "max_step_size": 0.1}
        scheme = setting.values.get("scheme", "runge_kutta3")
        drake.ApplySimulatorConfig(drake.SimulatorConfig(integration_scheme=scheme, **accurate), simulator)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    _start(plant, context, scenario, angles)
    simulator.Initialize()
    rows, seconds = [_row(plant, context, scenario)], 0.0
    for t in scenario.times[1:] - scenario.times[0]:
        begin = time.process_time()
        simulator.AdvanceTo(float(t))
        seconds += time.process_time() - begin
        rows.append(_row(plant, context, scenario))
    steps = (simulator.get_integrator() if continuous else simulator).get_num_steps_taken()
    return motion_of(rows, seconds, steps)


def _parse(plant: Any, text: str) -> None:
    """Adds the robot, without a warning for every attribute that Drake does not read."""
    log = logging.getLogger("drake")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        drake.Parser(plant).AddModelsFromString(text, "xml")
    finally:
        log.setLevel(level)


def _stiffen(plant: Any, scene: Any, stiffness: float) -> None:
    """Gives every contact this stiffness, in N/m, where the parser has given its own."""
    inspector = scene.model_inspector()
    for identity in inspector.GetAllGeometryIds(drake.Role.kProximity):
        properties = drake.ProximityProperties(inspector.GetProximityProperties(identity))
        properties.UpdateProperty("material", "point_contact_stiffness", stiffness)
        scene.AssignRole(plant.get_source_id(), identity, properties, drake.RoleAssign.kReplace)


def _add_servos(plant: Any, exported: Exported) -> None:
    """The servos of prescribed masses, which Drake does not read from MJCF, as its own, implicit in each step."""
    for servo in ET.fromstring(exported.text).findall("actuator/general"):
        name = servo.get("joint", "")
        stiffness = float(servo.get("gainprm", ""))
        damping = -float(servo.get("biasprm", "").split()[2])
        actuator = plant.AddJointActuator(name, plant.GetJointByName(name))
        actuator.set_controller_gains(drake.PdControllerGains(p=stiffness, d=damping))


def _connect(builder: Any, plant: Any, scenario: Scenario, exported: Exported, *, servos: bool, ahead: float) -> None:
    """Connects the controls: torques, or what servos are to reach at the end of each step, which is ``ahead``."""
    times = np.linspace(scenario.times[0], scenario.times[-1], TORQUE_SAMPLES * (len(scenario.times) - 1) + 1)
    controls = exported.controls_at(times + ahead if servos else times).T
    values = np.concatenate([controls, np.zeros_like(controls)]) if servos else controls
    source = builder.AddSystem(
        drake.TrajectorySource(drake.PiecewisePolynomial.CubicShapePreserving(times, values, False))
    )
    robot = plant.GetBodyByName("shell").model_instance()
    port = plant.get_desired_state_input_port(robot) if servos else plant.get_actuation_input_port()
    builder.Connect(source.get_output_port(), port)


def _check(scenario: Scenario, servos: bool, setting: Setting) -> None:
    if servos and setting.name == "TAMSI":
        raise MJCFError("Prescribed masses are left out, because TAMSI has no servos.")
    system: Any = scenario.system  # whose mechanisms have joints, or they could not have been written
    if any(not isinstance(joint, Hinge) for mechanism in system.mechanisms for joint in mechanism.joints):
        raise MJCFError("Mechanisms with other joints than hinges are left out, because this file starts no others.")


def _set_gravity(plant: Any, scenario: Scenario) -> None:
    system: Any = scenario.system
    ground = system.ground
    up = np.array([0.0, 0.0, 1.0]) if ground is None else np.asarray(ground.up())
    plant.mutable_gravity_field().set_gravity_vector(-float(system.gravity) * up)


def _start(plant: Any, context: Any, scenario: Scenario, angles: Any) -> None:
    """The initial state of the scenario, with the first of the prescribed ``angles`` and their rates."""
    system: Any = scenario.system
    state: Any = scenario.state
    t = to_array(float(scenario.times[0]))
    state = state if isinstance(state, ReleasedState) else release(system, t, state)
    body, shell = state.body, plant.GetBodyByName("shell")
    q = np.asarray(body.q / np.linalg.norm(body.q))
    pose = drake.RigidTransform(drake.Quaternion(q), [*np.asarray(body.z), float(system.radius) + float(state.height)])
    plant.SetFreeBodyPose(context, shell, pose)
    velocity = drake.SpatialVelocity(np.asarray(body.Lambda) @ np.asarray(body.Omega), np.asarray(state.V))
    plant.SetFreeBodySpatialVelocity(context=context, body=shell, V_JpJc=velocity)
    for name, theta, rate in zip(system.coordinates, np.asarray(body.theta), np.asarray(body.thetadot), strict=True):
        joint = plant.GetJointByName(name)
        joint.set_angle(context, theta)
        joint.set_angular_rate(context, rate)
    for name, (theta, rate) in angles.items():
        joint = plant.GetJointByName(name)
        joint.set_angle(context, float(theta[0]))
        joint.set_angular_rate(context, float(rate[0]))
    if system.ground is not None and system.ground.turntable is not None:
        rate = system.ground.turntable.turning.derivatives(t)[1]
        plant.GetJointByName("turntable").set_angular_rate(context, float(rate))


def _row(plant: Any, context: Any, scenario: Scenario) -> Row:
    shell = plant.GetBodyByName("shell")
    pose, velocity = shell.EvalPoseInWorld(context), shell.EvalSpatialVelocityInWorld(context)
    turn = pose.rotation()
    system: Any = scenario.system
    joints = [plant.GetJointByName(name) for name in system.coordinates]
    theta = np.array([joint.get_angle(context) for joint in joints])
    thetadot = np.array([joint.get_angular_rate(context) for joint in joints])
    Omega = turn.matrix().T @ velocity.rotational()
    return turn.ToQuaternion().wxyz(), Omega, pose.translation(), velocity.translational(), theta, thetadot
