"""Lyapunov exponents of a rolling ball or disk."""

import diffrax
import equinox as eqx
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, ArrayLike, Float

from .._arrays import Numbers, to_array
from ..body import System
from ..dynamics import field_of
from ..packing import Packing
from ..simulation import DEFAULT_SOLVER, DEFAULT_TOLERANCE, at_rest
from ..state import BallState, DiskState, ReducedState, RotationState, State
from ..validity import possible, possible_state
from .spectrum import LyapunovSpectrum, Method, checked_count, interval_edges, spectrum
from .tangent import Normal


def lyapunov_spectrum(
    system: System,
    times: Numbers,
    state: State | None = None,
    *,
    exponents: int | None = None,
    transient: float = 0.0,
    interval: float = 1.0,
    solver: diffrax.AbstractAdaptiveSolver | None = None,
    rtol: ArrayLike = DEFAULT_TOLERANCE,
    atol: ArrayLike = DEFAULT_TOLERANCE,
    max_steps: int = 16384,
) -> LyapunovSpectrum:
    """The Lyapunov exponents of the motion of ``system`` from ``times[0]`` to ``times[1]``, in 1/time.

    The phase space is that of (Ω, Γ) with |Γ| = 1 (``uncon_ball_eqns_explicit``), of dimension 5; each mass that a
    feedback law drives adds its θ and θ̇. Place and heading follow by integration and would add zeros. Where a force
    acts, which (Ω, Γ) cannot express, the phase space is that of (q, Ω, z) with |q| = 1, of dimension 8. For a disk
    it is that of (φ, φ̇, z). Time adds no exponent, because the motion of the masses is prescribed.

    Deviations of Γ are tangent to the sphere: Γ̇ = Γ × Ω keeps Γ·δΓ = 0, and rounding is removed after each interval.
    The vector that is advanced holds the locked angular velocity W for Ω (module ``locked``); the exponents are those
    of Ω, because the change from one to the other is smooth and bounded.

    **Arguments:**

    - ``times``: the start and the end.
    - ``state``: the state at the start, of any kind; at rest and upright if not given.
    - all others: as for :func:`lyapunov_spectrum_of`. With ``exponents=1`` the largest alone takes a third of the time.

    **Raises:** ``ValueError`` for times, numbers of exponents or intervals that cannot be, and ``TypeError`` for a
    state of another kind of system.
    """
    state = phase_point(system, at_rest(system) if state is None else state)
    edges, skipped = interval_edges(times, transient, interval)
    exponents = checked_count(exponents, dimension(state))
    method = Method(DEFAULT_SOLVER if solver is None else solver, exponents, skipped, max_steps, normal_of(state))
    return _solve(method, system, state, to_array(edges), to_array(rtol), to_array(atol))


def phase_point(system: System, state: State) -> State:
    """``state`` without place and heading, where the motion does not depend on them."""
    field_of(system, state)
    if isinstance(state, BallState | RotationState) and system.force is None:
        return ReducedState(state.Omega, state.Gamma, state.theta, state.thetadot)
    return state.in_space() if isinstance(state, RotationState) else state


def dimension(state: State) -> int:
    """The dimension of the phase space."""
    return ravel_pytree(state)[0].size - (not isinstance(state, DiskState))


@eqx.filter_jit
def _solve(method: Method, system: System, state: State, edges, rtol, atol) -> LyapunovSpectrum:
    return rolling_spectrum(method, system, state, edges, rtol, atol)


def rolling_spectrum(
    method: Method,
    system: System,
    state: State,
    edges: Float[Array, " edges"],
    rtol: Float[Array, ""],
    atol: Float[Array, ""],
) -> LyapunovSpectrum:
    """The spectrum of a rolling body, traceable; ``state`` is a phase point and ``method.normal`` belongs to it."""
    packing = Packing.of(system.prepare(), state)
    parameters, unpack_parameters = ravel_pytree(packing)
    kinks = jnp.concatenate([system.motion_kinks(), system.driving_kinks()])
    return spectrum(
        method,
        lambda t, x, parameters: unpack_parameters(parameters).field(t, x),
        edges,
        packing.pack(edges[0], state),
        parameters,
        rtol,
        atol,
        kinks,
        possible(system) & possible_state(state),
    )


def normal_of(state: State) -> Normal | None:
    """The normal of the sphere on which Γ or q stays; None for a disk, which has neither."""
    return {ReducedState: _along_Gamma, BallState: _along_q}.get(type(state))


def _along_Gamma(x: Float[Array, " size"]) -> Float[Array, " size"]:
    return jnp.zeros_like(x).at[3:6].set(x[3:6])


def _along_q(x: Float[Array, " size"]) -> Float[Array, " size"]:
    return jnp.zeros_like(x).at[:4].set(x[:4])
