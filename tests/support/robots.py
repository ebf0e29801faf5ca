"""Robots as plain numbers: what two independent versions of the mechanics need, and nothing of jaxball.

A robot is a shell that rolls, masses that are fixed in it, and chains of hinges and sliders that carry point masses.
Axes, points and places are stated in body axes with the origin at the geometric centre, where every joint is at zero.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

WORST_CONDITION = 100.0  # of a chain's inertia, in what is drawn: digits lost to it stay below two


@dataclass(frozen=True, eq=False)
class Joint:
    """A hinge about an axis through a point, or a slider along an axis, whose point does not matter.

    A free joint moves under a generalised force; the acceleration of any other is given.
    """

    kind: str  # "hinge" or "slider"
    axis: np.ndarray  # (3,), of length 1
    point: np.ndarray  # (3,)
    free: bool


@dataclass(frozen=True, eq=False)
class Carried:
    """A point mass, moved by the first ``link`` joints of its chain."""

    mass: float
    place: np.ndarray  # (3,), with all joints at zero
    link: int


@dataclass(frozen=True, eq=False)
class Chain:
    """Joints from the shell outwards, each carried by those before it, and the masses on their links."""

    joints: tuple[Joint, ...]
    masses: tuple[Carried, ...]


@dataclass(frozen=True, eq=False)
class Robot:
    """A ball-shaped shell with what is inside."""

    mass: float  # of the shell
    inertia: np.ndarray  # (3,): the shell's principal moments about its own centre of mass, along the body axes
    radius: float
    offset: np.ndarray  # (3,): the shell's centre of mass
    chains: tuple[Chain, ...] = ()
    still: tuple[tuple[float, np.ndarray], ...] = ()  # masses fixed in the shell, with their positions


@dataclass(frozen=True, eq=False)
class Setting:
    """The plane and its motion, what pulls and what resists; without arguments a level plane at rest, g = 1.

    Space axes move with the plane, and never turn; the third is its normal.
    """

    g_space: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    X2: np.ndarray = field(default_factory=lambda: np.zeros(3))  # acceleration of the space axes
    W: float = 0.0  # rate of the turntable
    Wdot: float = 0.0
    centre: np.ndarray = field(default_factory=lambda: np.zeros(2))  # of the turntable
    Fe: np.ndarray = field(default_factory=lambda: np.zeros(3))  # force at the geometric centre, in space
    Te: np.ndarray = field(default_factory=lambda: np.zeros(3))  # torque that acts with it
    c_r: float = 0.0  # viscous rolling
    c_s: float = 0.0  # viscous spinning on the plane
    c_v: float = 0.0  # drag of a medium that is at rest in the space axes
    c_w: float = 0.0  # its torque
    mu_r: float = 0.0  # dry rolling
    epsilon: float = 0.1  # angular velocity below which dry rolling is smoothed


@dataclass(frozen=True, eq=False)
class Moment:
    """The state at one time, and what is given of each joint: a free one's force, another's acceleration."""

    q: np.ndarray  # (4,): the versor from body to space, scalar first
    Omega: np.ndarray  # (3,): angular velocity, in body axes
    z: np.ndarray  # (2,): where the geometric centre is
    theta: tuple[np.ndarray, ...] = ()  # one array for each chain, as are the next two
    thetadot: tuple[np.ndarray, ...] = ()
    given: tuple[np.ndarray, ...] = ()
    V: np.ndarray | None = (
        None  # (3,): velocity of the geometric centre relative to the space axes, if it does not roll
    )


@dataclass(frozen=True, eq=False)
class Answer:
    """Accelerations and forces at one time."""

    Omegadot: np.ndarray  # (3,), in body axes
    zddot: np.ndarray  # (2,), relative to the space axes
    R: np.ndarray  # (3,): force of the plane on the ball, in space
    thetaddot: tuple[np.ndarray, ...]  # of all joints, one array for each chain
    efforts: tuple[np.ndarray, ...]  # generalised forces in all joints, one array for each chain
    rise: float = 0.0  # acceleration of the geometric centre away from the plane


@dataclass(frozen=True, eq=False)
class Slides:
    """Contact with friction of μ times the normal force, against the slip or a given direction; it does not roll."""

    mu: float
    direction: np.ndarray | None = None  # (2,), of length 1


@dataclass(frozen=True, eq=False)
class Pushed:
    """Contact with a given force of the plane, in space; without contact, the plane does not resist turning either."""

    R: np.ndarray
    touching: bool = True


def rotation(moment):
    """The matrix from body to space."""
    return Rotation.from_quat(np.roll(moment.q, -1)).as_matrix()


def centre_velocity(robot, setting, moment):
    """The velocity of the geometric centre that the plane gives it when it rolls, relative to the space axes."""
    omega = rotation(moment) @ moment.Omega
    e3, arm = np.array([0.0, 0.0, 1.0]), np.append(moment.z - setting.centre, 0.0)
    return robot.radius * np.cross(omega, e3) + setting.W * np.cross(e3, arm)


def place(chain, mass, theta):
    """Where a carried mass is, in body axes, for real and complex angles."""
    x = mass.place
    for joint, angle in reversed(list(zip(chain.joints[: mass.link], theta, strict=False))):
        w = joint.axis
        if joint.kind == "slider":
            x = x + angle * w
        else:
            arm = x - joint.point
            along = (w @ arm) * w
            x = joint.point + along + np.cos(angle) * (arm - along) + np.sin(angle) * np.cross(w, arm)
    return x


def momentum(robot, moment):
    """Σ m v relative to the space axes, where V is that of the geometric centre; rates by complex steps."""
    step = 1e-30
    still = [(mass, x, np.zeros(3)) for mass, x in ((robot.mass, robot.offset), *robot.still)]
    moving = []
    for chain, theta, thetadot in zip(robot.chains, moment.theta, moment.thetadot, strict=True):
        places = ((mass.mass, place(chain, mass, theta + step * 1j * thetadot)) for mass in chain.masses)
        moving += [(m, np.real(x), np.imag(x) / step) for m, x in places]
    turn = rotation(moment)
    return sum(m * (moment.V + turn @ (np.cross(moment.Omega, x) + v)) for m, x, v in (*still, *moving))


def joint_inertia(chain, theta):
    """The chain's kinetic energy in a shell at rest is half of this matrix between its joint velocities."""
    k, step = len(chain.joints), 1e-30
    inertia = np.zeros((k, k))
    for mass in chain.masses:
        slopes = np.array([place(chain, mass, theta + step * 1j * row).imag / step for row in np.eye(k)])
        inertia += mass.mass * slopes @ slopes.T
    return inertia


def _well_conditioned(chain, theta):
    return np.linalg.cond(joint_inertia(chain, theta)) < WORST_CONDITION


def _random_chain(rng, free):
    """Up to three joints and up to three masses, the first of them on the last link."""
    while True:
        k = int(rng.integers(1, 4))
        joints = []
        for _ in range(k):
            axis = rng.normal(size=3)
            kind, moves = str(rng.choice(["hinge", "slider"])), bool(rng.random() < 0.6)
            joints.append(
                Joint(kind, axis / np.linalg.norm(axis), 0.4 * rng.normal(size=3), moves if free is None else free)
            )
        links = [k, *rng.integers(1, k + 1, size=rng.integers(0, 3))]
        masses = [Carried(rng.uniform(0.3, 1.5), 0.6 * rng.normal(size=3), int(link)) for link in links]
        chain = Chain(tuple(joints), tuple(masses))
        if _well_conditioned(chain, np.zeros(k)):
            return chain


def random_robot(rng, chains=None, free=None, still=None):
    """An unbalanced robot with one to three chains and up to two fixed masses, or as many as given.

    Joints are all free, all given or, without ``free``, some of each. Lengths, masses and moments are about 1.
    """
    chains = rng.integers(1, 4) if chains is None else chains
    still = rng.integers(0, 3) if still is None else still
    return Robot(
        mass=rng.uniform(1.0, 3.0),
        inertia=rng.uniform(0.2, 1.0, size=3) @ (1 - np.eye(3)),  # no moment exceeds the sum of the others
        radius=rng.uniform(0.7, 1.5),
        offset=0.2 * rng.normal(size=3),
        chains=tuple(_random_chain(rng, free) for _ in range(chains)),
        still=tuple((rng.uniform(0.3, 1.5), 0.5 * rng.normal(size=3)) for _ in range(still)),
    )


def random_setting(rng):
    """Everything switched on: a tilted plane that accelerates and turns, a force, and all resistances."""
    return Setting(
        g_space=np.array([0.0, 0.0, -2.0]) + 0.5 * rng.normal(size=3),
        X2=0.5 * rng.normal(size=3),
        W=rng.normal(),
        Wdot=rng.normal(),
        centre=rng.normal(size=2),
        Fe=rng.normal(size=3),
        c_r=rng.uniform(0.1, 0.5),
        c_s=rng.uniform(0.1, 0.5),
        c_v=rng.uniform(0.1, 0.5),
        c_w=rng.uniform(0.1, 0.5),
        mu_r=rng.uniform(0.05, 0.3),
        epsilon=rng.uniform(0.05, 0.5),
    )


def _random_angles(rng, chain):
    for _ in range(10_000):
        theta = rng.normal(size=len(chain.joints))
        if _well_conditioned(chain, theta):
            return theta
    raise ValueError("the chain's inertia is nearly singular at every angle that was drawn")


def random_moment(rng, robot):
    """Any attitude and velocities of about 1, away from angles at which a chain's inertia is nearly singular."""
    q = rng.normal(size=4)
    sizes = [len(chain.joints) for chain in robot.chains]
    return Moment(
        q=q / np.linalg.norm(q),
        Omega=rng.normal(size=3),
        z=rng.normal(size=2),
        theta=tuple(_random_angles(rng, chain) for chain in robot.chains),
        thetadot=tuple(rng.normal(size=k) for k in sizes),
        given=tuple(rng.normal(size=k) for k in sizes),
    )
