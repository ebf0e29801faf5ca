"""A body that may slip or fly, as a filter estimates it and carries it on from sample to sample.

Its covariance is carried through slips and impacts by the derivative of the run, which has the saltation matrices of
events in it (N. J. Kong, J. J. Payne, G. Council & A. M. Johnson, *The salted Kalman filter: Kalman filtering on hybrid
dynamical systems*, Automatica 131, 2021).
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import diffrax
import jax
from jaxtyping import Array, Float

from ..physics.body import System
from ..physics.contact.law import Contact
from ..physics.contact.slipping import Estimated, SlippingState
from ..physics.state import PlacedState
from ..simulation.arguments import system_to_solve
from .sampled import SampledSystem, columns_at_0


def with_law(sampled: SampledSystem, contact: Contact | None) -> SampledSystem:
    """Returns the sampled system of a body with a law of contact; None for one that rolls.

    **Raises:** ``TypeError`` and ``ValueError`` for what is no law, and for one that the body has no equations for.
    """
    if contact is not None:
        system_to_solve(sampled.system, contact)
    return dataclasses.replace(sampled, contact=contact)


def body_of(state: Estimated) -> PlacedState:
    """Returns the state of the body in an estimated one."""
    return state.body if isinstance(state, SlippingState) else state


def of_rolling(sampled: SampledSystem, state: Any) -> Estimated:
    """Returns the estimated state of a body that rolls."""
    return state if sampled.contact is None else SlippingState.rolling(state)


def estimated(sampled: SampledSystem, system: System, t: Float[Array, ""], state: Any) -> Estimated:
    """Returns what a filter estimates of what a sample begins or ends with: with a law of contact a slipping state."""
    return state if sampled.contact is None else SlippingState.in_mode(system.prepare(), t, state)


def moving(sampled: SampledSystem, system: System, t: Float[Array, ""], state: Estimated) -> Callable[[Any], Any]:
    """Returns a function of estimated states near ``state``: what sensors read, with a law of contact in the mode that
    follows from that one.
    """
    if not isinstance(state, SlippingState):
        return lambda near: near
    prepared = system.prepare()
    in_mode = jax.lax.stop_gradient(sampled.begin(system, t, state.released(prepared, t)))
    return lambda near: in_mode.move(near.released(prepared, t))


def follow(
    sampled: SampledSystem, t: Float[Array, ""], state: Estimated, u: Float[Array, " m"]
) -> tuple[Estimated, Float[Array, "n n"]]:
    """Computes the estimated state a sample after ``t`` from one then, and its derivative in local coordinates."""
    system = sampled.hold(u)

    def displaced(xi: Float[Array, " n"]) -> tuple[Float[Array, " n"], Any]:
        start: Any = state.retract(xi)
        if isinstance(start, SlippingState):
            start = start.released(system.prepare(), t)
        end = sampled.flow(t, start, u, diffrax.ForwardMode())
        after = estimated(sampled, system, t + sampled.sample, end)
        return jax.lax.stop_gradient(after).difference(after), after

    (_, after), (columns, _) = columns_at_0(displaced, len(state.directions), sampled.sample.dtype)
    return after, columns
