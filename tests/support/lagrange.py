"""Lagrange's equations with multipliers for a robot that rolls, from its energies and constraints alone.

The coordinates are y = (q, x, θ): the four components of the versor, the position x of the geometric centre relative to
the moving axes, and all joint coordinates. JAX differentiates the energies and the constraints; nothing is derived by
hand. It needs float64.

The axes move by X(t) = ½ Ẍ t², seen at t = 0. A velocity Ẋ that stays would change nothing: forces depend on
velocities relative to the axes, and a constant velocity of all bodies adds to their Lagrangian nothing but the
derivative of a function of y and t. So Ẍ is all there is to know.
"""

import jax
import jax.numpy as jnp
import numpy as np

from tests.support.robots import Answer, centre_velocity

E3 = np.array([0.0, 0.0, 1.0])


def _product(a, b):
    """The quaternion product."""
    vector = a[0] * b[1:] + b[0] * a[1:] + jnp.cross(a[1:], b[1:])
    return jnp.concatenate([(a[0] * b[0] - a[1:] @ b[1:])[None], vector])


def _conjugate(q):
    return jnp.concatenate([q[:1], -q[1:]])


def _rotated(q, x):
    return _product(_product(q, jnp.concatenate([jnp.zeros(1), x])), _conjugate(q))[1:]


def _body_rate(q, qdot):
    return 2 * _product(_conjugate(q), qdot)[1:]


def _space_rate(q, qdot):
    return 2 * _product(qdot, _conjugate(q))[1:]


def _arrays(robot, setting):
    """The numbers in arrays, with room for three joints on each of three chains, so that robots share a program.

    The shell's mass and the fixed masses are particles that no joint moves. Joints that are not there move no particle,
    and have the acceleration 0.
    """
    P = max(3, len(robot.chains))
    K = max([3, *(len(chain.joints) for chain in robot.chains)])
    hinge, free = np.zeros((P, K), dtype=bool), np.zeros((P, K), dtype=bool)
    axis, point = np.tile(np.array([1.0, 0.0, 0.0]), (P, K, 1)), np.zeros((P, K, 3))
    particles = [(mass, where, 0, 0) for mass, where in ((robot.mass, robot.offset), *robot.still)]
    for c, chain in enumerate(robot.chains):
        for a, joint in enumerate(chain.joints):
            if joint.kind not in ("hinge", "slider"):
                raise ValueError(f"a joint is a hinge or a slider, not {joint.kind!r}")
            hinge[c, a], free[c, a] = joint.kind == "hinge", joint.free
            axis[c, a], point[c, a] = joint.axis, joint.point
        particles += [(carried.mass, carried.place, c, carried.link) for carried in chain.masses]
    particles += [(0.0, np.zeros(3), 0, 0)] * (-len(particles) % 12)
    mass, where, chain_of, link = (np.array(column) for column in zip(*particles, strict=True))
    body = {"mass": mass, "place": where, "chain": chain_of, "link": link}
    body |= {"hinge": hinge, "free": free, "axis": axis, "point": point}
    body |= {"inertia": np.asarray(robot.inertia, dtype=float), "radius": np.float64(robot.radius)}
    return body, {name: np.asarray(value, dtype=float) for name, value in vars(setting).items()}


def _padded(body, values):
    out = np.zeros(body["free"].shape)
    for row, chain in zip(out, values, strict=False):
        row[: len(chain)] = chain
    return out


def _carried(place, link, theta, hinge, axis, point):
    """A place in body axes after the joints that move it, the outermost first."""
    x = place
    for a in reversed(range(len(axis))):
        w, arm = axis[a], x - point[a]
        c, s = jnp.cos(theta[a]), jnp.sin(theta[a])
        turned = point[a] + c * arm + s * jnp.cross(w, arm) + (1 - c) * (w @ arm) * w
        x = jnp.where(a < link, jnp.where(hinge[a], turned, x + theta[a] * w), x)
    return x


def _positions(y, t, body, setting):
    """Of all particles, in space at rest."""
    q, x, theta = y[:4], y[4:7], y[7:].reshape(body["free"].shape)
    origin = 0.5 * t**2 * setting["X2"]

    def position(place, chain, link):
        joints = (value[chain] for value in (theta, body["hinge"], body["axis"], body["point"]))
        return origin + x + _rotated(q, _carried(place, link, *joints))

    return jax.vmap(position)(body["place"], body["chain"], body["link"])


def _energies(y, ydot, t, body, setting):
    """Kinetic and potential energy."""
    x, v = jax.jvp(lambda y, t: _positions(y, t, body, setting), (y, t), (ydot, jnp.ones_like(t)))
    Omega = _body_rate(y[:4], ydot[:4])
    kinetic = 0.5 * (body["mass"] @ jnp.sum(v * v, axis=1)) + 0.5 * (body["inertia"] @ (Omega * Omega))
    return kinetic, -(body["mass"] @ (x @ setting["g_space"]))


def _lagrangian(y, ydot, t, body, setting):
    kinetic, potential = _energies(y, ydot, t, body, setting)
    return kinetic - potential


def _surface_velocity(x, t, setting):
    arm = x - jnp.concatenate([setting["centre"], x[2:]])
    return (setting["W"] + setting["Wdot"] * t) * jnp.cross(E3, arm)


def _constraints(y, ydot, t, body, setting):
    """What is zero: the rate of |q|²/2, and the slip velocity, whose third component is that of the height."""
    q, x, qdot, xdot = y[:4], y[4:7], ydot[:4], ydot[4:7]
    rolling = body["radius"] * jnp.cross(_space_rate(q, qdot), E3)
    return jnp.concatenate([(q @ qdot)[None], xdot - rolling - _surface_velocity(x, t, setting)])


def _coordinates(moment, theta, thetadot):
    """y and ẏ at t = 0."""
    q = moment["q"]
    qdot = 0.5 * _product(q, jnp.concatenate([jnp.zeros(1), moment["Omega"]]))
    x = jnp.concatenate([moment["z"], jnp.zeros(1)])
    return jnp.concatenate([q, x, theta.ravel()]), jnp.concatenate([qdot, moment["V"], thetadot.ravel()])


@jax.jit
def _solution(body, setting, moment, theta, thetadot, given):
    """Ω̇, z̈, R, θ̈ and the efforts in all joints."""
    y, ydot = _coordinates(moment, theta, thetadot)
    t, joints, size = jnp.zeros(()), theta.size, y.size

    def momentum(y, ydot, t):
        return jax.grad(_lagrangian, 1)(y, ydot, t, body, setting)

    def constraints(y, ydot, t):
        return _constraints(y, ydot, t, body, setting)

    now, rates = (y, ydot, t), (ydot, jnp.zeros_like(ydot), jnp.ones_like(t))
    inertia = jax.jacfwd(momentum, 1)(*now)
    bias = jax.jvp(momentum, now, rates)[1] - jax.grad(_lagrangian)(*now, body, setting)
    A = jax.jacfwd(constraints, 1)(*now)
    drift = jax.jvp(constraints, now, rates)[1]

    omega = _space_rate(y[:4], ydot[:4])
    level = omega * jnp.array([1.0, 1.0, 0.0])
    dry = setting["mu_r"] * body["radius"] * level / jnp.sqrt(level @ level + setting["epsilon"] ** 2)
    torque = -setting["c_r"] * level - setting["c_s"] * (omega[2] - setting["W"]) * E3 - setting["c_w"] * omega
    torque = torque + setting["Te"]
    force = setting["Fe"] - setting["c_v"] * ydot[4:7]

    def power(ydot, force, torque):
        return force @ ydot[4:7] + torque @ _space_rate(y[:4], ydot[:4])

    applied = jax.grad(power)(ydot, force, torque)
    per_normal_force = jax.grad(power)(ydot, jnp.zeros(3), -dry)

    # Unknowns: ÿ, the multiplier of |q|, the contact force R, and the effort in each joint, which is its multiplier.
    free = body["free"].ravel()
    reactions = A.T.at[:, 3].add(per_normal_force)
    efforts = jnp.zeros((size, joints)).at[7:].set(jnp.eye(joints))
    of_joints = jnp.diag(jnp.where(free, 0.0, 1.0)), jnp.diag(jnp.where(free, 1.0, 0.0))
    matrix = jnp.block(
        [
            [inertia, -reactions, -efforts],
            [A, jnp.zeros((4, 4 + joints))],
            [jnp.zeros((joints, 7)), of_joints[0], jnp.zeros((joints, 4)), of_joints[1]],
        ]
    )
    right = jnp.concatenate([applied - bias, -drift, given.ravel()])
    found = jnp.linalg.solve(matrix, right)
    found = found + jnp.linalg.solve(matrix, right - matrix @ found)

    yddot = found[:size]
    Omegadot = jax.jvp(_body_rate, (y[:4], ydot[:4]), (ydot[:4], yddot[:4]))[1]
    R, shape = found[size + 1 : size + 4], theta.shape
    return Omegadot, yddot[4:6], R, yddot[7:].reshape(shape), found[size + 4 :].reshape(shape)


@jax.jit
def _energy(body, setting, moment, theta, thetadot):
    y, ydot = _coordinates(moment, theta, thetadot)
    return sum(_energies(y, ydot, jnp.zeros(()), body, setting))


def _arguments(robot, setting, moment):
    body, surroundings = _arrays(robot, setting)
    rigid = {name: np.asarray(getattr(moment, name), dtype=float) for name in ("q", "Omega", "z")}
    rigid["V"] = centre_velocity(robot, setting, moment) if moment.V is None else moment.V
    return body, surroundings, rigid, _padded(body, moment.theta), _padded(body, moment.thetadot)


def solve(robot, setting, moment):
    """The accelerations and forces of a robot at one moment."""
    arguments = _arguments(robot, setting, moment)
    given = _padded(arguments[0], moment.given)
    Omegadot, zddot, R, thetaddot, efforts = map(np.asarray, _solution(*arguments, given))
    sizes = [len(chain.joints) for chain in robot.chains]

    def cut(rows):
        return tuple(row[:k] for row, k in zip(rows, sizes, strict=False))

    return Answer(Omegadot, zddot, R, cut(thetaddot), cut(efforts))


def energy(robot, setting, moment):
    """Kinetic energy of the motion relative to the moving axes, and potential energy of gravity."""
    return float(_energy(*_arguments(robot, setting, moment)))
