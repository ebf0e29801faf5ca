"""The paper's ball as a differential-algebraic equation, ``rolling_ball_dae_g``: |q|² = 1 for the rate of a component.

∂(|q|² − 1)/∂q_k = 2 q_k, so the index is 1 only while q_k is not zero. The paper takes q_0 throughout, and in its own
run q_0 passes zero at t = 9.2067. ``BALL_DAE`` changes to q_1 in time and back, so that its algebraic component stays
above 0.48; ``BALL_DAE_PAPER`` follows the paper.
"""

import dataclasses
from collections.abc import Sequence

from ... import paper
from ...physics.state import BallState
from ..problem import Form, Piece, Scalar
from .ball import BALL, Q, whole
from .own_form import own_dae_form
from .pulse import PIECES

PUSH, FALL, COAST = PIECES


def norm_excess(x: Sequence[Scalar]) -> Scalar:
    """|q|² − 1."""
    q = x[Q : Q + 4]
    return q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0


def form() -> Form:
    """jaxball's own form, which chooses the algebraic component at each step."""
    return own_dae_form(paper.ball(), BallState(), whole)


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
    form=form,
)
BALL_DAE_PAPER = dataclasses.replace(
    BALL_DAE,
    name="ball-dae-paper",
    title="The paper's ball, DAE with q₀ algebraic throughout",
    pieces=tuple(dataclasses.replace(piece, algebraic=Q) for piece in PIECES),
    form=None,
)
