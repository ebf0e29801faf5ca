"""Routh's process of an impact, in NumPy with SciPy: another independent variable, other tolerances, no fixed steps.

With dI₃ = |v| dλ the slip velocity v, the normal velocity w and its work obey regular equations, in which slip ends as
λ → ∞.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

STOPPED = 1e-10  # of the velocity before
ANGLES = 0.001 + np.linspace(0.0, 2 * np.pi, 721)  # none of them along an axis


def _pull(D, mu, sigma):
    return D @ np.array([-mu * sigma[0], -mu * sigma[1], 1.0])


def _of(angle):
    return np.array([np.cos(angle), np.sin(angle)])


def _across(D, mu, angle):
    sigma = _of(angle)
    pull = _pull(D, mu, sigma)
    return sigma[0] * pull[1] - sigma[1] * pull[0]


def _diverging(D, mu):
    """All directions in which a slip grows as it begins."""
    values = [_across(D, mu, angle) for angle in ANGLES]
    brackets = [k for k in range(len(ANGLES) - 1) if values[k] * values[k + 1] < 0]
    angles = [brentq(lambda a: _across(D, mu, a), ANGLES[k], ANGLES[k + 1], xtol=1e-15) for k in brackets]
    return [sigma for sigma in map(_of, angles) if sigma @ _pull(D, mu, sigma)[:2] > 0]


def collision(D, slip, mu, restitution):
    """The slip velocity after an impact, and what its course was."""
    target, scale = -restitution * slip[2], np.linalg.norm(slip)

    def slope(_, x):
        speed = np.hypot(x[0], x[1])
        return np.append(D @ np.array([-mu * x[0], -mu * x[1], speed]), speed * x[2])

    def rebounds(_, x):
        return x[2] - target

    def gave_back(_, x):
        return x[3] if x[2] > 0 else -1.0

    def stops(_, x):
        return np.hypot(x[0], x[1]) - STOPPED * scale

    for event, direction in ((rebounds, 1), (gave_back, 1), (stops, -1)):
        event.terminal, event.direction = True, direction
    x = np.append(slip, 0.0)
    if np.any(slip[:2]):
        events = [rebounds, gave_back, stops]
        run = solve_ivp(slope, (0, 1e6), x, method="DOP853", rtol=1e-13, atol=1e-15, events=events)
        x = run.y[:, -1]
        for name, times in zip(("slides", "slides, limited"), run.t_events, strict=False):
            if times.size:
                return x[:3], name

    def ended(rise):
        return min(target, np.sqrt(max(x[2] ** 2 - 2 * rise * x[3], 0.0)))

    S = np.linalg.inv(D)
    if np.hypot(*S[:2, 2]) <= mu * S[2, 2]:
        end = ended(1 / S[2, 2])
        return np.array([0.0, 0.0, end]), "sticks" if end == target else "sticks, limited"
    (sigma,) = _diverging(D, mu)
    pull = _pull(D, mu, sigma)
    end = ended(pull[2])
    return np.append((end - x[2]) / pull[2] * pull[:2], end), "slides again" if end == target else "again, limited"
