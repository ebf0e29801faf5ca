"""Rolling, sliding, flight and impacts by steps in time with complementarity, in NumPy, after Moreau.

Modes are not followed: each step solves the contact problem of its impulse, and so finds out by itself whether the body
rolls, slides or flies. It converges to the exact motion at first order in the step, and at second order while the body
only rolls or only flies. The equations are Newton's for particles and Euler's for the shell, in space axes.

Conventions, as in all of the tests: the third space axis is the plane's normal; the geometric centre is at the height 0
when the body touches the plane. ``rotation`` takes body axes to space axes. ``omega`` is the angular velocity and ``V``
the velocity of the geometric centre, **both in space axes**. Places in the body are in body axes from the geometric
centre. The slip velocity is v_s = V − r ω × e3. A disk is a ball with ``planar``: ω is along e2, V along e1 and e3.

A step from q, u with u = (ω, V, θ̇ of the free joints), after J. J. Moreau, Unilateral contact and dry friction in
finite freedom dynamics (1988), and D. E. Stewart, J. C. Trinkle, Int. J. Numer. Meth. Eng. 39 (1996) 2673–2691:

    q_m = q ⊕ h/2 u        M_m (u⁺ − u) = h f(t_m, q_m, ½ (u + u⁺)) + Aᵀ P        q⁺ = q_m ⊕ h/2 u⁺

P is 0 if the height of q_m is positive, and else solves the problem of ``friction_cone`` for v_s⁺ = A u⁺, where A is
constant.

Where the body comes down faster than forces can make it in a step, the step has an impact. It is put back to when the
height was 0, with the part of h f that came before it, for else each impact would cost a random error of the size of
h. By ``process`` it follows Routh's process, as a hard contact does. Without, it obeys Moreau's rule for one step:
friction against the slip at the end, and v₃⁺ = −e v₃⁻. Both agree where D is isotropic and does not couple slip and v₃,
as for homogeneous balls; for others they are different laws, whose motions differ however short the steps are.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import cos, sin, sqrt

import numpy as np

from tests.support import routh
from tests.support.friction_cone import Mode, contact_impulse

TOUCHING = 1e-11  # height below which the plane is touched: above the rounding of a body that stays on it
SLOW = 2.0  # steps whose forces give the approach speed up to which there is no rebound, as in lasting contact
PASSES = 2  # in each step; the second has forces at the mean velocity


@dataclass(frozen=True, eq=False)
class Circle:
    """χ = centre + first cos θ + second sin θ."""

    centre: np.ndarray
    first: np.ndarray
    second: np.ndarray

    def at(self, theta):
        """χ, and its first and second derivative."""
        c, s = cos(theta), sin(theta)
        arm = c * self.first + s * self.second
        return self.centre + arm, c * self.second - s * self.first, -arm


@dataclass(frozen=True, eq=False)
class Line:
    """χ = centre + θ direction."""

    centre: np.ndarray
    direction: np.ndarray

    def at(self, theta):
        return self.centre + theta * self.direction, self.direction, np.zeros(3)


@dataclass(frozen=True, eq=False)
class Uniform:
    """A path with θ = phase + rate t on a curve."""

    curve: Circle | Line
    phase: float
    rate: float

    def __call__(self, t):
        chi, slope, curvature = self.curve.at(self.phase + self.rate * t)
        return chi, self.rate * slope, self.rate**2 * curvature


@dataclass(frozen=True, eq=False)
class Fixed:
    """A point mass that is fixed in the shell."""

    mass: float
    chi: np.ndarray  # (3,)


@dataclass(frozen=True, eq=False)
class Driven:
    """A point mass on a prescribed path: χ(t), χ̇(t), χ̈(t), each (3,), in body axes."""

    mass: float
    path: Callable[[float], tuple[np.ndarray, np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class Free:
    """A point mass on a curve of the shell that moves by itself: a pendulum on a circle, a slider on a line.

    Its generalised force is −stiffness (θ − rest) − damping θ̇.
    """

    mass: float
    curve: Circle | Line
    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0


@dataclass(frozen=True, eq=False)
class System:
    """A shell with point masses on a plane at rest, Coulomb's friction and Newton's restitution."""

    mass: float  # of the shell
    inertia: np.ndarray  # (3,): the shell's principal moments about its own centre of mass, along the body axes
    radius: float
    offset: np.ndarray  # (3,): the shell's centre of mass
    mu: float  # of sliding, and of rest
    restitution: float
    masses: tuple[Fixed | Driven | Free, ...] = ()
    g_space: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    force: np.ndarray = field(default_factory=lambda: np.zeros(3))  # at the geometric centre, in space
    rest_speed: float = 0.0  # approach speed below which an impact has no rebound
    planar: bool = False  # it moves as a disk does
    # Impacts follow Routh's process, in which slip turns. Without, friction opposes the slip at their end (Moreau).
    process: bool = True


@dataclass(frozen=True, eq=False)
class State:
    """Where a system is and how it moves; θ of the free masses, in the order of these."""

    rotation: np.ndarray  # (3, 3)
    omega: np.ndarray  # (3,)
    V: np.ndarray  # (3,)
    z: np.ndarray = field(default_factory=lambda: np.zeros(2))
    height: float = 0.0
    theta: np.ndarray = field(default_factory=lambda: np.zeros(0))
    thetadot: np.ndarray = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True, eq=False)
class Run:
    """States at N + 1 times, and what happened in the N steps between them."""

    times: np.ndarray  # (N + 1,)
    rotation: np.ndarray  # (N + 1, 3, 3)
    omega: np.ndarray  # (N + 1, 3)
    V: np.ndarray  # (N + 1, 3)
    z: np.ndarray  # (N + 1, 2)
    height: np.ndarray  # (N + 1,); just before an impact it may be negative, by less than h |v₃|
    theta: np.ndarray  # (N + 1, k)
    thetadot: np.ndarray  # (N + 1, k)
    mode: np.ndarray  # (N,): a Mode each
    impact_loss: np.ndarray  # (N,): whether there was an impact
    impulse: np.ndarray  # (N, 3): of the plane, in space; without impact, about h times its force
    work: np.ndarray  # (N,): that of the impulse, times the mean of the slip velocities before and after

    def changes(self):
        """The modes in their order, without repetitions."""
        first = np.append(True, np.diff(self.mode) != 0)
        return [Mode(mode) for mode in self.mode[first]]

    def state(self, k):
        """The state at one of the times."""
        place = (self.z[k], float(self.height[k]), self.theta[k], self.thetadot[k])
        return State(self.rotation[k], self.omega[k], self.V[k], *place)


def slip_velocity(system, omega, V):
    """v_s = V − r ω × e3."""
    return np.array([V[0] - system.radius * omega[1], V[1] + system.radius * omega[0], V[2]])


def simulate(system, state, duration, steps):
    """The motion from a state at t = 0, in equal steps."""
    h, free = duration / steps, len(state.theta)
    q, u = _packed(state)
    inside, contacts, history = _Inside(system), [], tuple([value] for value in (*q, u))
    for k in range(steps):
        q, u, contact = _step(inside, k * h, q, u, h)
        for series, value in zip(history, (*q, u), strict=True):
            series.append(value)
        contacts.append(contact)
    turns, places, angles, rates = history
    places, rates = np.array(places), np.array(rates)
    return Run(
        times=h * np.arange(steps + 1),
        rotation=np.array(turns),
        omega=rates[:, :3],
        V=rates[:, 3:6],
        z=places[:, :2],
        height=places[:, 2],
        theta=np.array(angles).reshape(steps + 1, free),
        thetadot=rates[:, 6:],
        mode=np.array([contact.mode for contact in contacts]),
        impact_loss=np.array([contact.impact_loss for contact in contacts]),
        impulse=np.array([contact.impulse for contact in contacts]),
        work=np.array([contact.work for contact in contacts]),
    )


def energy(system, state, t=0.0):
    """Kinetic energy, and potential energy of gravity, of the force and of springs."""
    q, u = _packed(state)
    return _Inside(system).at(t, q).energy(u)


def _packed(state):
    """Configuration and velocities."""
    q = state.rotation, np.append(state.z, state.height), state.theta
    return q, np.concatenate([state.omega, state.V, state.thetadot])


def _moved(q, u, time):
    """Attitude, place and angles after moving at constant velocities."""
    rotation, x, theta = q
    return _rotation_by(time * u[:3]) @ rotation, x + time * u[3:6], theta + time * u[6:]


class _Contact:
    """What the contact did in a step."""

    def __init__(self):
        self.mode, self.impact_loss, self.impulse, self.work = Mode.FLIGHT, False, np.zeros(3), 0.0

    def push(self, impulse, before, after):
        """An impulse between two slip velocities."""
        self.impulse = self.impulse + impulse
        self.work += 0.5 * impulse @ (before + after)


def _step(inside, t, q, u, h):
    """Configuration and velocities after a step that begins at the time t, and what the contact did."""
    q, contact = _moved(q, u, 0.5 * h), _Contact()
    body, height, speed = inside.at(t + 0.5 * h, q), q[1][2], -u[5]
    touches = bool(height <= TOUCHING)
    contact.impact_loss = touches and bool(speed > SLOW * h * abs(body.acceleration(u)[5]))
    if not contact.impact_loss:
        u = _pushed(body, u, h, contact, touches)
        return _moved(q, u, 0.5 * h), u, contact
    late = min(-height / speed, h)  # the middle of the step, for the impact
    left, q = 0.5 * h + late, _moved(q, u, -late)
    body = inside.at(t + h - left, q)
    u = _hit(body, u + (h - left) * body.acceleration(u), contact)
    u = _pushed(body, u, left, contact, touches)
    return _moved(q, u, left), u, contact


def _hit(body, u, contact):
    """The velocities after an impact."""
    system, before = body.system, body.A @ u
    restitution = system.restitution if -before[2] > system.rest_speed else 0.0
    if system.process:
        after, _ = routh.collision(body.D, before, system.mu, restitution)
        impulse = np.linalg.solve(body.D, after - before)
    else:
        impulse, _ = contact_impulse(body.D, before, system.mu, -restitution * before[2])
    contact.push(impulse, before, before + body.D @ impulse)
    return u + body.yielding @ impulse


def _pushed(body, u, h, contact, touches):
    """The velocities after the forces of a time, and the impulse of the plane."""
    impulse, after = np.zeros(3), u
    for _ in range(PASSES):
        after = u + h * body.acceleration(0.5 * (u + after))
        if touches:
            impulse, contact.mode = contact_impulse(body.D, body.A @ after, body.system.mu)
            after = after + body.yielding @ impulse
    contact.push(impulse, body.A @ u, body.A @ after)
    return after


class _Inside:
    """The particles of a system, the first of them the shell's centre of mass."""

    def __init__(self, system):
        self.system = system
        self.m = np.array([system.mass, *(mass.mass for mass in system.masses)])
        numbered = list(enumerate(system.masses, start=1))
        self.driven = [(i, mass.path) for i, mass in numbered if isinstance(mass, Driven)]
        self.free = [(i, mass) for i, mass in numbered if isinstance(mass, Free)]
        self.which = [i for i, _ in self.free]
        self.chi = np.zeros((3, len(self.m)))
        self.chi[:, 0] = system.offset
        for i, mass in numbered:
            if isinstance(mass, Fixed):
                self.chi[:, i] = mass.chi
        size, r = 6 + len(self.free), system.radius
        self.A = np.zeros((3, size))  # of v_s = A u
        self.A[0, [1, 3]], self.A[1, [0, 4]], self.A[2, 5] = (-r, 1), (r, 1), 1
        self.moves = np.ix_(*2 * [[1, 3, 5, *range(6, size)] if system.planar else range(size)])

    def at(self, t, q):
        return _Body(self, t, *q)


class _Body:
    """A system in one configuration, with what depends on it alone. Columns are particles; all is in space axes."""

    def __init__(self, inside, t, rotation, x, theta):
        system, m = inside.system, inside.m
        self.inside, self.system, self.m, self.A, self.x, self.theta = inside, system, m, inside.A, x, theta
        chi, chidot, chiddot = inside.chi.copy(), np.zeros((3, len(m))), np.zeros((3, len(m)))
        for i, path in inside.driven:
            chi[:, i], chidot[:, i], chiddot[:, i] = path(t)
        slopes, curvatures = np.zeros((3, len(theta))), np.zeros((3, len(theta)))
        for a, (i, mass) in enumerate(inside.free):
            chi[:, i], slopes[:, a], curvatures[:, a] = mass.curve.at(theta[a])
        self.rho, self.relative, self.second = rotation @ chi, rotation @ chidot, rotation @ chiddot
        self.slopes, self.curvatures = rotation @ slopes, rotation @ curvatures
        self.weighted = m * self.rho
        self.shell = (rotation * system.inertia) @ rotation.T
        self.mass_matrix = self._mass_matrix()
        inverse = np.zeros_like(self.mass_matrix)
        inverse[inside.moves] = np.linalg.inv(self.mass_matrix[inside.moves])
        self.inverse = inverse
        self.yielding = inverse @ self.A.T  # change of u by an impulse
        self.D = self.A @ self.yielding
        if system.planar:
            self.D[1, 1] = 1.0  # any: no slip across the plane of the disk, so no impulse

    def _mass_matrix(self):
        """Twice the kinetic energy is uᵀ M u if no mass is driven."""
        size = len(self.A[0])
        M = np.zeros((size, size))
        squares = self.weighted @ self.rho.T
        M[:3, :3] = self.shell - squares + np.trace(squares) * np.eye(3)
        M[:3, 3:6] = _hat(self.weighted.sum(axis=1))
        M[3:6, :3] = M[:3, 3:6].T
        M[[3, 4, 5], [3, 4, 5]] = self.m.sum()
        for a, i in enumerate(self.inside.which, start=6):
            slope = self.slopes[:, a - 6]
            M[:3, a] = M[a, :3] = _hat(self.weighted[:, i]) @ slope
            M[3:6, a] = M[a, 3:6] = self.m[i] * slope
            M[a, a] = self.m[i] * (slope @ slope)
        return M

    def acceleration(self, u):
        """The rate of u without the plane: Newton's law for the particles, Euler's for the shell."""
        system, omega, thetadot = self.system, u[:3], u[6:]
        W, relative, second = _hat(omega), self.relative, self.second
        if self.inside.which:
            relative, second = relative.copy(), second.copy()
            relative[:, self.inside.which] = self.slopes * thetadot
            second[:, self.inside.which] = self.curvatures * thetadot**2
        known = W @ (W @ self.rho + 2 * relative) + second - system.g_space[:, None]
        f = np.empty(len(u))
        torques = known @ self.weighted.T
        f[0] = torques[1, 2] - torques[2, 1]
        f[1] = torques[2, 0] - torques[0, 2]
        f[2] = torques[0, 1] - torques[1, 0]
        f[:3] -= W @ (self.shell @ omega)
        f[3:6] = system.force - known @ self.m
        for a, (i, mass) in enumerate(self.inside.free):
            spring = -mass.stiffness * (self.theta[a] - mass.rest) - mass.damping * thetadot[a]
            f[6 + a] = spring - self.m[i] * (self.slopes[:, a] @ known[:, i])
        return self.inverse @ f

    def energy(self, u):
        omega, V, thetadot = u[:3], u[3:6], u[6:]
        v = V[:, None] + _hat(omega) @ self.rho + self.relative
        v[:, self.inside.which] += self.slopes * thetadot
        kinetic = 0.5 * omega @ self.shell @ omega + 0.5 * np.sum(self.m * v**2)
        springs = sum(
            0.5 * mass.stiffness * (angle - mass.rest) ** 2
            for angle, (_, mass) in zip(self.theta, self.inside.free, strict=True)
        )
        weight = self.m.sum() * self.x + self.weighted.sum(axis=1)
        return kinetic + springs - self.system.g_space @ weight - self.system.force @ self.x


def _hat(a):
    """The matrix of a ×."""
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _rotation_by(a):
    """The rotation by the vector a, by Rodrigues' formula."""
    x, y, z = a.tolist()
    square = x * x + y * y + z * z
    angle = sqrt(square)
    if angle < 1e-4:  # where the next term of each series is below rounding
        s, c = 1 - square / 6, 0.5 - square / 24
    else:
        s, c = sin(angle) / angle, (1 - cos(angle)) / square
    d = 1 - c * square
    return np.array(
        [
            [d + c * x * x, c * x * y - s * z, c * x * z + s * y],
            [c * x * y + s * z, d + c * y * y, c * y * z - s * x],
            [c * x * z - s * y, c * y * z + s * x, d + c * z * z],
        ]
    )
