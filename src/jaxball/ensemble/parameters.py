"""The parameters of rows of one structure: those that all rows share, and those that differ."""

from collections.abc import Sequence
from typing import Any

import jax


def shared_leaves(in_axes: Any, tree: Any) -> tuple[bool, ...]:
    """Which leaves of a PyTree all rows share: those whose axis is None in ``in_axes``, which is a prefix of it.

    **Raises:** ``ValueError`` where it is none, or an axis is neither 0 nor None.
    """
    of_leaves: list[Any] = []

    def note(axis: Any, part: Any) -> None:
        of_leaves.extend([axis] * len(jax.tree.leaves(part)))

    try:
        jax.tree.map(note, in_axes, tree, is_leaf=lambda axis: axis is None)
    except ValueError:
        of_leaves = [in_axes]
    if not all(axis is None or (type(axis) is int and axis == 0) for axis in of_leaves):
        raise ValueError(
            "Argument `in_axes` must be 0 where arrays have the runs as leading axis and None where all runs share "
            "them, for all arrays, for (system, state), or in PyTrees of these structures as jax.vmap takes them, but "
            f"it is {in_axes!r}."
        )
    return tuple(axis is None for axis in of_leaves)


def for_all_rows(tree: Any, shared: Sequence[bool], rows: int, namespace: Any) -> Any:
    """A PyTree in which every leaf has the rows as leading axis; with NumPy for ``namespace``, without copies."""
    leaves, structure = jax.tree.flatten(tree)
    whole = [namespace.broadcast_to(x, (rows, *x.shape)) if one else x for x, one in zip(leaves, shared, strict=True)]
    return structure.unflatten(whole)
