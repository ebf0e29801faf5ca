"""The phase space of a rolling body: what of its state the motion depends on."""

from collections.abc import Callable

import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from .body import System
from .dynamics import field_of
from .state import BallState, DiskState, ReducedState, RotationState, State

Normal = Callable[[Float[Array, " size"]], Float[Array, " size"]]


def phase_point(system: System, state: State) -> State:
    """``state`` as a point of the phase space: (Ω, Γ) of a ball, unless a force acts, which they cannot express.

    **Raises:** ``TypeError`` when the system has no state of that kind.
    """
    field_of(system, state)
    if isinstance(state, BallState | RotationState) and system.force is None:
        return ReducedState(state.Omega, state.Gamma, state.theta, state.thetadot)
    return state.in_space() if isinstance(state, RotationState) else state


def dimension(state: State) -> int:
    """The dimension of the phase space: a unit vector counts one less than its components."""
    return ravel_pytree(state)[0].size - (not isinstance(state, DiskState))


def normal_of(state: State) -> Normal | None:
    """The normal, at a packed state, of the sphere on which Γ or q stays; None for a disk, which has neither."""
    return {ReducedState: _along_Gamma, BallState: _along_q}.get(type(state))


def _along_Gamma(x: Float[Array, " size"]) -> Float[Array, " size"]:
    return jnp.zeros_like(x).at[3:6].set(x[3:6])


def _along_q(x: Float[Array, " size"]) -> Float[Array, " size"]:
    return jnp.zeros_like(x).at[:4].set(x[:4])
