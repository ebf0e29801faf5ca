"""The tableaus of collocation at the nodes of Gauss and of Radau: nodes, weights and matrices.

The solvers here use them, and optimal control by collocation.

Everything is computed from Legendre polynomials, whose integrals are Legendre polynomials again: ∫₀ˣ P̃ₖ = (P̃ₖ₊₁(x) −
P̃ₖ₋₁(x)) / (2 (2k + 1)) for the shifted polynomials P̃ₖ(x) = Pₖ(2x − 1). So no coefficient is typed in, and all are
accurate to a few units in the last digit for dozens of stages.
"""

import functools
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

_REAL = 1e-9  # imaginary parts up to this are rounding


@dataclass(frozen=True, eq=False)
class Tableau:
    """A collocation method with s stages: Hairer & Wanner (1996), section IV.5.

    ``c`` nodes, ``b`` weights and ``A`` the matrix of Butcher. ``expansion`` takes values at the nodes to the
    coefficients of their polynomial in P̃ₖ. ``eigenvalues`` are those of A⁻¹ with non-negative imaginary part, the real
    one first if there is one; ``to_modes`` and ``from_modes`` map stages to the corresponding modes, and modes to
    stages: x = Re(from_modes @ (to_modes @ x)).
    """

    c: np.ndarray
    b: np.ndarray
    A: np.ndarray
    A_inverse: np.ndarray
    expansion: np.ndarray
    eigenvalues: np.ndarray
    to_modes: np.ndarray
    from_modes: np.ndarray

    @functools.cached_property
    def modes(self) -> "Modes":
        """The modes in real numbers; a single eigenvalue is that of all of them."""
        pairs = np.imag(self.eigenvalues) > _REAL
        weighted = self.eigenvalues[:, None] * self.to_modes
        if not np.any(pairs):
            alone = np.arange(self.eigenvalues.size)
            return Modes(np.real(self.eigenvalues), alone, np.real(weighted), np.real(self.from_modes))
        order = [(k, part) for k, pair in enumerate(pairs) for part in range(1 + pair)]
        rows, parts = np.array(order).T
        first = parts == 0
        partner = np.array([i if not pairs[k] else i + 1 - 2 * part for i, (k, part) in enumerate(order)])

        def part(x: np.ndarray) -> np.ndarray:
            return np.where(first[:, None], np.real(x[rows]), np.imag(x[rows]))

        columns = np.where(first, np.real(self.from_modes[:, rows]), -np.imag(self.from_modes[:, rows]))
        values = self.eigenvalues[rows]
        return Modes(np.where(first, values.conj(), values), partner, part(weighted), columns)


@dataclass(frozen=True, eq=False)
class Modes:
    """The modes of A⁻¹ in real numbers: of a complex mode u + iv first u, then v. All may share one real eigenvalue.

    With P + iQ = (λM − J)⁻¹, (P + iQ)(u + iv) is Pu − Qv and Pv + Qu: both are of the form of a row of P times a mode
    plus a row of Q times its ``partner``, if Q is that of the conjugate for u. ``eigenvalues`` are those, ``weighted``
    takes stages to λ times their modes, and ``to_stages`` takes the modes back to stages.
    """

    eigenvalues: np.ndarray
    partner: np.ndarray
    weighted: np.ndarray
    to_stages: np.ndarray


@functools.cache
def gauss(stages: int) -> Tableau:
    """Returns the method of order 2s on the roots of P̃ₛ."""
    return _collocation(_roots(np.eye(stages + 1)[stages]))


@functools.cache
def radau_right(stages: int) -> Tableau:
    """Returns Radau IIA, the method of order 2s − 1 on the roots of P̃ₛ − P̃ₛ₋₁, of which the last is 1."""
    difference = np.zeros(stages + 1)
    difference[stages - 1 :] = -1.0, 1.0
    c = _roots(difference)
    c[-1] = 1.0
    return _collocation(c)


def integrals(x: np.ndarray, count: int) -> np.ndarray:
    """Computes ∫₀ˣ P̃ₖ for k = 0 … count − 1, the last axis."""
    P = legendre.legvander(2 * np.asarray(x) - 1, count)
    k = np.arange(1, count)
    higher = (P[..., 2:] - P[..., :-2]) / (2 * (2 * k + 1))
    return np.concatenate([np.asarray(x)[..., None], higher], axis=-1)


def _roots(series: np.ndarray) -> np.ndarray:
    """Computes the roots of a Legendre series on [0, 1], increasing, polished by Newton's iteration."""
    x = np.sort(np.real(legendre.legroots(series)))
    slope = legendre.legder(series)
    for _ in range(3):
        x = x - legendre.legval(x, series) / legendre.legval(x, slope)
    return (x + 1) / 2


def _collocation(c: np.ndarray) -> Tableau:
    stages = len(c)
    expansion = np.linalg.inv(legendre.legvander(2 * c - 1, stages - 1))
    A = integrals(c, stages) @ expansion
    roots, vectors = np.linalg.eig(A)
    eigenvalues = 1 / roots
    chosen = np.flatnonzero(eigenvalues.imag > -_REAL)
    chosen = chosen[np.argsort(eigenvalues[chosen].imag)]
    # A pair of conjugate modes is twice the real part of one of them.
    pairs = np.where(eigenvalues[chosen].imag > _REAL, 2.0, 1.0)
    return Tableau(
        c=c,
        b=expansion[0],  # ∫₀¹ P̃ₖ = 0 for k > 0
        A=A,
        A_inverse=_differentiation(c),
        expansion=expansion,
        eigenvalues=eigenvalues[chosen],
        to_modes=np.linalg.inv(vectors)[chosen],
        from_modes=vectors[:, chosen] * pairs,
    )


def _differentiation(c: np.ndarray) -> np.ndarray:
    """Computes A⁻¹: the slopes at the nodes of the polynomial with given values there and the value 0 at 0."""
    x = np.concatenate([[0.0], c])
    gaps = x[:, None] - x
    np.fill_diagonal(gaps, 1.0)
    weights = 1 / np.prod(gaps, axis=1)
    D = weights / weights[:, None] / gaps
    np.fill_diagonal(D, 0.0)
    np.fill_diagonal(D, -np.sum(D, axis=1))
    return D[1:, 1:]
