"""Lyapunov exponents of a rolling ball or disk, or of a classical system."""

import diffrax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from ..numerics import programs
from ..numerics.arrays import Numbers, to_array
from ..physics.body import AbstractBody
from ..physics.contact.reaction import reaction
from ..physics.packing import Packing
from ..physics.phase_space import dimension, normal_of, phase_point
from ..physics.system import AbstractState, AbstractSystem
from ..physics.validity import possible_start
from ..simulation.arguments import DEFAULT_TOLERANCE, checked_solver, checked_steps, checked_tolerances
from ..simulation.simulate import at_rest
from .result import LyapunovSpectrum
from .spectrum import Flow, Method, checked_count, interval_edges, spectrum


def lyapunov_spectrum(
    system: AbstractSystem,
    times: Numbers,
    state: AbstractState | None = None,
    *,
    exponents: int | None = None,
    transient: float = 0.0,
    interval: float = 1.0,
    solver: diffrax.AbstractAdaptiveSolver | None = None,
    rtol: Numbers = DEFAULT_TOLERANCE,
    atol: Numbers = DEFAULT_TOLERANCE,
    max_steps: int = 16384,
) -> LyapunovSpectrum:
    """The Lyapunov exponents of the motion of ``system`` from ``times[0]`` to ``times[1]``, in 1/time.

    The phase space is that of (Ω, Γ) with |Γ| = 1 (``uncon_ball_eqns_explicit``), of dimension 5; each mass that a
    feedback law drives, and each joint without a schedule, adds its θ and θ̇. Position and heading follow by
    integration and would add zeros. Where a force acts or the ground is tilted or moves, which (Ω, Γ) cannot express,
    it is the phase space of (q, Ω, z) with |q| = 1, of dimension 8. For a disk it is that of (φ, φ̇, z), and for a
    classical system that of its own state. Time adds no exponent, because prescribed motions are not part of the state.

    Deviations of Γ are tangent to the sphere: Γ̇ = Γ × Ω keeps Γ·δΓ = 0, and rounding is removed after each interval.
    The solver's vector contains the locked angular velocity W instead of Ω (module ``locked``); the exponents are the
    same, because the change from one to the other is smooth and bounded.

    **Arguments:**

    - ``system``: a body, or a system of :mod:`jaxball.classical`.
    - ``exponents``, ``transient``, ``interval``, ``solver``, ``rtol``, ``atol``, ``max_steps``: as for
      :func:`lyapunov_spectrum_of`.
    - ``times``: the start and the end.
    - ``state``: the state at the start, of any kind; at rest and upright if not given.
    - all others: as for :func:`lyapunov_spectrum_of`. Only the largest exponent, with ``exponents=1``, takes half of
      the time.

    **Raises:** ``ValueError`` for invalid times, numbers of exponents or intervals, ``TypeError`` for a state of
    another kind of system, and :class:`~jaxball.PrecisionError` when float32 cannot reach the tolerances.
    """
    state = phase_point(system, at_rest(system) if state is None else state)
    edges, skipped = interval_edges(times, transient, interval)
    exponents = checked_count(exponents, dimension(state))
    rtol, atol = map(to_array, checked_tolerances(rtol, atol))
    method = Method(checked_solver(solver), exponents, skipped, checked_steps(max_steps), rtol, atol, normal_of(state))
    return _solve(method, system, state, to_array(edges))


@programs.filter_jit
def _solve(method: Method, system: AbstractSystem, state: AbstractState, edges) -> LyapunovSpectrum:
    return system_spectrum(method, system, state, edges)


def system_spectrum(
    method: Method, system: AbstractSystem, state: AbstractState, edges: Float[Array, " edges"]
) -> LyapunovSpectrum:
    """The spectrum of a system, traceable; ``state`` is a phase point and ``method.normal`` belongs to it."""
    packing = Packing.of(system.prepare(), state)
    parameters, unpack_parameters = ravel_pytree(packing)
    kinks = system.kinks()

    def field(t, x, parameters):
        return unpack_parameters(parameters).field(t, x)

    def normal_force(t, x, parameters):
        inner = unpack_parameters(parameters)
        return reaction(inner.system, t, inner.unpack(t, x)).normal

    x, startable = packing.pack(edges[0], state), possible_start(system, packing.system, edges, state)
    monitor = normal_force if isinstance(system, AbstractBody) else None
    return spectrum(method, Flow(field, x, parameters, edges, kinks, startable, monitor))
