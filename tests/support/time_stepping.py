"""Rolling, sliding, flight and impacts by steps in time with complementarity, in NumPy, after Moreau.

Modes are not followed: each step solves the contact problem of its impulse, and so finds out by itself whether the body
rolls, slides or flies. It converges to the exact motion at first order in the step, and at second order while the body
only rolls or only flies. The equations are Newton's for particles and Euler's for the shell, in space axes.

Conventions, as in all of the tests: the third space axis is the plane's normal; the geometric centre is at the height 0
when the body touches the plane. ``rotation`` takes body axes to space axes. ``omega`` is the angular velocity and ``V``
the velocity of the geometric centre, **both in space axes**. Places in the body are in body axes from the geometric
centre. The slip velocity is v_s = V − r ω × e3.

A step from q, u with u = (ω, V), after J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics
(1988), and D. E. Stewart, J. C. Trinkle, Int. J. Numer. Meth. Eng. 39 (1996) 2673–2691:

    q_m = q ⊕ h/2 u        M_m (u⁺ − u) = h f(t_m, q_m, ½ (u + u⁺)) + Aᵀ P        q⁺ = q_m ⊕ h/2 u⁺

P is 0 if the height of q_m is positive, and else solves the problem of ``friction_cone`` for v_s⁺ = A u⁺, where A is
constant.

Where the body comes down faster than forces can make it in a step, the step has an impact. It is put back to when the
height was 0, with the part of h f that came before it, for else each impact would cost a random error of the size of
h. It follows Routh's process, as a hard contact does.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import cos, sin, sqrt

import numpy as np

from tests.support import routh
from tests.support.friction_cone import contact_impulse

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
class Uniform:
    """A path with θ = phase + rate t on a curve."""

    curve: Circle
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
class System:
    """A shell with point masses on a plane at rest, Coulomb's friction and Newton's restitution."""

    mass: float  # of the shell
    inertia: np.ndarray  # (3,): the shell's principal moments about its own centre of mass, along the body axes
    radius: float
    offset: np.ndarray  # (3,): the shell's centre of mass
    mu: float  # of sliding, and of rest
    restitution: float
    masses: tuple[Fixed | Driven, ...] = ()
    g_space: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    rest_speed: float = 0.0  # approach speed below which an impact has no rebound


@dataclass(frozen=True, eq=False)
class State:
    """Where a system is and how it moves."""

    rotation: np.ndarray  # (3, 3)
    omega: np.ndarray  # (3,)
    V: np.ndarray  # (3,)
    z: np.ndarray = field(default_factory=lambda: np.zeros(2))
    height: float = 0.0


@dataclass(frozen=True, eq=False)
class Run:
    """States at N + 1 times."""

    times: np.ndarray  # (N + 1,)
    omega: np.ndarray  # (N + 1, 3)
    V: np.ndarray  # (N + 1, 3)
    z: np.ndarray  # (N + 1, 2)
    height: np.ndarray  # (N + 1,); just before an impact it may be negative, by less than h |v₃|


def simulate(system, state, duration, steps):
    """The motion from a state at t = 0, in equal steps."""
    h = duration / steps
    q = state.rotation, np.append(state.z, state.height)
    u = np.concatenate([state.omega, state.V])
    inside, places, rates = _Inside(system), [q[1]], [u]
    for k in range(steps):
        q, u = _step(inside, k * h, q, u, h)
        places.append(q[1])
        rates.append(u)
    places, rates = np.array(places), np.array(rates)
    times = h * np.arange(steps + 1)
    return Run(times, omega=rates[:, :3], V=rates[:, 3:], z=places[:, :2], height=places[:, 2])


def _moved(q, u, time):
    """Attitude and place after moving at constant velocities."""
    rotation, x = q
    return _rotation_by(time * u[:3]) @ rotation, x + time * u[3:]


def _step(inside, t, q, u, h):
    """Configuration and velocities after a step that begins at the time t."""
    q = _moved(q, u, 0.5 * h)
    body, height, speed = inside.at(t + 0.5 * h, q), q[1][2], -u[5]
    touches = bool(height <= TOUCHING)
    if not (touches and bool(speed > SLOW * h * abs(body.acceleration(u)[5]))):
        u = _pushed(body, u, h, touches)
        return _moved(q, u, 0.5 * h), u
    late = min(-height / speed, h)  # the middle of the step, for the impact
    left, q = 0.5 * h + late, _moved(q, u, -late)
    body = inside.at(t + h - left, q)
    u = _hit(body, u + (h - left) * body.acceleration(u))
    u = _pushed(body, u, left, touches)
    return _moved(q, u, left), u


def _hit(body, u):
    """The velocities after an impact."""
    system, before = body.system, body.A @ u
    restitution = system.restitution if -before[2] > system.rest_speed else 0.0
    after, _ = routh.collision(body.D, before, system.mu, restitution)
    return u + body.yielding @ np.linalg.solve(body.D, after - before)


def _pushed(body, u, h, touches):
    """The velocities after the forces of a time."""
    after = u
    for _ in range(PASSES):
        after = u + h * body.acceleration(0.5 * (u + after))
        if touches:
            after = after + body.yielding @ contact_impulse(body.D, body.A @ after, body.system.mu)
    return after


class _Inside:
    """The particles of a system, the first of them the shell's centre of mass."""

    def __init__(self, system):
        self.system = system
        self.m = np.array([system.mass, *(mass.mass for mass in system.masses)])
        numbered = list(enumerate(system.masses, start=1))
        self.driven = [(i, mass.path) for i, mass in numbered if isinstance(mass, Driven)]
        self.chi = np.zeros((3, len(self.m)))
        self.chi[:, 0] = system.offset
        for i, mass in numbered:
            if isinstance(mass, Fixed):
                self.chi[:, i] = mass.chi
        r = system.radius
        self.A = np.zeros((3, 6))  # of v_s = A u
        self.A[0, [1, 3]], self.A[1, [0, 4]], self.A[2, 5] = (-r, 1), (r, 1), 1

    def at(self, t, q):
        return _Body(self, t, q[0])


class _Body:
    """A system in one configuration, with what depends on it alone. Columns are particles; all is in space axes."""

    def __init__(self, inside, t, rotation):
        system, m = inside.system, inside.m
        self.system, self.m, self.A = system, m, inside.A
        chi, chidot, chiddot = inside.chi.copy(), np.zeros((3, len(m))), np.zeros((3, len(m)))
        for i, path in inside.driven:
            chi[:, i], chidot[:, i], chiddot[:, i] = path(t)
        self.rho, self.relative, self.second = rotation @ chi, rotation @ chidot, rotation @ chiddot
        self.weighted = m * self.rho
        self.shell = (rotation * system.inertia) @ rotation.T
        self.inverse = np.linalg.inv(self._mass_matrix())
        self.yielding = self.inverse @ self.A.T  # change of u by an impulse
        self.D = self.A @ self.yielding

    def _mass_matrix(self):
        """Twice the kinetic energy is uᵀ M u if no mass is driven."""
        M = np.zeros((6, 6))
        squares = self.weighted @ self.rho.T
        M[:3, :3] = self.shell - squares + np.trace(squares) * np.eye(3)
        M[:3, 3:] = _hat(self.weighted.sum(axis=1))
        M[3:, :3] = M[:3, 3:].T
        M[[3, 4, 5], [3, 4, 5]] = self.m.sum()
        return M

    def acceleration(self, u):
        """The rate of u without the plane: Newton's law for the particles, Euler's for the shell."""
        omega = u[:3]
        W = _hat(omega)
        known = W @ (W @ self.rho + 2 * self.relative) + self.second - self.system.g_space[:, None]
        torques = known @ self.weighted.T
        f = np.empty(6)
        f[0] = torques[1, 2] - torques[2, 1]
        f[1] = torques[2, 0] - torques[0, 2]
        f[2] = torques[0, 1] - torques[1, 0]
        f[:3] -= W @ (self.shell @ omega)
        f[3:] = -known @ self.m
        return self.inverse @ f


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
