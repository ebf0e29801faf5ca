"""Weights that users give regulators, of deviations and of inputs: matrices from numbers, rows, or numbers by name."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..interface.arguments import require
from ..interface.compat import is_traced
from ..interface.wording import did_you_mean
from ..numerics.arrays import AnyArray, Numbers, to_numpy

Weights = Numbers | Mapping[str, Numbers]
ROUNDING = 1e-10  # of the largest eigenvalue, by which one may be negative


def weight_matrix(name: str, weights: Weights, names: Sequence[str]) -> Float[AnyArray, "n n"]:
    """Returns the symmetric matrix of weights for these ``names``.

    ``weights`` is one number for all, a row of numbers, a matrix, or a dictionary of numbers by name, where ``"z"``
    stands for ``"z[0]"`` and ``"z[1]"`` and what is not named has weight 0.

    **Raises:** ``TypeError`` for anything else, ``ValueError`` for another shape, unknown names, and a matrix that is
    not symmetric or has a negative eigenvalue; of numbers that are traced only the shape is known.
    """
    n = len(names)
    if isinstance(weights, Mapping):
        weights = by_name(name, weights, names)
    values: Any = weights if is_traced(weights) else to_numpy(weights, name)
    xp = jnp if is_traced(values) else np
    if values.ndim == 0:
        values = xp.broadcast_to(values, (n,))
    matrix = xp.diag(values) if values.ndim == 1 else values
    if matrix.shape != (n, n):
        raise ValueError(
            f"Argument `{name}` must be a number, {n} numbers or a matrix of shape ({n}, {n}), for {', '.join(names)}, "
            f"but its shape is {np.shape(weights)}."
        )
    if is_traced(matrix):
        return matrix
    # Relative to the largest entry, as users' numbers may be of any size.
    if not np.all(np.isfinite(matrix)) or np.any(np.abs(matrix - matrix.T) > ROUNDING * np.max(np.abs(matrix))):
        raise ValueError(f"Argument `{name}` must be a finite, symmetric matrix, but it is {matrix.tolist()}.")
    require_positive(name, matrix)
    return matrix


def require_positive(name: str, matrix: Float[AnyArray, "n n"], strictly: bool = False) -> None:
    """Raises a ``ValueError`` for a symmetric matrix with a negative eigenvalue, or ``strictly``, one of 0."""
    eigenvalues = np.linalg.eigvalsh(matrix)
    least, largest = float(eigenvalues[0]), float(np.max(np.abs(eigenvalues)))
    if least < -ROUNDING * largest or (strictly and least <= ROUNDING * largest):
        must = "positive" if strictly else "0 or positive"
        raise ValueError(f"Argument `{name}` must have eigenvalues that are {must}, but one is {least:.6g}.")


def factor(matrix: Float[AnyArray, "n n"]) -> Float[AnyArray, "n n"]:
    """Finds a W with WᵀW = matrix, for a symmetric matrix without negative eigenvalues, which may be singular."""
    if is_traced(matrix):
        return _by_cholesky(jnp.asarray(matrix))
    eigenvalues, vectors = np.linalg.eigh(matrix)
    # Rounding makes eigenvalues of 0 slightly negative.
    return np.sqrt(np.maximum(eigenvalues, 0.0))[:, None] * vectors.T


def _by_cholesky(matrix: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Finds a W with WᵀW = matrix by Cholesky's recursion, whose derivatives are finite also where pivots are 0 and
    eigenvalues equal.
    """
    rows, rest = [], matrix
    for k in range(len(matrix)):
        pivot = rest[k, k]
        # A pivot of rounding would divide by almost 0; its row is 0 instead.
        is_positive = pivot > ROUNDING * matrix[k, k]
        row = jnp.where(is_positive, rest[k] / jnp.sqrt(jnp.where(is_positive, pivot, 1.0)), 0.0)
        rows.append(row)
        rest = rest - row[:, None] * row[None]
    return jnp.stack(rows)


def by_name(name: str, given: Mapping[str, Any], names: Sequence[str], other: float = 0.0) -> Float[AnyArray, " n"]:
    """Returns a number for each of ``names``, from a dictionary in which ``"z"`` stands for ``"z[0]"`` and ``"z[1]"``.

    What is not named is ``other``.

    **Raises:** ``TypeError`` for anything but a dictionary, ``ValueError`` for an unknown name and for NaN.
    """
    require(name, given, Mapping, 'a dictionary of numbers by name, such as {"z": 0.1}')
    values: list[Any] = [other] * len(names)
    for key, places in places_by_name(name, given, names).items():
        number = given[key] if is_traced(given[key]) else float(to_numpy(given[key], f"{name}[{key!r}]"))
        if not is_traced(number) and np.isnan(number):
            raise ValueError(f"Argument `{name}[{key!r}]` must be a number, but it is nan.")
        for place in places:
            values[place] = number
    return (jnp if any(map(is_traced, values)) else np).asarray(values)


def places_by_name(name: str, keys: Iterable[str], names: Sequence[str]) -> dict[str, list[int]]:
    """Returns the places in ``names`` that each key stands for: its own, or those of a group, ``"z"`` for ``"z[0]"``
    and ``"z[1]"``.

    **Raises:** ``ValueError`` for an unknown key of the argument ``name``.
    """
    # A group has entries such as "z[0]"; a name such as "mechanisms[0].joints[0]" is of a single coordinate.
    groups = [entry.partition("[")[0] if entry.count("[") == 1 and "." not in entry else entry for entry in names]
    known = list(dict.fromkeys([*groups, *names]))
    for key in keys:
        if key not in known:
            there = did_you_mean(key, known, f"the names are {', '.join(known)}")
            raise ValueError(f"Argument `{name}` must have names as keys, but one is {key!r}{there}")
    return {key: [k for k, pair in enumerate(zip(groups, names, strict=True)) if key in pair] for key in keys}
