"""Robots of plain numbers as balls of jaxball, with their settings and states."""

import jax.numpy as jnp
import numpy as np

import jaxball


def constant_acceleration(t, acceleration):
    """A motion of the ground that starts at rest."""
    return 0.5 * acceleration * t**2


def given(value):
    """The drive of a joint that moves as an oracle says: by a law where its acceleration is given, else by a force."""
    return jaxball.Accelerated() if value is None else jaxball.Motor(value)


def mechanism_of(chain, forces):
    joints = []
    for joint, force in zip(chain.joints, forces, strict=True):
        drive = given(force if joint.free else None)
        if joint.kind == "hinge":
            joints.append(jaxball.Hinge(joint.axis, joint.point, drive=drive))
        else:
            joints.append(jaxball.Slider(joint.axis, drive=drive))
    masses = [jaxball.CarriedMass(item.mass, item.place, item.link - 1) for item in chain.masses if item.link]
    return jaxball.Mechanism(joints, masses)


def follow(t, state, accelerations):
    return accelerations


def ball_of(robot, setting, moment):
    """The oracle's robot as a ball: what is given is accelerated by a law, what is free has a motor."""
    tilt = -setting.g_space / np.linalg.norm(setting.g_space)
    angle, heading = np.arccos(tilt[2]), np.arctan2(-tilt[1], -tilt[0])
    ground = jaxball.Ground(
        angle,
        heading,
        motion=jaxball.Free(constant_acceleration, jnp.asarray(setting.X2)),
        turntable=jaxball.Turntable(
            jaxball.PiecewiseAcceleration(0.0, times=[0.0, 9.0], accelerations=[[setting.Wdot]], rate=setting.W),
            setting.centre,
        ),
    )
    resistance = jaxball.Resistance(
        rolling=setting.c_r,
        spinning=setting.c_s,
        drag=setting.c_v,
        rotational_drag=setting.c_w,
        dry=setting.mu_r,
        smoothing=setting.epsilon,
    )
    still = [*robot.still, *((m.mass, m.place) for chain in robot.chains for m in chain.masses if m.link == 0)]
    pairs = list(zip(robot.chains, moment.given, strict=True))
    driven = [a for chain, values in pairs for joint, a in zip(chain.joints, values, strict=True) if not joint.free]
    return jaxball.Ball(
        mass=robot.mass,
        inertia=robot.inertia,
        radius=robot.radius,
        offset=robot.offset,
        gravity=np.linalg.norm(setting.g_space),
        force=jaxball.physics.HarmonicForce(setting.Fe),
        masses=[jaxball.PointMass(m, jaxball.Fixed(x)) for m, x in still],
        mechanisms=[mechanism_of(chain, values) for chain, values in pairs],
        law=jaxball.FunctionLaw(follow, jnp.asarray(driven)) if driven else None,
        ground=ground,
        resistance=resistance,
    )


def state_of(moment):
    theta, thetadot = np.concatenate(moment.theta), np.concatenate(moment.thetadot)
    return jaxball.BallState(moment.q, moment.Omega, moment.z, theta, thetadot)
