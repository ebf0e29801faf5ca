"""Newton's and Euler's laws for a robot that rolls, slides or flies, link by link in space axes, in NumPy.

The unknowns are Ω̇, θ̈ of the free joints, the contact force R, the efforts in all joints and, where it does not roll,
the acceleration of the geometric centre. An acceleration is
affine in them, and is kept as a matrix with a column for each unknown and a last one for what is known. The chains are
followed outwards for positions, velocities and accelerations; each joint is cut for the forces on what lies beyond it.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from tests.support.robots import Answer, Pushed, Slides, centre_velocity, rotation

E3 = np.array([0.0, 0.0, 1.0])


def _cross(a):
    """The matrix of a ×."""
    return np.cross(a, np.eye(3)).T


class _Unknowns:
    """Columns of the unknowns; with the last one, 1, they are a vector that affine quantities multiply."""

    def __init__(self, robot, rolls):
        joints = [joint for chain in robot.chains for joint in chain.joints]
        self.free = sum(joint.free for joint in joints)
        self.joints = len(joints)
        self.centre = 6 + self.free + self.joints
        self.count = self.centre + (0 if rolls else 3)

    def known(self, value):
        value = np.atleast_1d(value)
        return np.concatenate([np.zeros((len(value), self.count)), value[:, None]], axis=1)

    def at(self, first, length=1):
        return np.eye(self.count + 1)[first : first + length]


class _Frame:
    """A rigid link: attitude, a point that is fixed in it, and how both move. Accelerations are affine."""

    def __init__(self, turn, o, v, a, omega, alpha):
        self.turn, self.o, self.v, self.a, self.omega, self.alpha = turn, o, v, a, omega, alpha

    def carry(self, x):
        """Velocity and acceleration of the link's point that is at x."""
        arm = x - self.o
        sweep = np.cross(self.omega, arm)
        a = self.a - _cross(arm) @ self.alpha
        a[:, -1] += np.cross(self.omega, sweep)
        return self.v + sweep, a

    def at(self, place):
        """Where a place of the link is, stated with all joints at zero."""
        return self.o + self.turn @ place


def _hinged(frame, joint, angle, rate, acceleration):
    """The link beyond a hinge, and the hinge's axis and point: the pivot belongs to both links."""
    e, pivot = frame.turn @ joint.axis, frame.at(joint.point)
    v, a = frame.carry(pivot)
    omega = frame.omega + rate * e
    alpha = frame.alpha + np.outer(e, acceleration)
    alpha[:, -1] += np.cross(frame.omega, rate * e)
    turn = Rotation.from_rotvec(angle * e).as_matrix() @ frame.turn
    beyond = _Frame(turn, pivot, v, a, omega, alpha)
    o = pivot - turn @ joint.point
    return _Frame(turn, o, *beyond.carry(o), omega, alpha), e, pivot


def _slid(frame, joint, angle, rate, acceleration):
    """The link beyond a slider, and the slider's axis and a point of it."""
    e = frame.turn @ joint.axis
    o = frame.o + angle * e
    v, a = frame.carry(o)
    a = a + np.outer(e, acceleration)
    a[:, -1] += 2 * rate * np.cross(frame.omega, e)
    return _Frame(frame.turn, o, v + rate * e, a, frame.omega, frame.alpha), e, o


BEYOND = {"hinge": _hinged, "slider": _slid}


def _shell(robot, setting, moment, unknowns, rolls):
    """The frame of the shell at its geometric centre, and the acceleration of this relative to the axes."""
    turn = Rotation.from_quat(np.roll(moment.q, -1)).as_matrix()
    omega, alpha = turn @ moment.Omega, turn @ unknowns.at(0, 3)
    v = centre_velocity(robot, setting, moment) if rolls else moment.V
    if rolls:
        a = -robot.radius * _cross(E3) @ alpha
        arm = np.append(moment.z - setting.centre, 0.0)
        a[:, -1] += setting.Wdot * np.cross(E3, arm) + setting.W * np.cross(E3, v)
    else:
        a = unknowns.at(unknowns.centre, 3)
    relative = a.copy()
    a[:, -1] += setting.X2
    return _Frame(turn, np.append(moment.z, 0.0), v, a, omega, alpha), relative


def _contact(robot, setting, moment, contact, unknowns, R, relative):
    """Rows that say what the plane's force is where the robot does not roll."""
    if isinstance(contact, Pushed):
        return list(R - unknowns.known(contact.R))
    if isinstance(contact, Slides):
        direction = contact.direction
        if direction is None:
            slip = (moment.V - centre_velocity(robot, setting, moment))[:2]
            direction = slip / np.linalg.norm(slip)
        return [*(R[:2] + contact.mu * np.outer(direction, R[2])), relative[2]]
    return []


def _forces_on(robot, setting, moment, unknowns, shell):
    """Position, and force that its motion takes besides gravity, of each particle; rows that say what joints obey."""
    needed, rows = [], []

    def particle(frame, mass, place):
        x = frame.at(place)
        return x, mass * (frame.carry(x)[1] - unknowns.known(setting.g_space))

    for mass, place in ((robot.mass, robot.offset), *robot.still):
        needed.append(particle(shell, mass, place))
    first_free, first_effort = 3, 6 + unknowns.free
    for chain, theta, thetadot, given in zip(robot.chains, moment.theta, moment.thetadot, moment.given, strict=True):
        frames, cuts = [shell], []
        for joint, *motion, value in zip(chain.joints, theta, thetadot, given, strict=True):
            effort = unknowns.at(first_effort)[0]
            first_effort += 1
            if joint.free:
                acceleration = unknowns.at(first_free)[0]
                first_free += 1
                rows.append(effort - unknowns.known(value)[0])
            else:
                acceleration = unknowns.known(value)[0]
            frame, axis, point = BEYOND[joint.kind](frames[-1], joint, *motion, acceleration)
            frames.append(frame)
            cuts.append((joint.kind, axis, point, effort))
        carried = [(mass.link, *particle(frames[mass.link], mass.mass, mass.place)) for mass in chain.masses]
        for a, (kind, axis, point, effort) in enumerate(cuts):
            outboard = [(x, f) for link, x, f in carried if link > a]
            if kind == "hinge":
                outboard = [(x, _cross(x - point) @ f) for x, f in outboard]
            rows.append(effort - axis @ sum((f for _, f in outboard), unknowns.known(np.zeros(3))))
        needed += [(x, f) for _, x, f in carried]
    return needed, rows


def solve(robot, setting, moment, contact=None):
    """The accelerations and forces of a robot at one moment; it rolls if no other contact is given."""
    unknowns = _Unknowns(robot, rolls=contact is None)
    shell, relative = _shell(robot, setting, moment, unknowns, rolls=contact is None)
    needed, rows = _forces_on(robot, setting, moment, unknowns, shell)
    omega, R = shell.omega, unknowns.at(3 + unknowns.free, 3)
    rows += _contact(robot, setting, moment, contact, unknowns, R, relative)
    touching = not isinstance(contact, Pushed) or contact.touching

    drag = unknowns.known(setting.Fe - setting.c_v * shell.v)
    rows += list(sum(f for _, f in needed) - R - drag)

    level = omega * (1 - E3)
    viscous = -setting.c_r * level - setting.c_s * (omega[2] - setting.W) * E3
    dry = setting.mu_r * robot.radius * level / np.hypot(np.linalg.norm(level), setting.epsilon)
    torque = unknowns.known(touching * viscous - setting.c_w * omega + setting.Te)
    torque = torque - np.outer(touching * dry, R[2]) - robot.radius * _cross(E3) @ R
    inertia = shell.turn @ np.diag(robot.inertia) @ shell.turn.T
    spin = inertia @ shell.alpha + unknowns.known(np.cross(omega, inertia @ omega))
    rows += list(spin + sum(_cross(x - shell.o) @ f for x, f in needed) - torque)

    matrix = np.array(rows)
    found = np.linalg.solve(matrix[:, :-1], -matrix[:, -1])
    found = np.append(found, 1.0)
    found[:-1] -= np.linalg.solve(matrix[:, :-1], matrix @ found)
    return _answer(robot, moment, found, unknowns, relative)


def carried(robot, setting, moment, answer, chain, link, place):
    """Acceleration in space, angular velocity and rotation of what is on a link, 0 for the shell, with an answer."""
    turn, rolling = rotation(moment), moment.V is None
    a = np.append(answer.zddot, answer.rise) + setting.X2
    V = centre_velocity(robot, setting, moment) if rolling else moment.V
    alpha = turn @ answer.Omegadot
    frame = _Frame(turn, np.append(moment.z, 0.0), V, a[:, None], turn @ moment.Omega, alpha[:, None])
    rates = moment.theta[chain], moment.thetadot[chain], answer.thetaddot[chain]
    for joint, *motion, acceleration in zip(robot.chains[chain].joints[:link], *(x[:link] for x in rates), strict=True):
        frame, *_ = BEYOND[joint.kind](frame, joint, *motion, np.array([acceleration]))
    return frame.carry(frame.at(place))[1][:, 0], frame.omega, frame.turn


def _answer(robot, moment, found, unknowns, relative):
    moving, efforts = list(found[3 : 3 + unknowns.free]), list(found[6 + unknowns.free : unknowns.centre])
    thetaddot = tuple(
        np.array([moving.pop(0) if joint.free else value for joint, value in zip(chain.joints, given, strict=True)])
        for chain, given in zip(robot.chains, moment.given, strict=True)
    )
    cut = tuple(np.array([efforts.pop(0) for _ in chain.joints]) for chain in robot.chains)
    first, acceleration = 3 + unknowns.free, relative @ found
    return Answer(found[:3], acceleration[:2], found[first : first + 3], thetaddot, cut, acceleration[2])
