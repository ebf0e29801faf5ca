"""The parameters of rows of one structure, as elements: those that all rows share, and those that differ."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..numerics.lanes import LaneProgram


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


def axes(tree: Any, shared: Sequence[bool]) -> Any:
    """The axes of rows in the leaves, in the form for ``jax.vmap``."""
    return jax.tree.unflatten(jax.tree.structure(tree), [None if one else 0 for one in shared])


def single(tree: Any, shared: Sequence[bool]) -> Any:
    """Zeros in the form of a single row."""
    leaves, structure = jax.tree.flatten(tree)
    shapes = [leaf.shape if one else leaf.shape[1:] for leaf, one in zip(leaves, shared, strict=True)]
    return structure.unflatten([np.zeros(s, leaf.dtype) for s, leaf in zip(shapes, leaves, strict=True)])


def for_all_rows(tree: Any, shared: Sequence[bool], rows: int, namespace: Any) -> Any:
    """A PyTree in which every leaf has the rows as leading axis; with NumPy for ``namespace``, without copies."""
    leaves, structure = jax.tree.flatten(tree)
    whole = [namespace.broadcast_to(x, (rows, *x.shape)) if one else x for x, one in zip(leaves, shared, strict=True)]
    return structure.unflatten(whole)


class Prepared(NamedTuple):
    """What a program needs of the parameters: the elements that rows have of their own, and those that they share."""

    program: LaneProgram
    own: Float[Array, "numbers rows"]
    shared: tuple[Any, ...]  # of an element that is one of ``own``, its dtype

    @classmethod
    def of(
        cls,
        function: Callable[..., Any],
        like: Any,
        system: Any,
        shared: Sequence[bool],
        x: Float[Array, "rows size"],
        others: int = 0,
    ) -> "Prepared":
        """For ``function(system, t, x)`` of a system in the form of ``like``, from the systems of all rows.

        ``others`` is how many more numbers it is given.
        """
        rows, number, vector = len(x), np.zeros((), x.dtype), np.zeros(x.shape[1:], x.dtype)
        program, elements = LaneProgram(function, like, number, vector, *[number] * others), []
        for leaf, one in zip(jax.tree.leaves(system), shared, strict=True):
            elements += list(leaf.reshape(-1)) if one else list(leaf.reshape(rows, -1).T)
        prepared = program.prepare(elements)
        own = [item for item in prepared if jnp.ndim(item)]
        return cls(
            program,
            jnp.stack([item.astype(x.dtype) for item in own]) if own else jnp.zeros((0, rows), x.dtype),
            tuple(item.dtype if jnp.ndim(item) else item for item in prepared),
        )

    def __call__(self, own: Sequence[Array] | Array, *changing: Array) -> Float[Array, "size lanes"]:
        """The program's results in lanes whose own elements are ``own``."""
        following = iter(own)
        elements = [next(following).astype(item) if isinstance(item, np.dtype) else item for item in self.shared]
        numbers = [row for x in changing for row in (x if x.ndim > 1 else x[None])]
        return self.program(elements, numbers)
