"""Writes a scenario as MJCF: the world, the shell and its start, with what is inside, and sensors."""

import xml.etree.ElementTree as ET
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...interface.arguments import a, describe, require, require_flags, require_one_run
from ...interface.wording import all_of
from ...numerics.arrays import to_array
from ...physics.body import System
from ...physics.contact.released import ReleasedState, release
from ...physics.forces.resistance import Resistance
from ...physics.grounds import AbstractSurface, SphereOutside
from ...physics.grounds.ground import Ground
from ...physics.mechanisms import AbstractJointForce, AbstractMechanism, EndStops, JointForces, JointFriction
from ...physics.prescribed.schedules import ConstantRate
from ...physics.state import BallState, DiskState, RotationState
from ...physics.system import AbstractState, AbstractSystem
from ...simulation.trajectory import Trajectory
from ..scenario.scenario import Scenario
from .drives import Control, control_values, write_recordings
from .elements import LIMITS, MJCFError, add
from .links import SHOWN_RADIUS, Links, write_links
from .sensors import write_sensors

TABLE_RADIUS = 100.0  # the radius of a turntable, in radii of the body
FLYWHEEL = 1e6  # the moment of inertia of a turntable in M r²; solvers lose small ones beside 1e8 to rounding
EXTENT = 10.0  # half the side of a height field, in radii of the body
SPACING = 0.2  # the most between its points, in the same
LARGEST_EXTENT = 100.0  # the same: a file has every height as text
TIMES_AT_REST = 16  # of a scenario, at which a ground must be where it is at the start


def _refuse(refused: bool, key: str, must: str, why: str) -> None:
    """Raises a :class:`MJCFError` where the value of a key is one that MJCF cannot express."""
    if refused:
        raise MJCFError(f"Key `{key}` must be {must} to be written as MJCF, {why}.")


def _check_ground(system: System, times: Float[np.ndarray, " T"]) -> None:
    """Raises a :class:`MJCFError` for a ground that MJCF cannot express."""
    ground = system.ground
    if isinstance(ground, AbstractSurface):
        _check_surface(ground, times)
    _refuse(ground is not None and ground.belt is not None, "ground.belt", "left out", "which has no belts")
    if not isinstance(ground, Ground):
        return
    _refuse(ground.motion is not None, "ground.motion", "left out", "where the plane stays at rest")
    if ground.turntable is not None:
        turning = ground.turntable.turning
        why = f"where a heavy disk turns freely, but it is a {type(turning).__name__}"
        _refuse(not isinstance(turning, ConstantRate), "ground.turntable.turning", "a constant rate", why)


def _check_surface(ground: AbstractSurface, times: Float[np.ndarray, " T"]) -> None:
    must = "Key `ground` must be at rest to be written as MJCF, but"
    if ground.motion is not None or ground.turntable is not None:
        what = "motion" if ground.turntable is None else "turntable"
        raise MJCFError(f"{must} {describe(ground)} with a {what} is not.")
    some = times[:: -(-len(times) // TIMES_AT_REST)]
    # A height is over (x, y) itself; on another surface a pair of coordinates is elsewhere.
    x = y = to_array([0.37, -0.21])  # any two places, in whatever unit: a height is over all of them
    first = _places(ground, to_array(float(times[0])), x, y)
    if not isinstance(ground, SphereOutside) and not np.array_equal(first[:, :2], np.stack([x, y], axis=1)):
        raise MJCFError(
            "Key `ground` must be a plane, the outside of a sphere, or a height over x and y, such as a HeightField, "
            f"to be written as MJCF, but it is {describe(ground)}."
        )
    moved = [_places(ground, to_array(float(t)), x, y) for t in some]
    # NaN is where there is no ground, which is not a motion.
    if not all(np.array_equal(first, later, equal_nan=True) for later in moved):
        raise MJCFError(f"{must} it moves.")


@eqx.filter_jit
def _places(ground: AbstractSurface, t: Array, x: Float[Array, " n"], y: Float[Array, " n"]) -> Float[Array, "n 3"]:
    prepared = ground.prepare()
    return jax.vmap(lambda x, y: prepared.place(t, x, y))(x, y)


def centre_at_start(
    system: System, t: Float[Array, ""], z: Float[Array, "*two"], height: Float[Array, ""]
) -> Float[np.ndarray, "3"]:
    """Returns where the centre of a body is in space that is ``height`` above the place ``z`` of its ground, length."""
    ground, r = system.ground, system.radius + height
    if isinstance(ground, AbstractSurface):
        return np.asarray(ground.prepare().place_of_centre(t, r, z))
    x, y = np.append(np.asarray(z), 0.0)[:2]  # a disk rolls along e1
    return np.array([x, y, float(r)])


def write_ground(
    root: ET.Element,
    world: ET.Element,
    system: System,
    start: tuple[Float[Array, ""], Float[np.ndarray, "3"]],
    friction: dict[str, Any],
    extent: float | None,
) -> tuple[str, ...]:
    """Writes the ground into the ``world``, and its heights into ``root``; returns a sentence if MuJoCo has another.

    ``start`` is the time and the place of the body's centre then, around which a height field is written up to
    ``extent``.
    """
    r, ground = float(system.radius), system.ground
    if extent is not None and (isinstance(ground, SphereOutside) or not isinstance(ground, AbstractSurface)):
        raise MJCFError("Argument `extent` must be left out for a ground that is written without a height field.")
    if isinstance(ground, SphereOutside):
        R = float(ground.radius)
        add(world, "geom", name="ground", type="sphere", size=R, pos=(0.0, 0.0, -R), **friction)
        return ()
    if isinstance(ground, AbstractSurface):
        return _write_heights(root, world, ground, start, r, friction, EXTENT * r if extent is None else extent)
    if not isinstance(ground, Ground) or ground.turntable is None:
        # Zeros are a plane without end; the last number is the mesh in which it is drawn.
        add(world, "geom", name="plane", type="plane", size=(0.0, 0.0, 0.1 * r), **friction)
        return ()
    centre = np.asarray(ground.turntable.centre)
    # As half the disk's height is r, its top is the plane z = 0.
    table = add(world, "body", name="turntable", pos=(*centre, -r))
    add(table, "joint", name="turntable", type="hinge", axis=(0.0, 0.0, 1.0))
    # So heavy that nothing on it changes its rate.
    heavy = FLYWHEEL * float(system.total_mass) * r**2
    add(table, "inertial", pos=np.zeros(3), mass=system.total_mass, diaginertia=(heavy,) * 3)
    add(table, "geom", name="turntable", type="cylinder", size=(TABLE_RADIUS * r, r), **friction)
    return ()


def _write_heights(
    root: ET.Element,
    world: ET.Element,
    ground: AbstractSurface,
    start: tuple[Float[Array, ""], Float[np.ndarray, "3"]],
    r: float,
    friction: dict[str, Any],
    extent: float,
) -> tuple[str, ...]:
    t, centre = start
    largest = LARGEST_EXTENT * r
    if not 0 < extent <= largest:
        raise MJCFError(
            f"Argument `extent` must be a positive length of at most {largest:g}, a hundred radii, because a file has "
            f"a million heights then, but it is {extent:g}."
        )
    # Odd, so that one of them is at the start.
    count = 2 * int(np.ceil(extent / (SPACING * r))) + 1
    offsets = np.linspace(-extent, extent, count)
    # MuJoCo reads heights as one looks at a map: the first row is that of the largest y.
    y, x = (axis.ravel() for axis in np.meshgrid(centre[1] - offsets, centre[0] + offsets, indexing="ij"))
    heights = np.asarray(_places(ground, t, jnp.asarray(x), jnp.asarray(y)))[:, 2]
    if not np.isfinite(heights).all():
        raise MJCFError(
            f"Argument `extent` must be less than {extent:g}, because the ground ends nearer to the start than that."
        )
    lowest, rise = float(heights.min()), float(np.ptp(heights))
    # MuJoCo scales heights to those of `size`, which must be positive, and continues the ground below by the last.
    size = (extent, extent, rise if rise > 0 else r, r)
    name = {"name": "ground"}
    assets = ET.SubElement(root, "asset")
    add(assets, "hfield", **name, nrow=str(count), ncol=str(count), size=size, elevation=heights)
    add(world, "geom", **name, type="hfield", hfield="ground", pos=(centre[0], centre[1], lowest), **friction)
    return (
        f"The ground is a height field of flat triangles with sides of {offsets[1] - offsets[0]:g}, over whose edges a "
        f"ball bumps, and ends {extent:g} from the start.",
    )


TIMESTEP = 0.002  # MuJoCo's own
TIMES = np.linspace(0.0, 10.0, 101)  # of a robot that states none
STICKING = 1.0  # the coefficient of friction of a body that always rolls: MuJoCo's own
ROOT = {
    "x": {"type": "slide", "axis": (1.0, 0.0, 0.0)},
    "z": {"type": "slide", "axis": (0.0, 0.0, 1.0)},
    "phi": {"type": "hinge", "axis": (0.0, -1.0, 0.0)},
}


class Exported(NamedTuple):
    """A robot as MJCF.

    - ``text``: the file.
    - ``notes``: a sentence for each thing that MuJoCo does in another way.
    - ``signals``: the control of each actuator over time, in the order of MuJoCo's ``ctrl``.
    """

    text: str
    notes: tuple[str, ...]
    signals: tuple[Control, ...]

    @property
    def controls(self) -> tuple[str, ...]:
        """The names of the actuators, in the order of MuJoCo's ``ctrl``."""
        return tuple(control.actuator for control in self.signals)

    def controls_at(self, times: Float[np.ndarray, " T"]) -> Float[np.ndarray, "T controls"]:
        """Computes the controls at some times, with which the actuators exert what the drives of the scenario do."""
        return control_values(self.signals, np.asarray(times, dtype=float))


def to_mjcf(
    robot: Scenario | AbstractSystem | Trajectory,
    *,
    timestep: float = TIMESTEP,
    any_units: bool = False,
    extent: float | None = None,
) -> Exported:
    """Writes a robot with a ball or a disk as MJCF, with the same equations of motion in free flight.

    A link of a mechanism is a body, and each mass a body fixed in it. Hinges and sliders are those of MuJoCo, a
    carriage on a circle is the hinge about its axis and one in a tube a slider. A prescribed joint or mass has a servo,
    as stiff as ``timestep`` allows. The keyframe ``start`` has the initial state; the save times, and controls that
    vary over them, are numbers of which MuJoCo takes no heed and which :func:`read_mjcf` reads. Contact is left to
    MuJoCo, where a body always slips a little.

    **Arguments:**

    - ``robot``: a :class:`~jaxball.Scenario` of a :class:`~jaxball.Ball` or a :class:`~jaxball.Disk`; a run, whose
      start and times are written; or a ball or a disk itself, in its default state, with times from 0 to 10.
    - ``timestep``: of MuJoCo, in the units of the scenario.
    - ``any_units``: whether to write the numbers as they are, if the scenario states units that are not those of SI. A
      file of MuJoCo does not say its units, and other programs take them for SI. Dimensionless numbers are always
      written as they are.
    - ``extent``: half the side of the square around the start on which a ground that is a height over x and y is
      written, as a height field of flat triangles, length; 10 radii of the body if not given.

    **Raises:** :class:`MJCFError` for what MJCF cannot express: laws, forces that are functions, curved rails of free
    joints, external forces, viscous resistance, a ground that moves, and one that is neither a plane nor a height nor
    the outside of a sphere; for other units than those of SI, and an ``extent`` beyond the end of the ground.

    **Example:**

    >>> from jaxball import load_scenario
    >>> from jaxball.files.mjcf import to_mjcf
    >>> exported = to_mjcf(load_scenario("pendulum"))
    >>> exported.text.splitlines()[2]
    '  <option timestep="0.002" gravity="0 0 -1" integrator="implicitfast" cone="elliptic" impratio="100" />'
    """
    scenario = _scenario_of(robot)
    system = scenario.system
    if not isinstance(system, System) or system.shape is not None:
        raise MJCFError(
            f"Key `kind` must be a ball or a disk to be written as MJCF, but the system is {a(type(system).__name__)}."
        )
    require_flags(any_units=any_units)
    _check(scenario, system, any_units)
    _check_ground(system, scenario.times)
    root = ET.Element("mujoco", model=scenario.title or system.title)
    add(root, "compiler", angle="radian", autolimits="true")
    up = np.array([0.0, 0.0, 1.0]) if system.ground is None else np.asarray(system.ground.up())
    gravity = -float(system.gravity) * up
    # A round cone is Coulomb's law; contacts 100 times as hard along the plane as across it creep less; and dampers
    # of stiff servos are implicit.
    style = {"integrator": "implicitfast", "cone": "elliptic", "impratio": "100"}
    add(root, "option", timestep=timestep, gravity=gravity, **style)
    world, actuators, sensors = (ET.Element(tag) for tag in ("worldbody", "actuator", "sensor"))
    links = Links(actuators, timestep, SHOWN_RADIUS * float(system.radius))
    friction = _friction(system, scenario.friction_or(STICKING))
    t = to_array(float(scenario.times[0]))
    state = _release(system, t, scenario.state)
    centre = centre_at_start(system, t, state.body.z, state.height)
    notes = write_ground(root, world, system, (t, centre), friction, extent)
    shell = _add_shell(world, system, friction)
    write_links(system, shell, links)
    write_sensors(scenario.sensors, shell, sensors, links.shifts)
    # After the assets, which `write_ground` adds.
    root.append(world)
    root.extend(element for element in (actuators, sensors) if len(element))
    _add_keyframe(root, system, t, state, centre, links)
    write_recordings(root, scenario.times, links.controls)
    ET.indent(root)
    text = ET.tostring(root, encoding="unicode") + "\n"
    return Exported(text, (*_notes(scenario, links), *notes), tuple(links.controls))


def _scenario_of(robot: Scenario | AbstractSystem | Trajectory) -> Scenario:
    """Returns the scenario of a robot that is to be written."""
    must = "a ball, a disk, a run of one, or a Scenario, such as load_scenario returns"
    require("robot", robot, (Scenario, AbstractSystem, Trajectory), must)
    if isinstance(robot, Scenario):
        return robot
    if isinstance(robot, Trajectory):
        require_one_run(robot.status, "`to_mjcf`", "write its runs one by one")
        contact = None if robot.contact is None else robot.contact.law
        scenario = Scenario(robot.system.title, robot.system, robot.start, np.asarray(robot.times), contact=contact)
        return scenario if robot.scenario is None else robot.scenario
    return Scenario(robot.title, robot, robot.default_state(), TIMES)


def _check(scenario: Scenario, system: System, any_units: bool) -> None:
    """Raises a :class:`MJCFError` for what acts on a body and has no counterpart in MJCF, for friction that depends on
    the slip speed or on the spin, and for stated units that other programs would not read the file in.
    """
    no_states = "which has no states that are functions of a user's own"
    _refuse(system.force is not None, "force", "left out", "which has no forces that are given in time")
    _refuse(system.own_states is not None, "own_states", "left out", no_states)
    resistance = system.resistance
    if resistance is not None:
        what = f"but it is a {type(resistance).__name__}"
        _refuse(not isinstance(resistance, Resistance), "resistance", "coefficients of jaxball's own", what)
    if isinstance(resistance, Resistance):
        why = "because it has no counterpart in what is read back"
        _refuse(resistance.dry_spinning is not None, "resistance.dry_spinning", "left out", why)
        why = "whose friction against rolling is the same at rest and at every rate"
        _refuse(resistance.static_dry is not None, "resistance.static_dry", "left out", why)
        for name in ("rolling", "spinning", "drag", "rotational_drag"):
            value = float(getattr(resistance, name))
            why = f"whose resistance to rolling is dry, but it is {value:g}; leave it out, or give `resistance.dry`"
            _refuse(value != 0, f"resistance.{name}", "0", why)
    law, units = None if scenario.contact is None else scenario.contact.friction_law, scenario.units
    why = (
        "where friction depends neither on the slip speed nor on the spin, but it is a "
        f"{type(law).__name__}; give its coefficient"
    )
    _refuse(law is not None, "contact.friction", "a number", why)
    why = (
        f"which does not say its units, but it is {units}; convert the numbers, or write them as they are with "
        "any_units=True, or --any-units"
    )
    as_read = any_units or units is None or units.is_dimensionless or units.is_si
    _refuse(not as_read, "units", "m, kg, s", why)


def _notes(scenario: Scenario, links: Links) -> tuple[str, ...]:
    system: Any = scenario.system
    notes = []
    if not scenario.may_slip:
        notes.append(
            "The body always rolls here; in MuJoCo it rolls as far as friction with the coefficient "
            f"{STICKING:g} holds it, and creeps."
        )
    else:
        notes.append(
            "MuJoCo has one coefficient of friction, for which the kinetic one is written, and no coefficient of "
            "restitution: its contacts are springs with dampers."
        )
    if any(schedule is not None for schedule in links.schedules.values()):
        notes.append("Prescribed motions are kept by servos, with the controls of `controls_at`, or of --controls.")
    if any(_has(mechanism, JointFriction) for mechanism in system.mechanisms):
        notes.append("Joints with dry friction stick here; in MuJoCo, where it is a soft constraint, they creep.")
    if any(_has(mechanism, EndStops) for mechanism in system.mechanisms):
        notes.append(f"End stops are the ranges of joints: {LIMITS}.")
    left_out = {"feedback": scenario.feedback, "estimator": scenario.estimator, "events": scenario.events}
    left_out |= {f"sensors.{name}.errors": sensor.errors for name, sensor in scenario.sensors.items()}
    if any(left_out.values()):
        keys = all_of([f"`{key}`" for key, value in left_out.items() if value])
        notes.append(f"Not written, because MJCF has nothing like it: {keys}.")
    return tuple(notes)


def _has(mechanism: AbstractMechanism, kind: type[AbstractJointForce]) -> bool:
    forces = [drive.terms if isinstance(drive, JointForces) else (drive,) for drive in mechanism.drives]
    return any(isinstance(force, kind) for terms in forces for force in terms)


def _friction(system: System, sliding: float) -> dict[str, Any]:
    """Returns the friction of both surfaces: sliding, and rolling where there is dry resistance to it."""
    resistance = system.resistance
    if not isinstance(resistance, Resistance) or resistance.dry is None:
        return {"condim": "3", "friction": (sliding, 0.0, 0.0)}
    # Only contacts of 6 dimensions have friction against rolling; its coefficient is a length.
    return {"condim": "6", "friction": (sliding, 0.0, float(resistance.dry) * float(system.radius))}


def _add_shell(world: ET.Element, system: System, friction: dict[str, Any]) -> ET.Element:
    r = float(system.radius)
    shell = add(world, "body", name="shell", pos=(0.0, 0.0, r))
    if system.planar:
        for name, attributes in ROOT.items():
            add(shell, "joint", name=name, **attributes)
        inertia = (float(system.inertia),) * 3
    else:
        add(shell, "freejoint", name="shell")
        inertia = system.inertia
    add(shell, "inertial", pos=system.offset, mass=system.mass, diaginertia=inertia)
    add(shell, "geom", name="shell", type="sphere", size=r, rgba="0.4 0.6 0.8 0.3", **friction)
    return shell


def _release(system: System, t: Any, state: AbstractState | ReleasedState) -> Any:
    """Converts the initial state to the state of a body that need not roll."""
    if isinstance(state, ReleasedState):
        return state
    if not isinstance(state, BallState | RotationState | DiskState):
        raise MJCFError(
            "The initial state must have a position to be written as MJCF, but it is a "
            f"{type(state).__name__}; use a BallState."
        )
    return release(system, t, state)


def _add_keyframe(
    root: ET.Element, system: System, t: Any, state: Any, centre: Float[np.ndarray, "3"], links: Links
) -> None:
    body, V = state.body, np.asarray(state.V)
    qpos, qvel = [], []
    # The turntable is written before the shell, and MuJoCo orders coordinates as the file has joints.
    if isinstance(system.ground, Ground) and system.ground.turntable is not None:
        angle, rate, _ = system.ground.turntable.turning.derivatives(t)
        qpos, qvel = [float(angle)], [float(rate)]
    if isinstance(body, DiskState):
        qpos += [centre[0], centre[2] - float(system.radius), float(body.phi)]
        qvel += [V[0], V[2], float(body.phidot)]
    else:
        placed = body.in_space()
        qpos += [*centre, *np.asarray(placed.q)]
        qvel += [*V, *np.asarray(placed.Omega)]
    angles, rates = _of_joints(root, system, t, body, links)
    ctrl = control_values(links.controls, np.asarray([float(t)]))[0] if links.controls else None
    places, velocities = (*qpos, *angles), (*qvel, *rates)
    add(ET.SubElement(root, "keyframe"), "key", name="start", time=float(t), qpos=places, qvel=velocities, ctrl=ctrl)


def _of_joints(
    root: ET.Element, system: System, t: Any, body: BallState | RotationState | DiskState, links: Links
) -> tuple[list[float], list[float]]:
    """Returns θ and θ̇ of the joints in the order of the file, in which MuJoCo has them."""
    of_state = zip(np.asarray(body.theta), np.asarray(body.thetadot), strict=True)
    joint_states = dict(zip(system.coordinates, of_state, strict=True))
    pairs = []
    for joint in root.iter("joint"):
        name = joint.get("name", "")
        if name not in links.schedules:  # those of the disk itself, and of a turntable
            continue
        schedule = links.schedules[name]
        pairs.append(joint_states[name] if schedule is None else tuple(map(float, schedule.derivatives(t)[:2])))
    return [float(theta) for theta, _ in pairs], [float(rate) for _, rate in pairs]
