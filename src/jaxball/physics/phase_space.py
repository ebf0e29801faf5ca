"""The phase space of a system: what of its state the motion depends on."""

from collections.abc import Callable
from typing import overload

import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from ..classical import RigidBodyState
from .body import Ball, Disk, System
from .dynamics import field_of
from .simulable import SimulableState, SimulableSystem
from .state import BallState, ReducedState, RotationState, State

Normal = Callable[[Float[Array, " size"]], Float[Array, " size"]]


@overload
def phase_point(system: System, state: State) -> State: ...


@overload
def phase_point(system: SimulableSystem, state: SimulableState) -> SimulableState: ...


def phase_point(system: SimulableSystem, state: SimulableState) -> SimulableState:
    """``state`` as a point of the phase space: (Ω, Γ) of a ball, unless a force acts, which they cannot express.

    **Raises:** ``TypeError`` when the system has no state of that kind.
    """
    field_of(system, state)
    if isinstance(state, BallState | RotationState) and isinstance(system, Ball | Disk) and system.force is None:
        return ReducedState(state.Omega, state.Gamma, state.theta, state.thetadot)
    return state.in_space() if isinstance(state, RotationState) else state


def dimension(state: SimulableState) -> int:
    """The dimension of the phase space: a unit vector counts one less than its components."""
    return ravel_pytree(state)[0].size - (normal_of(state) is not None)


def normal_of(state: SimulableState) -> Normal | None:
    """The normal, at a packed state, of the sphere on which Γ or q stays; None where there is neither."""
    return {ReducedState: _along_Gamma, BallState: _along_q, RigidBodyState: _along_q}.get(type(state))


def _along_Gamma(x: Float[Array, " size"]) -> Float[Array, " size"]:
    return jnp.zeros_like(x).at[3:6].set(x[3:6])


def _along_q(x: Float[Array, " size"]) -> Float[Array, " size"]:
    return jnp.zeros_like(x).at[:4].set(x[:4])
