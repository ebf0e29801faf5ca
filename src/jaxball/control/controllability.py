"""Deviations that no input changes, by name."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from .sampled import Linear

LEAST = 1e-8  # of the largest singular value of what inputs reach; below it is rounding
ROUNDING = 1e-6  # of the largest entry of a combination


def uncontrollable(linear: Linear, names: Sequence[str]) -> tuple[str, ...]:
    """The combinations of deviations at the end of a linear flow that no input changes, by name."""
    return in_words(unreached_by(reached(np.asarray(linear.A), np.asarray(linear.B))), names)


def reached(A: Float[np.ndarray, "samples n n"], B: Float[np.ndarray, "samples n m"]) -> Float[np.ndarray, "n rank"]:
    """A factor of the Gramian of what inputs reach, Σ Φ B Bᵀ Φᵀ, kept small by a QR factorisation at each sample."""
    n = A.shape[1]
    found = np.zeros((n, n))
    for step, own in zip(A, B, strict=True):
        triangle = np.asarray(np.linalg.qr(np.concatenate([(step @ found).T, own.T]), mode="r"))
        found = triangle.T
    return found


def unreached_by(factor: Float[np.ndarray, "n rank"]) -> Float[np.ndarray, "rows n"]:
    """An orthonormal basis of what a Gramian with this factor leaves out."""
    columns, sizes, _ = np.linalg.svd(factor)
    sizes = np.append(sizes, np.zeros(len(factor) - len(sizes)))
    return columns.T[sizes <= LEAST * np.max(sizes, initial=0.0)]


def in_words(rows: Float[np.ndarray, "rows n"], names: Sequence[str]) -> tuple[str, ...]:
    """The combinations that span the same space, each of as few names as possible."""
    return tuple(_in_words(row, names) for row in _reduced(rows))


def _reduced(rows: Float[np.ndarray, "rows n"]) -> Float[np.ndarray, "rows n"]:
    """The reduced row echelon form, by Gauss and Jordan with the largest pivots."""
    rows, done = rows.copy(), 0
    for column in range(rows.shape[1]):
        if done == len(rows):
            break
        pivot = done + int(np.argmax(np.abs(rows[done:, column])))
        if abs(rows[pivot, column]) <= ROUNDING:
            continue
        rows[[done, pivot]] = rows[[pivot, done]]
        rows[done] /= rows[done, column]
        others = np.arange(len(rows)) != done
        rows[others] -= rows[others, column, None] * rows[done]
        done += 1
    return rows


def _in_words(row: Float[np.ndarray, " n"], names: Sequence[str]) -> str:
    words, largest = "", np.max(np.abs(row))
    for value, name in zip(row, names, strict=True):
        if abs(value) <= ROUNDING * largest:
            continue
        size = "" if abs(abs(value) - 1) < ROUNDING else f"{abs(value):.4g} "
        sign = ("−" if value < 0 else "") if not words else (" − " if value < 0 else " + ")
        words += f"{sign}{size}{name}"
    return words
