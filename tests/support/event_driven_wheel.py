"""A wheel with a pendulum, by an event-driven model: slip, rolling and a joint, each held or resisted by dry friction.

Seven linear equations give the accelerations of x, of the forward turn a and of θ, the friction f, the torque T against
rolling, the friction h of the joint, and N. What is held is found by trying all sets. It shares nothing with the
package.
"""

import itertools
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.integrate import solve_ivp

RADIUS, GRAVITY = 1.0, 9.81
# What has begun to move must not stop within one step, which would look as if it never moved.
TIGHT: dict[str, Any] = {"rtol": 1e-12, "atol": 1e-13, "max_step": 2e-3}
Signs = tuple[int, int, int]  # of the motions of slip, turn and joint; 0 for what is held
# A unit of friction acts on x and against a, the torque on a, and the joint's friction on θ; each acts against the rate
# of the same combination.
ACTS = np.array([[1.0, 0.0, 0.0], [-RADIUS, 1.0, 0.0], [0.0, 0.0, 1.0]])


class Wheel(NamedTuple):
    """Masses, and the levels of the three laws: of slip and of rolling times N, of the joint alone.

    ``static`` are those at rest.
    """

    kinetic: tuple[float, float, float]
    static: tuple[float, float, float]
    mass: float = 1.0
    inertia: float = 0.5
    bob: float = 0.6
    length: float = 0.7
    torque: float = 2.2
    frequency: float = 1.7


class Change(NamedTuple):
    """A time at which the modes change, and the signs of the motions afterwards."""

    time: float
    signs: Signs


def solve(wheel: Wheel, t: float, x: Float[np.ndarray, "6"], signs: Signs) -> Float[np.ndarray, "7"]:
    """Solves for ẍ, ä, θ̈, f, T, h and N, where each law holds (0) or resists motion in a direction."""
    M, bob, length = wheel.mass + wheel.bob, wheel.bob, wheel.length
    angle, rate = x[1] + x[2], x[4] + x[5]  # of the pendulum, in space
    sine, cosine = np.sin(angle), np.cos(angle)
    swing = np.array([0.0, 1.0, 1.0])
    mixed = bob * length * cosine * np.outer(np.array([1.0, 0.0, 0.0]), swing)
    mass = np.diag([M, wheel.inertia, 0.0]) + bob * length**2 * np.outer(swing, swing) - mixed - mixed.T
    force = np.array([-bob * length * sine * rate**2, 0.0, wheel.torque * np.sin(wheel.frequency * t)])
    force -= bob * GRAVITY * length * sine * swing
    A, b = np.zeros((7, 7)), np.zeros(7)
    A[:3, :3], A[:3, 3:6], b[:3] = mass, -ACTS, force
    A[3, :3], A[3, 6], b[3] = -bob * length * sine * swing, 1.0, M * GRAVITY + bob * length * cosine * rate**2
    for law, sign in enumerate(signs):
        row, level = A[4 + law], wheel.kinetic[law]
        if sign == 0:
            row[:3] = ACTS[:, law]
        elif law == 2:
            row[5], b[6] = 1.0, -level * sign
        else:
            row[3 + law], row[6] = 1.0, level * sign * (RADIUS if law else 1.0)
    return np.linalg.solve(A, b)


def spare(wheel: Wheel, solved: Float[np.ndarray, "7"]) -> Float[np.ndarray, "3"]:
    """Computes how much more each law could hold."""
    N = solved[6]
    return np.array(wheel.static) * [N, N * RADIUS, 1.0] - np.abs(solved[3:6])


def choose(wheel: Wheel, t: float, x: Float[np.ndarray, "6"], allowed: list[int | None]) -> Signs:
    """Finds the set that holds most of what may be held: ``allowed`` has the signs of the rest, None for the former."""
    consistent = []
    for each in itertools.product(*[(0, 1, -1) if sign is None else (sign,) for sign in allowed]):
        signs = _signs(each)
        solved = solve(wheel, t, x, signs)
        grows, left = ACTS.T @ solved[:3], spare(wheel, solved)
        free = [law for law in range(3) if allowed[law] is None]
        if all(left[law] >= 0 if signs[law] == 0 else signs[law] * grows[law] > 0 for law in free):
            consistent.append(signs)
    return max(consistent, key=lambda signs: signs.count(0))


def run(wheel: Wheel, x: Float[np.ndarray, "6"], times: Float[np.ndarray, " n"]) -> tuple[np.ndarray, list[Change]]:
    """Simulates from the state (x, a, θ and their rates), which moves in all; returns states and changes."""
    t, rows, changes = float(times[0]), [x], []
    signs = _signs(np.sign(ACTS.T @ x[3:]))
    while t < times[-1]:
        guards = [_Guard(wheel, signs, law) for law in range(3)]
        saved = times[times > t]
        span, args = (t, times[-1]), (wheel, signs)
        done = solve_ivp(_field, span, x, "DOP853", saved, events=guards, args=args, **TIGHT)
        rows.extend(np.asarray(done.y).T)
        if done.status == 0:
            break
        law = next(law for law in range(3) if done.t_events[law].size)
        t, x = float(done.t_events[law][0]), done.y_events[law][0]
        # What does not move has a rate of 0, not of rounding: that of the contact, of the turn, of the joint.
        moving = np.array(signs) != 0
        moving[law] = False
        rates = np.where(moving, ACTS.T @ x[3:], 0.0)
        x = np.concatenate([x[:3], np.linalg.solve(ACTS.T, rates)])
        allowed: list[int | None] = [sign or None for sign in signs]
        # What lets go moves against the force that held it; what has stopped may be held.
        allowed[law] = -int(np.sign(solve(wheel, t, x, signs)[3 + law])) if signs[law] == 0 else None
        signs = choose(wheel, t, x, allowed)
        changes.append(Change(t, signs))
    return np.array(rows), changes


class _Guard:
    """The rate of a law that moves, in its direction, or what one that holds has to spare: an event where it is 0."""

    terminal, direction = True, -1

    def __init__(self, wheel: Wheel, signs: Signs, law: int):
        self.wheel, self.signs, self.law = wheel, signs, law

    def __call__(self, t: float, x: Float[np.ndarray, "6"], *_: object) -> float:
        if self.signs[self.law] == 0:
            return spare(self.wheel, solve(self.wheel, t, x, self.signs))[self.law]
        return self.signs[self.law] * (ACTS.T @ x[3:])[self.law]


def _field(t: float, x: Float[np.ndarray, "6"], wheel: Wheel, signs: Signs) -> Float[np.ndarray, "6"]:
    return np.concatenate([x[3:], solve(wheel, t, x, signs)[:3]])


def _signs(values: Iterable[float]) -> Signs:
    slip, turn, joint = (int(value) for value in values)
    return slip, turn, joint
