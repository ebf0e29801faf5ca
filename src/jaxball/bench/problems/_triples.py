"""Vectors of space as triples of scalars."""

from collections.abc import Sequence

from ..problem import Scalar

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
