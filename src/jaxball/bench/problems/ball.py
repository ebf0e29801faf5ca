"""The paper's ball, section 5: x = (θ, θ̇, q, Ω, z), with the sums over masses as they are printed."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ... import paper
from ...paper import reference
from ...physics.state import BallState
from ..problem import Form, Functions, Problem, Scalar
from ._triples import Triple, add, cross, dot, scale, solve_symmetric
from .own_form import own_form
from .pulse import PIECES, push

N = len(paper.BALL_RAIL_RADII)
Q = 2 * N  # where q starts
INERTIA = (0.9, 1.0, 1.1)
OFFSET = (0.0, 0.0, -0.05)


def rail_axes(azimuth: float, elevation: float) -> tuple[Triple, Triple]:
    """The first and third column of B(n) = [n, b2, −b1], by Frisvad (2012), section 4 and listing 2."""
    n1, n2, n3 = (
        math.cos(elevation) * math.cos(azimuth),
        math.cos(elevation) * math.sin(azimuth),
        math.sin(elevation),
    )
    a = 1.0 / (1.0 + n3)
    return (n1, n2, n3), (n1 * n1 * a - 1.0, n1 * n2 * a, n1)


RAILS = tuple(rail_axes(*direction) for direction in paper.BALL_RAIL_DIRECTIONS)


def rates(t: Scalar, x: Sequence[Scalar], p: Sequence[Scalar], functions: Functions) -> list[Scalar]:
    """f of ``rolling_ball_ode_f`` with m_i = r = g = 1 and no force."""
    theta, thetadot, q, Omega = x[:N], x[N:Q], x[Q : Q + 4], x[Q + 4 : Q + 7]
    u = push(t, p)
    Lambda = rotation_matrix(q)
    kappa = angular_acceleration(theta, thetadot, u, Omega, Lambda[2], functions)
    omega1, omega2 = dot(Lambda[0], Omega), dot(Lambda[1], Omega)
    return [*thetadot, *[u] * N, *versor_rate(q, Omega), *kappa, omega2, -omega1]


def angular_acceleration(
    theta: Sequence[Scalar], thetadot: Sequence[Scalar], u: Scalar, Omega: Triple, Gamma: Triple, functions: Functions
) -> Triple:
    """κ of ``eq_ball_kappa``: the matrix is its negative, so the sign of the torque is too."""
    d1, d2, d3 = INERTIA
    d_Omega = (d1 * Omega[0], d2 * Omega[1], d3 * Omega[2])
    # The shell's own centre of mass is at rest in the body.
    masses: list[tuple[Triple, Triple]] = [(OFFSET, cross(Omega, cross(Omega, OFFSET)))]
    for (n, b), r_i, theta_i, w in zip(RAILS, paper.BALL_RAIL_RADII, theta, thetadot, strict=True):
        c, s = r_i * functions.cos(theta_i), r_i * functions.sin(theta_i)
        zeta = add(scale(c, n), scale(s, b))
        slope = add(scale(c, b), scale(-s, n))
        twice_velocity = scale(2.0 * w, slope)
        along = add(scale(u, slope), scale(-(w * w), zeta))
        masses.append((zeta, add(cross(Omega, add(cross(Omega, zeta), twice_velocity)), along)))
    torque, B = cross(Omega, d_Omega), (d1, d2, d3, 0.0, 0.0, 0.0)
    for zeta, acceleration in masses:
        s = add(Gamma, zeta)
        torque = add(torque, cross(s, add(Gamma, acceleration)))
        squares = [part * part for part in s]
        B = (
            B[0] + (squares[1] + squares[2]),
            B[1] + (squares[0] + squares[2]),
            B[2] + (squares[0] + squares[1]),
            B[3] - s[0] * s[1],
            B[4] - s[0] * s[2],
            B[5] - s[1] * s[2],
        )
    return solve_symmetric(B, scale(-1.0, torque))


def versor_rate(q: Sequence[Scalar], Omega: Triple) -> list[Scalar]:
    """q̇ = ½ q Ω♯."""
    q0, v = q[0], q[1:]
    half = scale(0.5, Omega)
    return [-dot(v, half), *add(scale(q0, half), cross(v, half))]


def rotation_matrix(q: Sequence[Scalar]) -> tuple[Triple, Triple, Triple]:
    """The rows of Λ, for |q| = 1."""
    q0, q1, q2, q3 = q
    return (
        (1.0 - 2.0 * (q2 * q2 + q3 * q3), 2.0 * (q1 * q2 - q0 * q3), 2.0 * (q1 * q3 + q0 * q2)),
        (2.0 * (q1 * q2 + q0 * q3), 1.0 - 2.0 * (q1 * q1 + q3 * q3), 2.0 * (q2 * q3 - q0 * q1)),
        (2.0 * (q1 * q3 - q0 * q2), 2.0 * (q2 * q3 + q0 * q1), 1.0 - 2.0 * (q1 * q1 + q2 * q2)),
    )


def form() -> Form:
    """jaxball's own form, with exact θ(t)."""
    return own_form(paper.ball(), BallState(), whole)


def whole(end: BallState) -> Float[np.ndarray, "15"]:
    """The problem's state from jaxball's state at the end."""
    return np.array([*BALL.exact[:Q], *end.q, *end.Omega, *end.z])


BALL = Problem(
    name="ball",
    title="The paper's ball",
    source="Putkaradze & Rogers (2018), section 5; the 30-digit reference of jaxball.paper.reference",
    pieces=PIECES,
    initial=(*paper.BALL_THETA, *[0.0] * N, 1.0, 0.0, 0.0, 0.0, *[0.0] * 5),
    rates=rates,
    exact=tuple(map(float, reference.ball().values[-1])),
    measured=tuple(range(Q, Q + 9)),
    relative=False,
    stiff=False,
    atol_over_rtol=1.0,
    form=form,
)
