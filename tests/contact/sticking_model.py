"""A model of its own of a disk that rolls, slides, flies and lands, with a pendulum on a joint that sticks.

Coordinates are the place x and the height y of the centre, the angle φ by which the disk has rolled forward, and the
angle ψ of the pendulum from the vertical, in Lagrange's equations by hand; the joint turns by −ψ − φ. No order says
what friction holds: of all modes that are possible after an event the one is taken in which everything that is held
needs no more friction than there is, and everything else begins to move against its friction. In an impact the joint is
free.
"""

import dataclasses
import itertools

import numpy as np
from scipy.integrate import solve_ivp

ROLL, SLIDE_FORWARD, SLIDE_BACK, FLY = "roll", 1, -1, "fly"
X, Y, PHI, PSI = range(4)


@dataclasses.dataclass(frozen=True)
class Robot:
    """A disk of mass M, inertia I and radius R, with a bob of mass m on a pendulum of length l."""

    M: float
    I: float
    R: float
    m: float
    l: float
    g: float
    mu: float
    joint: float
    restitution: float = 0.0
    slowest: float = 0.2

    def matrix(self, q):
        c, s = np.cos(q[PSI]), np.sin(q[PSI])
        total, m, l = self.M + self.m, self.m, self.l
        return np.array(
            [
                [total, 0.0, 0.0, m * l * c],
                [0.0, total, 0.0, m * l * s],
                [0.0, 0.0, self.I, 0.0],
                [m * l * c, m * l * s, 0.0, m * l**2],
            ]
        )

    def forces(self, x, mode):
        """The accelerations, the force of the plane along it and N, and Q of the joint."""
        q, v = x[:4], x[4:]
        contact, joint = mode
        c, s = np.cos(q[PSI]), np.sin(q[PSI])
        A, b = np.zeros((7, 7)), np.zeros(7)
        A[:4, :4] = self.matrix(q)
        A[X, 4], A[Y, 5], A[PHI, 4], A[PHI, 6], A[PSI, 6] = -1.0, -1.0, self.R, 1.0, 1.0
        b[X] = self.m * self.l * v[PSI] ** 2 * s
        b[Y] = -(self.M + self.m) * self.g - self.m * self.l * v[PSI] ** 2 * c
        b[PSI] = -self.m * self.g * self.l * s
        if contact == FLY:
            A[4, 4] = A[5, 5] = 1.0
        else:
            A[5, Y] = 1.0
            if contact == ROLL:
                A[4, X], A[4, PHI] = 1.0, -self.R
            else:
                A[4, 4], A[4, 5] = 1.0, self.mu * contact
        if joint == 0:
            A[6, PHI] = A[6, PSI] = 1.0
        else:
            A[6, 6], b[6] = 1.0, -self.joint * joint
        return np.linalg.solve(A, b)

    def slip(self, v):
        return v[X] - self.R * v[PHI]

    @staticmethod
    def rate(v):
        return -v[PSI] - v[PHI]

    def possible(self, x, contact, joint, loose, flies):
        """Whether a mode can follow an event; ``loose`` has the direction of the contact or the joint that let go."""
        v, (slides_to, turns_to) = x[4:], loose
        f = self.forces(x, (contact, joint))
        slides, turns = self.slip(v), self.rate(v)
        if flies or contact == FLY:
            on_ground = contact == FLY and (flies or f[Y] > 0)
        elif slides_to:
            on_ground = f[5] > 0 and contact == slides_to
        elif contact == ROLL:
            on_ground = slides == 0 and abs(f[4]) <= self.mu * f[5]
        else:
            grows = contact * (f[X] - self.R * f[PHI]) > 0
            on_ground = f[5] > 0 and (grows if slides == 0 else slides * contact > 0)
        if turns_to:
            return on_ground and joint == turns_to
        if joint == 0:
            return on_ground and turns == 0 and abs(f[6]) <= self.joint
        return on_ground and (joint * (-f[PSI] - f[PHI]) > 0 if turns == 0 else turns * joint > 0)

    def next_mode(self, x, loose=(0, 0), flies=False):
        modes = itertools.product((ROLL, SLIDE_FORWARD, SLIDE_BACK, FLY), (0, 1, -1))
        found = [mode for mode in modes if self.possible(x, *mode, loose, flies)]
        assert len(found) == 1, (x, found)
        return found[0]

    def strike(self, x):
        """The state after an impact, in whose normal impulse slip and normal velocity change piecewise linearly."""
        v = x[4:].copy()
        inverse = np.linalg.inv(self.matrix(x[:4]))
        along, up = np.array([1.0, 0.0, -self.R, 0.0]), np.array([0.0, 1.0, 0.0, 0.0])
        target = -self.restitution * v[Y]
        target = target if target > self.slowest * np.sqrt(self.g * self.R) else 0.0

        def gain(share):
            return inverse @ (up + share * along)

        slides = self.slip(v)
        sticks = slides == 0
        if not sticks:
            share = -self.mu * np.sign(slides)
            braking, rising = along @ gain(share), gain(share)[Y]
            stops = -slides / braking if slides * braking < 0 else np.inf
            impulse = min(stops, (target - v[Y]) / rising)
            v += impulse * gain(share)
            sticks = impulse == stops
        # A slip that lasts until the target falls short of that by rounding alone.
        if sticks and v[Y] < target:
            holding = -(along @ inverse @ up) / (along @ inverse @ along)
            assert abs(holding) <= self.mu
            v += (target - v[Y]) / gain(holding)[Y] * gain(holding)
            v[X] = self.R * v[PHI]
        v[Y] = max(target, 0.0)
        return np.concatenate([x[:4], v])

    def guards(self, mode, begun):
        """Functions that fall to zero where the mode ends: the end of the contact's, the loss of it, the joint's.

        What has just begun to move is 0 to rounding, which is no end of it.
        """
        contact, joint = mode

        def moves(t, speed):
            return speed + (1e-9 if t < begun + 1e-6 else 0.0)

        def of_contact(t, x):
            if contact == FLY:
                return x[Y]
            f = self.forces(x, mode)
            return self.mu * f[5] - abs(f[4]) if contact == ROLL else moves(t, contact * self.slip(x[4:]))

        def of_loss(_, x):
            return 1.0 if contact == FLY else self.forces(x, mode)[5]

        def of_joint(t, x):
            return self.joint - abs(self.forces(x, mode)[6]) if joint == 0 else moves(t, joint * self.rate(x[4:]))

        for guard in (of_contact, of_loss, of_joint):
            guard.terminal, guard.direction = True, -1
        return of_contact, of_loss, of_joint

    def run(self, x, end):
        """The modes that begin with each switch, with its time, and the state at the end."""
        t, x, switches = 0.0, np.asarray(x, float), []
        mode = self.next_mode(x, flies=x[Y] > 0)
        while True:
            run = solve_ivp(
                lambda _, x, mode=mode: np.concatenate([x[4:], self.forces(x, mode)[:4]]),
                (t, end),
                x,
                "DOP853",
                events=self.guards(mode, t),
                rtol=1e-12,
                atol=1e-13,
                max_step=1e-3 if mode[0] == FLY else np.inf,  # which passes no whole flight
            )
            t, x = run.t[-1], run.y[:, -1].copy()
            if not run.status:
                return switches, x
            which = next(k for k in range(3) if run.t_events[k].size)
            contact, joint = mode
            flies = contact == FLY
            f = self.forces(x, mode)
            gives_way, loosens = which == 0 and contact == ROLL, which == 2 and joint == 0
            loose = -np.sign(f[4]) if gives_way else 0, -np.sign(f[6]) if loosens else 0
            if contact == ROLL or (which == 0 and contact != FLY):
                x[4 + X] = self.R * x[4 + PHI]
            if joint == 0 or which == 2:
                x[4 + PSI] = -x[4 + PHI]
            if which == 0 and contact == FLY:
                x[Y] = 0.0
                x = self.strike(x)
                flies = x[4 + Y] > 0
            flies |= which == 1
            if not flies:
                x[Y] = x[4 + Y] = 0.0
            mode = self.next_mode(x, loose, flies)
            assert len(switches) < 40
            switches.append((t, mode))
