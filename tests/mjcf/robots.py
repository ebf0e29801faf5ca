"""Robots with every part that MJCF can express, and what MuJoCo computes of them."""

import equinox as eqx
import jax.numpy as jnp
import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from jaxball import (
    Ball,
    BallState,
    Carriage,
    CarriedMass,
    Circle,
    ConstantRate,
    Damper,
    Disk,
    DiskState,
    Ellipse,
    Fixed,
    Ground,
    HarmonicSeries,
    Hinge,
    Mechanism,
    Motor,
    OnRail,
    Oscillating,
    PDServo,
    PointMass,
    Pulse,
    Scenario,
    Sinusoids,
    Slider,
    SphericalFrame,
    Spring,
    Tube,
    rigid_body_masses,
)
from jaxball.physics import ReleasedState, SpeedLimitedMotor
from jaxball.physics.contact.released import rates, response, slip_velocity
from jaxball.physics.dynamics.equations import equations
from jaxball.physics.dynamics.load import load
from jaxball.physics.observables import Movement, Slip
from jaxball.physics.sensors import Accelerometer, Encoder, Gyroscope, Position, Tachometer

TIMES = np.array([0.0, 1.0])
SWAY = Sinusoids(0.3, amplitude=[0.4], frequency=[1.7])


def branched():
    """A yoke with a rotor and a slider on its first link, and a pendulum on a rail in the yoke."""
    joints = [
        Hinge((0.2, 1.0, 0.1), point=(0.0, 0.05, 0.1), drive=Motor(0.3) + Spring(0.2, rest=0.4) + Damper(0.05)),
        Hinge((1.0, 0.0, 0.3), point=(0.1, 0.0, -0.2), drive=PDServo(SWAY, stiffness=2.0, damping=0.3, limit=0.5)),
        Slider((0.0, 0.3, 1.0), drive=Spring(3.0) + Damper(0.1), on=0),
        Carriage(Tube((1.0, 1.0, 0.0), centre=(0.0, 0.1, 0.0)), on=-1),
        Hinge((0.0, 1.0, 0.0), point=(0.0, 0.0, -0.1), drive=SpeedLimitedMotor(0.5, stall=0.4, free_speed=6.0)),
    ]
    masses = [
        *rigid_body_masses(0.4, (0.02, 0.03, 0.025), centre=(0.1, 0.0, -0.4), joint=1),
        CarriedMass(0.3, (0.2, 0.1, 0.1), joint=2),
        CarriedMass(0.2, (0.1, 0.0, -0.3), joint=4),
        CarriedMass(0.1, (0.0, 0.2, 0.0), joint=3),
    ]
    return Mechanism(joints, masses)


def on_circle(drive=None):
    frame = SphericalFrame(azimuth=0.4, elevation=0.7)
    return Mechanism([Carriage(Circle(0.6, centre=(0.0, 0.1, 0.0), frame=frame), drive)], [CarriedMass(0.2)])


def free_ball():
    """A ball in which every joint is free."""
    return Ball(
        mass=1.2,
        inertia=(0.4, 0.45, 0.5),
        radius=1.1,
        offset=(0.05, -0.1, 0.02),
        gravity=9.0,
        masses=[PointMass(0.3, Fixed((0.2, -0.4, 0.1)))],
        mechanisms=[branched(), on_circle(Damper(0.02))],
        ground=Ground(angle=0.2, heading=0.7),
    )


def prescribed_ball():
    """A ball with masses and joints that move by schedules, and free ones."""
    path = HarmonicSeries((0.1, 0.2, 0.0), amplitude=[(0.1, 0.0, 0.2)], frequency=[2.0])
    masses = [
        PointMass(0.3, OnRail(Circle(0.8, frame=SphericalFrame(azimuth=1.0, elevation=0.3)), Pulse(0.4))),
        PointMass(0.2, OnRail(Tube((1.0, 0.0, 2.0), centre=(0.0, 0.1, 0.0)), SWAY)),
        PointMass(0.4, OnRail(Ellipse((0.5, 0.7)), ConstantRate(0.2, rate=1.5))),
        PointMass(0.1, Oscillating(path)),
    ]
    arm = Mechanism(
        [Hinge((0.0, 1.0, 0.2), drive=SWAY), Hinge((1.0, 0.0, 0.0), drive=Spring(0.3))],
        [CarriedMass(0.5, (0.1, 0.0, -0.5))],
    )
    return Ball(mass=1.0, inertia=(0.5, 0.4, 0.45), masses=masses, mechanisms=[arm, on_circle(SWAY)])


def simple_ball():
    """A ball with one pendulum on a motor."""
    pendulum = Mechanism([Hinge((0.0, 1.0, 0.2), drive=Motor(0.3))], [CarriedMass(0.5, (0.1, 0.0, -0.5))])
    return Ball(mass=1.0, inertia=(0.5, 0.4, 0.45), offset=(0.05, 0.0, 0.0), mechanisms=[pendulum])


def free_disk():
    pendulum = Mechanism(
        [Hinge((0.0, 1.0, 0.0), point=(0.1, 0.0, 0.1), drive=Spring(0.3)), Slider((1.0, 0.0, 1.0))],
        [CarriedMass(0.4, (0.0, 0.0, -0.4), joint=0), CarriedMass(0.2, (0.2, 0.0, 0.0))],
    )
    return Disk(mass=1.0, inertia=0.5, offset=(0.1, 0.0, 0.05), mechanisms=[pendulum])


def sensors():
    frame = SphericalFrame(azimuth=0.3, elevation=0.4)
    link = "mechanisms[0].joints[4]"
    return {
        "shell": Accelerometer(at=(0.1, 0.2, -0.3), frame=frame),
        "arm": Accelerometer(at=(0.1, 0.0, -0.4), on="mechanisms[0].joints[1]"),
        "carried": Accelerometer(on="mechanisms[0].masses[7]"),
        "gyro": Gyroscope(on=link, frame=frame),
        "seen": Position(at=(0.1, 0.0, 0.2), on=link),
        "angle": Encoder(on=link),
        "rate": Tachometer(on=link),
    }


def scenario(system, state=None):
    state = system.default_state() if state is None else state
    return Scenario("robot", system, state, TIMES)


def random_state(rng, system):
    """A state in flight, at a height at which nothing touches the plane."""
    n = len(system.coordinates)
    theta, thetadot = rng.normal(size=n), rng.normal(size=n)
    V = rng.normal(size=3)
    if isinstance(system, Disk):
        phi, phidot, z = rng.normal(size=3)
        return ReleasedState(DiskState(phi=phi, phidot=phidot, z=z, theta=theta, thetadot=thetadot), V * [1, 0, 1], 5.0)
    q = np.roll(Rotation.random(rng=rng).as_quat(), 1)
    body = BallState(q=q, Omega=rng.normal(size=3), z=rng.normal(size=2), theta=theta, thetadot=thetadot)
    return ReleasedState(body, V, 5.0)


@eqx.filter_jit
def in_flight(system, t, state, sensors):
    """The rates of a state in flight, and what sensors read there."""
    system = system.prepare()
    found, body = response(system, t, state, jnp.asarray(False)), state.body
    amounts = found.amounts(found.free, jnp.asarray(0.0))
    if not sensors:
        return rates(system, state, found, amounts), {}
    slip = slip_velocity(system, t, state)
    Omegadot, thetaddot = (found.part(name, amounts) for name in ("Omegadot", "thetaddot"))
    acting = load(system, t, body, slip, jnp.asarray(False), state.height)
    angles, at = (body.theta, body.thetadot, thetaddot), equations(system, t, body).body_moments
    movement = Movement(body, Omegadot, angles, acting, at, None, jnp.zeros(3), Slip(slip, found.free, state.height))
    read = {name: sensor.reading(system, t, movement) for name, sensor in sensors.items()}
    return rates(system, state, found, amounts), read


def loaded(text):
    """The model of a file, and its data at the first keyframe."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    return model, data


def of_shell(system, state):
    """The accelerations of the shell in the order of MuJoCo, from the rates of a state."""
    if isinstance(system, Disk):
        return np.array([state.V[0], state.V[2], state.body.phidot])
    return np.concatenate([state.V, state.body.Omega])


def rotation(q):
    """The matrix of a quaternion of any norm, with its scalar first."""
    return Rotation.from_quat(np.roll(np.asarray(q), -1)).as_matrix()
