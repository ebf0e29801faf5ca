"""The numbers of the paper's ball as plain arrays, read off jaxball's own system."""

from typing import Any, NamedTuple

import numpy as np

from jaxball import paper


class BallNumbers(NamedTuple):
    """Parameters of a ball whose masses run on circles about its centre: ζ_i = u_i cos θ_i + v_i sin θ_i."""

    m: np.ndarray  # m_0 … m_n
    d: np.ndarray  # d_1, d_2, d_3
    r: float
    g: float
    zeta0: np.ndarray
    u: np.ndarray  # n vectors
    v: np.ndarray
    theta: np.ndarray  # θ_a


# u(t) = constant + slope t on each leg of eq_prescribed_u_ball, and where the leg ends.
LEGS = ((0.1, 1.0, 0.0), (0.2, 2.0, -10.0), (20.0, 0.0, 0.0))
TOLERANCES = (1e-8, 1e-9, 1e-10, 1e-11)


def ball_numbers() -> BallNumbers:
    """The ball of section 5."""
    ball = paper.ball()
    rails = [item.motion.rail for item in ball.point_masses]
    axes = [np.asarray(rail.radius * rail.frame.matrix()) for rail in rails]
    return BallNumbers(
        m=np.array([ball.mass, *(item.mass for item in ball.point_masses)], dtype=float),
        d=np.asarray(ball.inertia),
        r=float(ball.radius),
        g=float(ball.gravity),
        zeta0=np.asarray(ball.offset),
        u=np.stack([matrix[:, 0] for matrix in axes]),
        v=np.stack([matrix[:, 2] for matrix in axes]),
        theta=np.array(paper.BALL_THETA),
    )


def initial_state(numbers: BallNumbers) -> np.ndarray:
    """x_a of ``eq_ball_initial_conds_spec``."""
    n = len(numbers.theta)
    return np.concatenate([numbers.theta, np.zeros(n), [1.0], np.zeros(8)])


def parameters() -> np.ndarray:
    """Ten parameters: the masses m_0 … m_3, the inertia, and the shell's centre of mass."""
    numbers = ball_numbers()
    return np.concatenate([numbers.m, numbers.d, numbers.zeta0])


def with_parameters(numbers: BallNumbers, values: Any) -> BallNumbers:
    """The ball with other ones, numbers or expressions."""
    n = len(numbers.m)
    return numbers._replace(m=values[:n], d=values[n : n + 3], zeta0=values[n + 3 :])
