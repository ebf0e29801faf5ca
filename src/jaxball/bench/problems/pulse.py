"""The push of the paper's masses: the same polynomial pieces in both runs."""

from collections.abc import Sequence

from ..problem import Piece, Scalar

# u on [0, .1], [.1, .2] and [.2, 20] as c0 + c1 t: eq_prescribed_u_disk and eq_prescribed_u_ball.
PIECES = (Piece(0.0, 0.1, (1.0, 0.0)), Piece(0.1, 0.2, (2.0, -10.0)), Piece(0.2, 20.0, (0.0, 0.0)))


def push(t: Scalar, p: Sequence[Scalar]) -> Scalar:
    """u(t) on a piece."""
    return p[0] + p[1] * t
