"""The contact problem of one step in time: Coulomb's cone and Signorini's law for one contact.

Three unknowns, the impulse P of the plane in space axes, change the slip velocity from v to v⁺ = v + D P. Wanted is

    0 ≤ P₃  ⊥  v₃⁺ ≥ 0        |P_h| ≤ μ P₃,  and P_h = −μ P₃ v_h⁺/|v_h⁺| where v_h⁺ ≠ 0

with the round cone, not a pyramid. Slip is found by the angle of its direction σ, as the zero of a trigonometric
polynomial of degree two: by Newton's method, or, where that does not lead to a slip along σ, as the best zero of all.
"""

from math import atan2, cos, hypot, remainder, sin, tau

import numpy as np

MOST_STEPS = 20
LAST_CHANGE = 1e-14  # of the angle, in Newton's method
ON_CIRCLE = 1e-5  # how far from the unit circle the zero of a quartic is still an angle, before it is improved


class _Slip:
    """Impulses (−μσ, 1) P₃ that bring v₃ to 0, and the slip that they leave, for all angles of σ."""

    def __init__(self, D, v, mu, needed):
        self.D, self.v, self.mu, self.needed = D, v, mu, needed

    def pull(self, s, c):
        """The change of v₃ by an impulse with P₃ = 1."""
        D = self.D
        return D[2][2] - self.mu * (D[2][0] * c + D[2][1] * s)

    def left(self, s, c):
        """The slip v_h⁺, times the pull."""
        D, v, mu = self.D, self.v, self.mu
        pull = self.pull(s, c)
        x = pull * v[0] + self.needed * (D[0][2] - mu * (D[0][0] * c + D[0][1] * s))
        y = pull * v[1] + self.needed * (D[1][2] - mu * (D[1][0] * c + D[1][1] * s))
        return x, y

    def across(self, angle):
        """The part of ``left`` across σ, which must be zero, with its derivative."""
        s, c = sin(angle), cos(angle)
        D, v, mu = self.D, self.v, self.mu
        x, y = self.left(s, c)
        turn = -mu * (D[2][1] * c - D[2][0] * s)
        dx = turn * v[0] - self.needed * mu * (D[0][1] * c - D[0][0] * s)
        dy = turn * v[1] - self.needed * mu * (D[1][1] * c - D[1][0] * s)
        return y * c - x * s, dy * c - dx * s - (x * c + y * s)

    def valid(self, angle):
        s, c = sin(angle), cos(angle)
        x, y = self.left(s, c)
        return self.pull(s, c) > 0 and x * c + y * s > 0

    def improved(self, angle):
        """The zero that Newton's method finds from here; None if it finds none."""
        change = np.inf
        for _ in range(MOST_STEPS):
            value, slope = self.across(angle)
            if slope == 0:
                return None
            change = value / slope
            angle -= change
            if abs(change) < LAST_CHANGE:
                return angle
        return angle if abs(change) < LAST_CHANGE**0.5 else None

    def all_angles(self):
        """Every angle at which the slip is along σ."""
        samples = [self.across(tau * k / 5)[0] for k in range(5)]
        c0, c1, c2, c3, c4 = np.fft.fft(samples) / 5
        zeros = np.roots([c2, c1, c0, c4, c3])
        near = [self.improved(atan2(z.imag, z.real)) for z in zeros if abs(abs(z) - 1) < ON_CIRCLE]
        return [angle for angle in near if angle is not None and self.valid(angle)]

    def impulse(self, angle):
        s, c = sin(angle), cos(angle)
        P3 = self.needed / self.pull(s, c)
        return np.array([-self.mu * P3 * c, -self.mu * P3 * s, P3])


def contact_impulse(D, v, mu):
    """The impulse P (3,) for the contact matrix D (3, 3) and the slip velocity v (3,) without it.

    Where more than one slip is possible, it is the one whose direction is nearest to the impulse of sticking, reversed.
    A ValueError where none is: Painlevé's paradox.
    """
    needed = -v[2]
    if needed <= 0:
        return np.zeros(3)
    stick = np.linalg.solve(D, np.array([-v[0], -v[1], needed]))
    if hypot(stick[0], stick[1]) <= mu * stick[2]:
        return stick
    slip = _Slip(D.tolist(), [float(x) for x in v], mu, float(needed))
    first = atan2(-stick[1], -stick[0])
    angle = slip.improved(first)
    if angle is None or not slip.valid(angle):
        angles = slip.all_angles()
        if not angles:
            raise ValueError("No impulse of the plane obeys Coulomb's law: this is Painlevé's paradox.")
        angle = min(angles, key=lambda a: abs(remainder(a - first, tau)))
    return slip.impulse(angle)
