"""The phase space of a system: the part of its state that the motion depends on."""

import functools
from collections.abc import Callable
from typing import overload

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from .body import System
from .state import State
from .system import AbstractState, AbstractSystem, require_state

Normal = Callable[[Float[Array, " size"]], Float[Array, " size"]]


@overload
def phase_point(system: System, state: State) -> State: ...


@overload
def phase_point(system: AbstractSystem, state: AbstractState) -> AbstractState: ...


def phase_point(system: AbstractSystem, state: AbstractState) -> AbstractState:
    """``state`` as a point of the phase space: for a ball (Ω, Γ), unless a force acts, which they cannot express.

    **Raises:** ``TypeError`` when the system has no state of that kind, and for a hybrid one, whose motion jumps.
    """
    require_state(system, state)
    if system.is_hybrid:
        raise TypeError(
            f"Argument `system` must be smooth, because deviations from its motion are followed along its field, but "
            f"a {type(system).__name__} has guards or time events; derivatives of a run of jaxball.simulate go through "
            "its events."
        )
    return system.phase_point(state)


def dimension(state: AbstractState) -> int:
    """The dimension of the phase space, where a unit vector counts one less than its number of components."""
    return ravel_pytree(state)[0].size - (state.unit_vector is not None)


def normal_of(state: AbstractState) -> Normal | None:
    """The normal, at a packed state, of the sphere on which its unit vector stays; None where it has none."""
    if state.unit_vector is None:
        return None
    before = 0
    for path, leaf in jax.tree_util.tree_leaves_with_path(state):
        if jax.tree_util.keystr(path) == f".{state.unit_vector}":
            return _along(before, before + np.size(leaf))
        before += np.size(leaf)
    return None


@functools.cache
def _along(start: int, end: int) -> Normal:
    """One function for all states of a kind, so that programs made for it are found again."""

    def along(x: Float[Array, " size"]) -> Float[Array, " size"]:
        return jnp.zeros_like(x).at[start:end].set(x[start:end])

    return along
