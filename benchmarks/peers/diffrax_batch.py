"""The paper's ball in diffrax, as one writes it who knows JAX: ``jax.vmap`` of ``diffrax.diffeqsolve``.

The fifteen equations are the paper's, with sums over the masses as arrays and ``jnp.linalg.solve``; u(t) is
chosen by ``jnp.where``, and its kinks are left to the step-size control.
"""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from comparison.problems.rolling import BALL, PAPER, BallNumbers, push
from comparison.translate import jax_parameters
from perturbed import states
from turns import Compiled

NUMBERS = BallNumbers(*map(np.asarray, PAPER))


class Batch(Compiled):
    """All rows in one program."""

    def __init__(self, q: np.ndarray, Omega: np.ndarray, cores: int):
        self.given = (jnp.asarray(states(q, Omega)),)
        self.program = jax.jit(jax.vmap(solve, in_axes=(0, None)))

    def final(self, tolerance: float) -> np.ndarray:
        return np.asarray(self.program(*self.given, jnp.asarray(tolerance)))[:, -9:]


def solve(x, tolerance):
    """x(20)."""
    return diffrax.diffeqsolve(
        diffrax.ODETerm(right_hand_side),
        diffrax.Dopri8(),
        BALL.start,
        BALL.end,
        0.01,
        x,
        args=NUMBERS,
        stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
    ).ys[-1]


def right_hand_side(t, x, numbers: BallNumbers):
    """f of ``rolling_ball_ode_f``."""
    n = len(numbers.u)
    theta, thetadot, q, Omega = x[:n], x[n : 2 * n], x[2 * n : 2 * n + 4], x[2 * n + 4 : 2 * n + 7]
    u = push(t, list(jax_parameters(BALL)(t)))
    rotation = matrix(q)
    Gamma = rotation[2]
    kappa = acceleration(numbers, theta, thetadot, u, Omega, Gamma)
    omega = rotation @ Omega
    scalar, vector = q[0], q[1:]
    qdot = 0.5 * jnp.concatenate([-(vector @ Omega)[None], scalar * Omega + jnp.cross(vector, Omega)])
    zdot = jnp.stack([omega[1], -omega[0]])
    return jnp.concatenate([thetadot, jnp.broadcast_to(u, (n,)), qdot, kappa, zdot])


def acceleration(numbers: BallNumbers, theta, thetadot, u, Omega, Gamma):
    """κ of ``eq_ball_kappa``."""
    c, s = jnp.cos(theta)[:, None], jnp.sin(theta)[:, None]
    zeta = jnp.concatenate([numbers.zeta0[None], numbers.u * c + numbers.v * s])
    slope = jnp.concatenate([jnp.zeros((1, 3)), numbers.v * c - numbers.u * s])
    rate = jnp.concatenate([jnp.zeros(1), thetadot])[:, None]
    arm = Gamma + zeta
    turned = jnp.cross(Omega, jnp.cross(Omega, zeta) + 2 * rate * slope)
    force = Gamma + turned + u * slope - rate**2 * zeta
    torque = jnp.sum(numbers.m[:, None] * jnp.cross(arm, force), axis=0)
    squares = jnp.sum(arm**2, axis=1)[:, None, None] * jnp.eye(3)
    A = jnp.diag(numbers.d) + jnp.sum(numbers.m[:, None, None] * (squares - arm[:, :, None] * arm[:, None, :]), axis=0)
    return -jnp.linalg.solve(A, jnp.cross(Omega, numbers.d * Omega) + torque)


def matrix(q):
    """The rotation matrix of a versor; its last row is Γ."""
    q0, q1, q2, q3 = q
    return jnp.array(
        [
            [1 - 2 * (q2**2 + q3**2), 2 * (q1 * q2 - q0 * q3), 2 * (q1 * q3 + q0 * q2)],
            [2 * (q1 * q2 + q0 * q3), 1 - 2 * (q1**2 + q3**2), 2 * (q2 * q3 - q0 * q1)],
            [2 * (q1 * q3 - q0 * q2), 2 * (q2 * q3 + q0 * q1), 1 - 2 * (q1**2 + q2**2)],
        ]
    )
