"""Lyapunov exponents of a rolling body, a classical system or any flow, by the tangent dynamics.

Users and ``jaxball chaos`` call ``lyapunov_spectrum``; ``lyapunov_spectrum_of`` takes any flow, and ``chart`` maps
``system_spectrum`` over its cells.
"""

import functools
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from ... import programs
from ...interface.arguments import refusal, require_callable, traceable
from ...interface.status import Status
from ...numerics.arrays import Numbers, numbers, to_array, to_numpy
from ...physics.contact.law import Contact
from ...physics.contact.released import ReleasedState
from ...physics.packing import Packing
from ...physics.system import AbstractState, AbstractSystem
from ...physics.validity import possible_start
from ...simulation import DEFAULT_TOLERANCE
from ...simulation.arguments import check_solver, check_steps, check_tolerances
from ...simulation.deviations import (
    FIRST_STEP_SHARE,
    Field,
    Flow,
    Normal,
    Steps,
    admissible,
    count_of_constraints,
    generic_vectors,
)
from ...simulation.deviations_with_modes import FlowWithModes, dimension, normal_of, point_of_run
from .result import LyapunovSpectrum

BATCHES = 16  # means of the growth rates from which the standard error is estimated


def lyapunov_spectrum(
    system: AbstractSystem,
    times: Numbers,
    state: AbstractState | ReleasedState | None = None,
    *,
    contact: Contact | None = None,
    exponents: int | None = None,
    transient: float = 0.0,
    interval: float = 1.0,
    solver: diffrax.AbstractAdaptiveSolver | None = None,
    rtol: Numbers = DEFAULT_TOLERANCE,
    atol: Numbers = DEFAULT_TOLERANCE,
    max_steps: int = 16384,
) -> LyapunovSpectrum:
    """Computes the Lyapunov exponents of the motion of ``system`` from ``times[0]`` to ``times[1]``, in 1/time.

    The phase space is that of (Ω, Γ) with |Γ| = 1 (``uncon_ball_eqns_explicit``), of dimension 5; each mass that a
    feedback law drives, and each joint without a schedule, adds its θ and θ̇. Position and heading follow by
    integration and would add zeros. Where a force acts or the ground is tilted or moves, which (Ω, Γ) cannot express,
    it is the phase space of (q, Ω, z) with |q| = 1, of dimension 8. For a disk it is that of (φ, φ̇, z), and for a
    classical system that of its own state. Time adds no exponent, because prescribed motions are not part of the state.

    Of a system with constraints, such as a :class:`~jaxball.physics.classical.LagrangianSystem`, deviations are those
    that the constraints admit: each constraint of velocities takes away one exponent, each holonomic one two.

    Of a system with modes, each interval is a run, and its derivative, through all events, takes the place of the
    variational equations (``simulation.deviations_with_modes``). The phase space is then that of place and motion in
    any mode: (q, Ω, z), and with a law of contact also V and the height. What a mode holds loses its deviations,
    whose exponent is −∞, as is that of all that fall below 1e-12 of their size in an interval.

    Deviations of Γ are tangent to the sphere: Γ̇ = Γ × Ω keeps Γ·δΓ = 0, and rounding is removed after each interval.
    The solver's vector contains the locked angular velocity W instead of Ω (module ``locked``); the exponents are the
    same, because the change from one to the other is smooth and bounded.

    **Arguments:**

    - ``system``: a body, or a system of :mod:`jaxball.physics.classical`.
    - ``times``: the start and the end.
    - ``state``: the state at the start, of any kind; at rest and upright if not given.
    - ``contact``: a :class:`~jaxball.Contact`, as for :func:`jaxball.simulate`.
    - ``exponents``, ``transient``, ``interval``, ``solver``, ``rtol``, ``atol``, ``max_steps``: as for
      :func:`lyapunov_spectrum_of`. Only the largest exponent, with ``exponents=1``, takes half of the time.

    **Raises:** ``ValueError`` for invalid times, numbers of exponents or intervals, ``TypeError`` for a state of
    another kind of system, and :class:`~jaxball.simulation.PrecisionError` when float32 cannot reach the tolerances.
    """
    edges, skipped = interval_edges(times, transient, interval)
    system, point = point_of_run(system, state, contact, to_array(edges[0]))
    exponents = check_count(exponents, dimension(point) - count_of_constraints(system.shown))
    rtol, atol = map(to_array, check_tolerances(rtol, atol))
    steps = Steps(check_solver(solver), rtol, atol, check_steps(max_steps))
    method = Method(steps, exponents, skipped, normal_of(point))
    return _solve_system(method, system, point, to_array(edges))


def lyapunov_spectrum_of(
    field: Field,
    times: Numbers,
    x: Numbers,
    args: Any = None,
    *,
    exponents: int | None = None,
    transient: float = 0.0,
    interval: float = 1.0,
    solver: diffrax.AbstractAdaptiveSolver | None = None,
    rtol: Numbers = DEFAULT_TOLERANCE,
    atol: Numbers = DEFAULT_TOLERANCE,
    kinks: Numbers = (),
    normal: Normal | None = None,
    max_steps: int = 16384,
) -> LyapunovSpectrum:
    """Computes the Lyapunov exponents of ẋ = f(t, x) along the solution that starts at ``x``.

    The deviations δẋ = f′(t, x) δx are advanced with x, under the same control of the step, and made orthonormal
    again after each interval; an exponent is the mean of log(length before) / interval (Benettin et al. 1980;
    Shimada & Nagashima 1979). Time is not part of the state, so a time-dependent f(t, x) adds no zero exponent.

    **Arguments:**

    - ``field``: f(t, x, args), from x of shape (size,) to its rate.
    - ``times``: the start and the end.
    - ``x``: the state at the start, shape (size,).
    - ``args``: any arrays that f needs. Changing them compiles nothing again.
    - ``exponents``: how many of the largest exponents to compute; by default all.
    - ``transient``: the time from the start before averaging begins, while x approaches its attractor and the vectors
      align with their directions.
    - ``interval``: the time between two orthonormalisations; shortened so that a whole number fits. Deviations must
      not grow by more than about 1e6 in it.
    - ``solver``, ``rtol``, ``atol``: as for :func:`jaxball.simulate`. A step keeps x and each deviation to the
      tolerances.
    - ``kinks``: times at which f jumps or has a kink, where the solver ends steps.
    - ``normal``: where x stays on a surface, the surface's normal at x. Deviations are tangent to it, so there is one
      exponent fewer. Rounding along the normal is removed after each interval; the flow must preserve the surface.
    - ``max_steps``: the most steps in an interval.

    **Raises:** ``ValueError`` for invalid times, numbers of exponents or intervals, and
    :class:`~jaxball.simulation.PrecisionError` when float32 cannot reach the tolerances.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.analysis.chaos import lyapunov_spectrum_of
    >>> def saddle(t, x, args):
    ...     return jnp.stack([0.5 * x[0], -x[1]])
    >>> spectrum = lyapunov_spectrum_of(saddle, (0.0, 40.0), (0.0, 0.0), transient=20.0)
    >>> print(spectrum.exponents.round(6))
    [ 0.5 -1. ]
    """
    require_callable("field", field, "t", "x", "args")
    x = numbers("x", ("size",))(x)
    # The direction of the normal is no deviation.
    exponents = check_count(exponents, x.size - (normal is not None))
    edges, skipped = interval_edges(times, transient, interval)
    rtol, atol = map(to_array, check_tolerances(rtol, atol))
    method = Method(Steps(check_solver(solver), rtol, atol, check_steps(max_steps)), exponents, skipped, normal)
    with traceable("field", field):
        return _solve(method, Flow(field, args, to_array(kinks, "kinks")), x, to_array(edges), jnp.asarray(True))


class Method(NamedTuple):
    """How a spectrum is computed; the first ``skipped`` intervals are transient."""

    steps: Steps
    exponents: int
    skipped: int
    normal: Normal | None


def check_count(exponents: int | None, largest: int) -> int:
    """Checks how many exponents; by default all.

    **Raises:** ``ValueError`` when the phase space has fewer.
    """
    if exponents is None:
        return largest
    if isinstance(exponents, bool) or not isinstance(exponents, int | np.integer):
        raise refusal("exponents", "a whole number or None", exponents)
    if not 1 <= exponents <= largest:
        raise ValueError(
            f"Argument `exponents` must be from 1 to {largest}, the dimension of the phase space, but it is "
            f"{exponents}."
        )
    return exponents


def interval_edges(times: Numbers, transient: float, interval: float) -> tuple[np.ndarray, int]:
    """Returns the times at which vectors are made orthonormal, the start first, and how many intervals are transient.

    **Raises:** ``ValueError`` for invalid times or intervals.
    """
    ends = to_numpy(times, "times")
    if ends.shape != (2,) or not np.all(np.isfinite(ends)) or ends[1] <= ends[0]:
        raise ValueError(f"Argument `times` must be the start and a later end, but it is {ends.tolist()}.")
    start, end = float(ends[0]), float(ends[1])
    if not interval > 0:
        raise ValueError(f"Argument `interval` must be a positive time, but it is {interval:g}.")
    if not 0 <= transient < end - start:
        raise ValueError(
            f"Argument `transient` must be from 0 to less than the length of the run, {end - start:g}, but it is "
            f"{transient:g}."
        )
    skipped = _count(transient, interval)
    averaged = _count(end - start - transient, interval)
    before = np.linspace(start, start + transient, skipped + 1)[:-1]
    return np.concatenate([before, np.linspace(start + transient, end, averaged + 1)]), skipped


def _count(length: float, interval: float) -> int:
    # A little less, so that rounding does not add an interval to a length that is a multiple.
    return int(np.ceil(length / interval * (1 - 1e-9)))


def spectrum(
    method: Method,
    flow: Flow | FlowWithModes,
    x: Float[Array, " size"],
    edges: Float[Array, " edges"],
    startable: Bool[Array, ""],
) -> LyapunovSpectrum:
    """Computes the spectrum, traceable, from ``x`` at the first of ``edges``, which bound the intervals.

    ``startable`` is False if the solve cannot start.
    """
    startable &= jnp.all(jnp.isfinite(x))
    # Finite even where nothing is solved: step-size control rejects NaN.
    x = jnp.where(startable, x, jnp.ones_like(x))
    first = _start(method, flow, x, edges, startable)
    end, growth = jax.lax.scan(functools.partial(_interval, method, flow), first, (edges[:-1], edges[1:]))
    return _result(method, flow, edges, end, growth)


_solve = programs.filter_jit(spectrum)


def system_spectrum(
    method: Method, system: AbstractSystem, state: Any, edges: Float[Array, " edges"]
) -> LyapunovSpectrum:
    """Computes the spectrum of a system, traceable; ``state`` is a phase point and ``method.normal`` belongs to it."""
    if system.is_hybrid:  # a run says itself whether it can start
        return spectrum(method, FlowWithModes.of(system, state), ravel_pytree(state)[0], edges, jnp.asarray(True))
    packing = Packing.of(system.prepare(), state)
    x, startable = packing.pack(edges[0], state), possible_start(system, packing.system, edges, state)
    return spectrum(method, Flow.of(system, packing), x, edges, startable)


_solve_system = programs.filter_jit(system_spectrum)


class _Progress(NamedTuple):
    """What one interval passes to the next."""

    rows: Float[Array, "rows size"]  # x and the deviations
    step: Float[Array, ""]  # a good length for the first step
    status: Int[Array, ""]
    reached: Float[Array, ""]
    steps: Int[Array, ""]
    least: Float[Array, ""]


def _start(
    method: Method,
    flow: Flow | FlowWithModes,
    x: Float[Array, " size"],
    edges: Float[Array, " edges"],
    startable: Bool[Array, ""],
) -> _Progress:
    # Generic, so that none of them lacks the fastest direction.
    generic = jnp.asarray(generic_vectors(method.exponents, x.size), x.dtype)
    status = jnp.where(startable, Status.SUCCESS, Status.IMPOSSIBLE)
    return _Progress(
        # Admissible first: a deviation across the constraints is not one of the flow.
        rows=jnp.concatenate([x[None], flow.orthonormalise(admissible(generic, edges[0], x, method.normal, flow))[0]]),
        step=FIRST_STEP_SHARE * (edges[1] - edges[0]),
        status=status,
        reached=edges[0],
        steps=jnp.zeros_like(status),
        least=flow.monitor_value(edges[0], x),
    )


def _interval(
    method: Method, flow: Flow | FlowWithModes, progress: _Progress, ends
) -> tuple[_Progress, Float[Array, " k"]]:
    """Returns the progress after one interval, and the growth rates within it; after a failure nothing moves."""
    (t0, t1), alive = ends, progress.status == Status.SUCCESS
    after, length = flow.advance(method.steps, t0, t1, progress.rows, progress.step, alive), t1 - t0
    # The lengths are those before the vectors were made orthonormal: growth within this interval alone.
    vectors, lengths = flow.orthonormalise(admissible(after.rows[1:], t1, after.rows[0], method.normal, flow))
    status = jnp.where(alive, after.status, progress.status)
    after = _Progress(
        # A failed run stays at 1 from there on, because step-size control rejects NaN.
        rows=jnp.where(status == Status.SUCCESS, jnp.concatenate([after.rows[:1], vectors]), 1.0),
        # The mean step of this interval starts the next, which saves the solver the search for one.
        step=length / jnp.maximum(after.accepted, 1).astype(length.dtype),
        status=status,
        reached=jnp.where(alive, after.reached, progress.reached),
        steps=progress.steps + jnp.where(alive, after.steps, 0),
        least=jnp.where(alive, jnp.minimum(progress.least, after.least), progress.least),
    )
    return after, jnp.where(status == Status.SUCCESS, jnp.log(lengths) / length, jnp.nan)


def _result(
    method: Method,
    flow: Flow | FlowWithModes,
    edges: Float[Array, " edges"],
    end: _Progress,
    growth: Float[Array, "intervals k"],
) -> LyapunovSpectrum:
    """Returns the spectrum: the means of the growth rates after the transient, in descending order.

    The orthonormalisation yields them in this order once they have converged, but equal ones, or those of a short run,
    in any order.
    """
    # Rates within the transient are those of vectors that still turn to their directions.
    times, growth = edges[1 + method.skipped :], growth[method.skipped :]
    order = jnp.argsort(-jnp.mean(growth, axis=0))
    growth = growth[:, order]
    running = jnp.cumsum(growth, axis=0) / jnp.arange(1, len(times) + 1, dtype=growth.dtype)[:, None]
    rows, error = jnp.where(end.status == Status.SUCCESS, end.rows, jnp.nan), _standard_error(growth)
    if isinstance(flow, FlowWithModes):  # where deviations are lost, their rates have no scatter
        error = jnp.where(jnp.isneginf(running[-1]), 0.0, error)
    return LyapunovSpectrum(
        exponents=running[-1],
        standard_error=error,
        times=times,
        rates=growth,
        running=running,
        x=rows[0],
        vectors=rows[1:][order],
        status=end.status,
        reached=end.reached,
        steps=end.steps,
        start=edges[0],
        solve_error=_compute_solve_error(method.steps, end, edges[0]),
        least_normal_force=None if flow.monitor is None else end.least,
    )


def _compute_solve_error(steps: Steps, end: _Progress, start: Float[Array, ""]) -> Float[Array, ""]:
    """Computes by how much errors as large as the tolerances, all of one sign, change the mean of a growth rate."""
    return (steps.rtol + steps.atol) * end.steps.astype(start.dtype) / (end.reached - start)


def _standard_error(rates: Float[Array, "n k"]) -> Float[Array, " k"]:
    """Computes standard errors of the means of ``rates``, by parts of the run, because successive rates are
    correlated.
    """
    parts = min(BATCHES, rates.shape[0])
    if parts < 2:
        return jnp.full_like(rates[0], jnp.nan)
    # All of the run, whose mean it is, so that some parts have an interval more than others.
    ends = rates.shape[0] * np.arange(parts + 1) // parts
    sums = jnp.concatenate([jnp.zeros_like(rates[:1]), jnp.cumsum(rates, axis=0)])[ends]
    means = jnp.diff(sums, axis=0) / jnp.asarray(np.diff(ends), rates.dtype)[:, None]
    return jnp.std(means, axis=0, ddof=1) / jnp.sqrt(jnp.asarray(parts, rates.dtype))
