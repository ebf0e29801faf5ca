"""The numbers of rows that share a structure, as elements: those that all rows share, and those that they do not."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .lanes import LaneProgram


def shared(leaf: Any) -> bool:
    """Whether an array is one for all rows: a NumPy array with one row, or that does not move along its first axis."""
    return isinstance(leaf, np.ndarray) and leaf.ndim > 0 and (leaf.shape[0] == 1 or leaf.strides[0] == 0)


def split(tree: Any) -> tuple[Any, tuple[bool, ...]]:
    """A PyTree of rows with what all of them share taken once, and which leaves these are."""
    leaves, structure = jax.tree.flatten(tree)
    which = tuple(map(shared, leaves))
    return structure.unflatten([leaf[0] if one else leaf for leaf, one in zip(leaves, which, strict=True)]), which


def axes(tree: Any, which: Sequence[bool]) -> Any:
    """The axes of rows in the leaves, as ``jax.vmap`` wants them."""
    return jax.tree.unflatten(jax.tree.structure(tree), [None if one else 0 for one in which])


def first(tree: Any, which: Sequence[bool]) -> Any:
    """The form of a single row."""
    leaves, structure = jax.tree.flatten(tree)
    shapes = [leaf.shape if one else leaf.shape[1:] for leaf, one in zip(leaves, which, strict=True)]
    return structure.unflatten([np.zeros(s, leaf.dtype) for s, leaf in zip(shapes, leaves, strict=True)])


class Prepared(NamedTuple):
    """What a program needs of the parameters: the elements that rows have of their own, and those that they share."""

    program: LaneProgram
    moving: Float[Array, "numbers rows"]
    fixed: tuple[Any, ...]  # None where an element is one of ``moving``

    @classmethod
    def of(cls, program: LaneProgram, tree: Any, which: Sequence[bool], rows: int) -> "Prepared":
        """From the parameters of all rows."""
        elements = []
        for leaf, one in zip(jax.tree.leaves(tree), which, strict=True):
            elements += list(leaf.reshape(-1)) if one else list(leaf.reshape(rows, -1).T)
        found = program.prepare(elements)
        moving = [item for item in found if jnp.ndim(item)]
        dtype = jax.tree.leaves(tree)[0].dtype
        return cls(
            program,
            jnp.stack(moving) if moving else jnp.zeros((0, rows), dtype),
            tuple(None if jnp.ndim(item) else item for item in found),
        )

    def __call__(self, moving: Sequence[Array] | Array, *changing: Array) -> Float[Array, "size lanes"]:
        """The program's results where the lanes have ``moving`` of their own."""
        own = iter(moving)
        elements = [next(own) if item is None else item for item in self.fixed]
        numbers = [row for x in changing for row in (x if x.ndim > 1 else x[None])]
        return self.program(elements, numbers)
