"""Balls and disks as problems: with the equations of the paper, as a DAE, and in the form that jaxball solves."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar, cast

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxball import paper
from jaxball.numerics.arrays import to_array
from jaxball.paper import reference
from jaxball.paper.systems import (
    BALL_RAIL_DIRECTIONS,
    BALL_RAIL_RADII,
    BALL_THETA,
    DISK_RAIL_RADII,
    DISK_THETA,
    PAPER_END,
    PAPER_START,
)
from jaxball.physics.body import System
from jaxball.physics.packing import Packing
from jaxball.physics.state import BallState, DiskState

from ..problem import Form, Functions, Piece, Problem, Rates, Scalar

Triple = Sequence[Scalar]


def add(*vectors: Triple) -> Triple:
    """The sum of vectors."""
    return [sum(parts[1:], start=parts[0]) for parts in zip(*vectors, strict=True)]


def scale(a: Scalar, x: Triple) -> Triple:
    """a x."""
    return [a * part for part in x]


def cross(a: Triple, b: Triple) -> Triple:
    """a × b."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def dot(a: Triple, b: Triple) -> Scalar:
    """a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def solve_symmetric(A: Sequence[Scalar], b: Triple) -> Triple:
    """x of A x = b by cofactors, for a symmetric A given as A11, A22, A33, A12, A13, A23."""
    A11, A22, A33, A12, A13, A23 = A
    C = (
        (A22 * A33 - A23 * A23, A13 * A23 - A12 * A33, A12 * A23 - A13 * A22),
        (A13 * A23 - A12 * A33, A11 * A33 - A13 * A13, A12 * A13 - A11 * A23),
        (A12 * A23 - A13 * A22, A12 * A13 - A11 * A23, A11 * A22 - A12 * A12),
    )
    determinant = A11 * C[0][0] + A12 * C[0][1] + A13 * C[0][2]
    return scale(1.0 / determinant, [dot(row, b) for row in C])


# u on [0, .1], [.1, .2] and [.2, 20] as c0 + c1 t: eq_prescribed_u_disk and eq_prescribed_u_ball.
PIECES = (Piece(0.0, 0.1, (1.0, 0.0)), Piece(0.1, 0.2, (2.0, -10.0)), Piece(0.2, 20.0, (0.0, 0.0)))


def push(t: Scalar, p: Sequence[Scalar]) -> Scalar:
    """u(t) on a piece."""
    return p[0] + p[1] * t


AnyState = TypeVar("AnyState", BallState, DiskState)


def own_form(system: System, start: AnyState, whole: Callable[[AnyState], Float[np.ndarray, " state"]]) -> Form:
    """The equations that :func:`jaxball.simulate` solves, with θ(t) in closed form and the locked angular velocity.

    ``whole`` converts jaxball's state at the end to a state of the problem.
    """
    packing = Packing.of(system.prepare(), start)

    def field(t: Float[Array, ""], x: Float[Array, " form"], args: Any) -> Float[Array, " form"]:
        return packing.field(t, x)

    def final(x: Float[np.ndarray, " form"]) -> Float[np.ndarray, " state"]:
        return whole(cast(AnyState, packing.unpack(to_array(PAPER_END), to_array(x))))

    return Form(field, tuple(map(float, packing.pack(to_array(PAPER_START), start))), final)


def own_dae_form(system: System, start: BallState, whole: Callable[[BallState], Float[np.ndarray, " state"]]) -> Form:
    """:func:`own_form` as ``jaxball.simulate(dae=True)`` solves it, with the largest component of q algebraic."""
    form = own_form(system, start, whole)
    packing, initial = Packing.of(system.prepare(), start), jnp.asarray(form.initial)
    return dataclasses.replace(
        form,
        field=lambda t, x, component: packing.dae_field(t, x, component),
        mass=lambda component: packing.mass_diagonal(initial, component),
        choose=lambda t, x, args: packing.algebraic_component(x),
    )


BALL_MASSES = len(BALL_RAIL_RADII)
Q = 2 * BALL_MASSES  # where q starts


class BallNumbers(NamedTuple):
    """The parameters of a ball whose masses run on circles about its centre: numbers, or expressions of a package.

    - ``m``: m_0 … m_n.
    - ``d``: the principal moments of inertia of the shell, and ``zeta0`` its centre of mass.
    - ``u``, ``v``: of each mass, with ζ_i = u_i cos θ_i + v_i sin θ_i.
    """

    m: Sequence[Scalar]
    d: Triple
    zeta0: Triple
    u: Sequence[Triple]
    v: Sequence[Triple]


def rail_axes(azimuth: float, elevation: float) -> tuple[Triple, Triple]:
    """The first and third column of B(n) = [n, b2, −b1], by Frisvad (2012), section 4 and listing 2."""
    n1, n2, n3 = (
        math.cos(elevation) * math.cos(azimuth),
        math.cos(elevation) * math.sin(azimuth),
        math.sin(elevation),
    )
    a = 1.0 / (1.0 + n3)
    return (n1, n2, n3), (n1 * n1 * a - 1.0, n1 * n2 * a, n1)


RAILS = [rail_axes(*direction) for direction in BALL_RAIL_DIRECTIONS]
PAPER = BallNumbers(
    m=(1.0,) * (1 + BALL_MASSES),
    d=(0.9, 1.0, 1.1),
    zeta0=(0.0, 0.0, -0.05),
    u=[scale(r, n) for r, (n, _) in zip(BALL_RAIL_RADII, RAILS, strict=True)],
    v=[scale(r, b) for r, (_, b) in zip(BALL_RAIL_RADII, RAILS, strict=True)],
)


def ball_equations(numbers: BallNumbers) -> Rates:
    """f of ``rolling_ball_ode_f`` for x = (θ, θ̇, q, Ω, z), with r = g = 1 and no force."""
    n = len(numbers.u)

    def rates(t: Scalar, x: Sequence[Scalar], p: Sequence[Scalar], functions: Functions) -> list[Scalar]:
        theta, thetadot, q, Omega = x[:n], x[n : 2 * n], x[2 * n : 2 * n + 4], x[2 * n + 4 : 2 * n + 7]
        u, Lambda = push(t, p), rotation_matrix(q)
        masses = [(numbers.zeta0, cross(Omega, cross(Omega, numbers.zeta0)))]  # the shell's, at rest in the body
        for u_i, v_i, theta_i, w in zip(numbers.u, numbers.v, theta, thetadot, strict=True):
            c, s = functions.cos(theta_i), functions.sin(theta_i)
            zeta, slope = add(scale(c, u_i), scale(s, v_i)), add(scale(c, v_i), scale(-s, u_i))
            along = add(scale(u, slope), scale(-(w * w), zeta))
            twice_velocity = scale(2.0 * w, slope)
            masses.append((zeta, add(cross(Omega, add(cross(Omega, zeta), twice_velocity)), along)))
        kappa = angular_acceleration(numbers, masses, Omega, Lambda[2])
        omega1, omega2 = dot(Lambda[0], Omega), dot(Lambda[1], Omega)
        return [*thetadot, *[u] * n, *versor_rate(q, Omega), *kappa, omega2, -omega1]

    return rates


def angular_acceleration(
    numbers: BallNumbers, masses: Sequence[tuple[Triple, Triple]], Omega: Triple, Gamma: Triple
) -> Triple:
    """κ of ``eq_ball_kappa``, from ζ and the relative acceleration of every mass.

    The matrix is the negative of the paper's, so the sign of the torque is too.
    """
    torque = cross(Omega, [d * part for d, part in zip(numbers.d, Omega, strict=True)])
    B = [*numbers.d, 0.0, 0.0, 0.0]
    for m, (zeta, acceleration) in zip(numbers.m, masses, strict=True):
        s = add(Gamma, zeta)
        torque = add(torque, scale(m, cross(s, add(Gamma, acceleration))))
        x, y, z = (part * part for part in s)
        B = [
            *(entry + m * part for entry, part in zip(B[:3], (y + z, x + z, x + y), strict=True)),
            *(entry - m * s[i] * s[j] for entry, (i, j) in zip(B[3:], ((0, 1), (0, 2), (1, 2)), strict=True)),
        ]
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


def whole(end: BallState) -> Float[np.ndarray, "15"]:
    """The problem's state from jaxball's state at the end."""
    return np.array([*BALL.exact[:Q], *end.q, *end.Omega, *end.z])


BALL = Problem(
    name="ball",
    title="The paper's ball",
    source="Putkaradze & Rogers (2018), section 5; the 30-digit reference of jaxball.paper.reference",
    pieces=PIECES,
    initial=(*BALL_THETA, *[0.0] * BALL_MASSES, 1.0, 0.0, 0.0, 0.0, *[0.0] * 5),
    rates=ball_equations(PAPER),
    exact=tuple(map(float, reference.ball().values[-1])),
    measured=tuple(range(Q, Q + 9)),
    relative=False,
    stiff=False,
    atol_over_rtol=1.0,
    form=lambda: own_form(paper.ball(), BallState(), whole),
)


PUSH, FALL, COAST = PIECES


def norm_excess(x: Sequence[Scalar]) -> Scalar:
    """|q|² − 1."""
    q = x[Q : Q + 4]
    return q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0


BALL_DAE = dataclasses.replace(
    BALL,
    name="ball-dae",
    title="The paper's ball, DAE",
    pieces=(
        dataclasses.replace(PUSH, algebraic=Q),
        dataclasses.replace(FALL, algebraic=Q),
        Piece(COAST.start, 7.5, COAST.parameters, algebraic=Q),
        Piece(7.5, 12.5, COAST.parameters, algebraic=Q + 1),
        Piece(12.5, COAST.end, COAST.parameters, algebraic=Q),
    ),
    constraint=norm_excess,
    form=lambda: own_dae_form(paper.ball(), BallState(), whole),
)
BALL_DAE_PAPER = dataclasses.replace(
    BALL_DAE,
    name="ball-dae-paper",
    title="The paper's ball, DAE with q₀ algebraic throughout",
    pieces=tuple(dataclasses.replace(piece, algebraic=Q) for piece in PIECES),
    form=None,
)


DISK_MASSES = len(DISK_RAIL_RADII)
SIGNS = tuple((-1.0) ** i for i in range(1, DISK_MASSES + 1))


def disk_rates(t: Scalar, x: Sequence[Scalar], p: Sequence[Scalar], functions: Functions) -> list[Scalar]:
    """ẋ of ``eq_rdisk_dynamics`` with m_i = r = g = d_2 = 1 and ζ_0 = 0."""
    theta, thetadot, (phi, phidot) = x[:DISK_MASSES], x[DISK_MASSES : 2 * DISK_MASSES], x[2 * DISK_MASSES :]
    u = push(t, p)
    thetaddot = [sign * u for sign in SIGNS]
    s, c = functions.sin(phi), functions.cos(phi)
    # m_0 rests in the centre: K_0 = 0, and it adds m_0 r² to the inertia d_2.
    K, inertia = 0.0, 2.0
    for i, r_i in enumerate(DISK_RAIL_RADII):
        cosine, sine = functions.cos(theta[i]), functions.sin(theta[i])
        # ζ_i and its derivatives along the rail
        zeta1, zeta3 = r_i * cosine, r_i * sine
        v1, v3 = -zeta3 * thetadot[i], zeta1 * thetadot[i]
        a1 = -zeta3 * thetaddot[i] - v3 * thetadot[i]
        a3 = zeta1 * thetaddot[i] + v1 * thetadot[i]
        arm1, arm3 = s + zeta1, c + zeta3
        K = K + (  # eq_K_i
            (1.0 + phidot * phidot) * (zeta3 * s - zeta1 * c)
            + arm3 * (a1 - 2.0 * phidot * v3)
            - arm1 * (a3 + 2.0 * phidot * v1)
        )
        inertia = inertia + (arm1 * arm1 + arm3 * arm3)
    return [*thetadot, *thetaddot, phidot, K / inertia]  # eqmo_chap_disk_4


def whole_of_disk(end: DiskState) -> Float[np.ndarray, " state"]:
    """The problem's state from jaxball's state at the end."""
    return np.array([*DISK.exact[: 2 * DISK_MASSES], end.phi, end.phidot])


DISK = Problem(
    name="disk",
    title="The paper's disk",
    source="Putkaradze & Rogers (2018), section 4; the 30-digit reference of jaxball.paper.reference",
    pieces=PIECES,
    initial=(*[DISK_THETA] * DISK_MASSES, *[0.0] * DISK_MASSES, 0.0, 0.0),
    rates=disk_rates,
    exact=tuple(map(float, reference.disk().values[-1])),
    measured=(2 * DISK_MASSES, 2 * DISK_MASSES + 1),
    relative=False,
    stiff=False,
    atol_over_rtol=1.0,
    form=lambda: own_form(paper.disk(), DiskState(), whole_of_disk),
)
