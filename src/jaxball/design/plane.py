"""Positions in the plane: two numbers each, and one for a disk, which rolls along e1."""

from collections.abc import Callable, Mapping

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..numerics.arrays import Numbers, require_shape, to_array
from ..physics.body import Disk
from ..physics.system import AbstractSystem
from .errors import DesignError

# A deviation from e1 smaller than this fraction of the extent is rounding.
ROUNDING = 1e-9


class Requirement(eqx.Module):
    """A requirement on a motion: an objective or a constraint."""

    def beyond_a_disk(self) -> str:
        """What it requires that a disk, which rolls along e1 and turns about e2, cannot do; empty if nothing."""
        return ""


Converter = Callable[[Numbers], Float[Array, "..."]]


def place(name: str) -> Converter:
    """The converter of a field ``name`` to a position in the plane; a single number z is (z, 0)."""

    def convert(x: Numbers) -> Float[Array, "..."]:
        z = to_array(x, name)
        z = z if z.ndim else jnp.stack([z, jnp.zeros_like(z)])
        require_shape(name, z, (2,))
        return z

    return convert


def places(name: str) -> Converter:
    """The converter of a field ``name`` to positions in the plane, a row each; single numbers z are (z, 0)."""

    def convert(x: Numbers) -> Float[Array, "..."]:
        z = to_array(x, name)
        z = jnp.stack([z, jnp.zeros_like(z)], axis=1) if z.ndim == 1 else z
        require_shape(name, z, ("n", 2))
        return z

    return convert


def corner(name: str) -> Converter:
    """The converter of a field ``name`` to a bound of positions: two numbers, or one for a disk."""

    def convert(x: Numbers) -> Float[Array, "..."]:
        z = jnp.atleast_1d(to_array(x, name))
        require_shape(name, z, (1,) if z.size == 1 else (2,))
        return z

    return convert


def beside(points: Float[ArrayLike, "n 2"]) -> str:
    """Reports positions off e1, for :meth:`Requirement.beyond_a_disk`."""
    points = np.abs(np.asarray(points))
    most = np.max(points[:, 1], initial=0.0)
    return f"a position {most:.6g} off e1" if most > ROUNDING * np.max(points, initial=0.0) else ""


def require_reach(system: AbstractSystem, requirements: Mapping[str, Requirement]) -> None:
    """Refuses objectives and constraints that no disk can meet.

    **Raises:** :class:`DesignError`, with the name of the first one, where the system is a disk.
    """
    for name, requirement in requirements.items() if isinstance(system, Disk) else ():
        beyond = requirement.beyond_a_disk()
        if beyond:
            raise DesignError(
                f"`{name}` must be within reach of a disk, which rolls along e1 and turns about e2, but it requires "
                f"{beyond}; give positions as single numbers, or use a ball."
            )
