"""Estimates the global error of a run, from the errors between its saved times and how each grows until later ones."""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .. import programs
from ..compat import is_traced
from ..interface.arguments import describe, require, require_callable
from ..interface.status import SUCCESSES, SolveError, Status
from ..physics.body import AbstractBody
from ..physics.contact.law import Contact
from ..physics.contact.modes import Mode
from ..physics.contact.released import ReleasedState, rolling_contact, with_rise
from ..physics.packing import ravel_state
from ..physics.system import AbstractSystem
from .arguments import PrecisionError, require_one_run
from .simulate import simulate
from .trajectory import Trajectory

Part = TypeVar("Part")

TOLERANCE_BETWEEN_TIMES = 1e-14  # of the solves from one saved time to the next
TIGHT = np.full(2, TOLERANCE_BETWEEN_TIMES)  # an array, because numbers would distinguish programs
STEPS_BETWEEN_TIMES = 2**18


def estimate_error(run: Trajectory[Any, Any], of: Callable[[Trajectory[Any, Any]], Any] | None = None) -> Any:
    """Estimates the global error of a run, or of a result computed from it: the computed value less the true one.

    From each saved state the motion is solved to the next saved time at a tolerance of 1e-14. The saved state there
    differs by a local error eₖ, and the tangent Jₖ of that solve carries the errors of all earlier intervals on,
    εₖ₊₁ = Jₖ εₖ + eₖ. For a functional of the run this is Σ λₖᵀ eₖ, with λ from the adjoint equations (D. Estep, SIAM
    Journal on Numerical Analysis 32, 1995; Y. Cao & L. Petzold, SIAM Journal on Scientific Computing 26, 2004). Carried
    forward, as R. D. Skeel describes (Numerische Mathematik 48, 1986), it is known for all functionals at once.

    The estimate needs nothing of how the run was solved. It is right to first order in the errors, as long as these are
    small against the motion, and resolves errors of about 1e-13 in each interval.

    **Arguments:**

    - ``run``: one run in float64, also as read by :func:`jaxball.load_run`; it may roll, slip, fly and stick.
    - ``of``: a function of a run to numbers, arrays or a pytree of these, such as
      ``lambda run: run.state.z[-1, 0]``. It is called with the run and with one whose states are free of the estimated
      error, need not be differentiable, and may read what follows from the states at the saved times, as
      ``run.observables`` does. If not given, the state.

    **Returns:** what ``of`` returns, with the error of each number in its place, in its unit. By default a state, with
    the errors of its components at the saved times, which are the leading axis. NaN at times that the run did not
    reach.

    **Raises:** ``TypeError`` for anything but a trajectory, and for an ``of`` that is no function or does not return
    numbers; ``ValueError`` for a batch, in a function that JAX transforms, for a run under feedback, for one that did
    not come to its second saved time, where ``of`` reads dense output, events, switches or losses, and where the form
    of its result depends on the states;
    :class:`PrecisionError` in float32; and :class:`~jaxball.SolveError` where a solve between two times fails.

    **Example:**

    >>> import jax
    >>> jax.config.update("jax_enable_x64", True)
    >>> from jaxball import Disk, DiskState, estimate_error, simulate
    >>> slope = Disk(mass=1.0, inertia=0.5, offset=(0.0, 0.0, -0.2))  # it rocks to and fro
    >>> run = simulate(slope, [0.0, 5.0, 10.0], DiskState(phidot=-0.5), rtol=1e-6, atol=1e-6)
    >>> error = estimate_error(run, of=lambda run: run.state.z[-1])
    >>> finer = simulate(slope, [0.0, 5.0, 10.0], DiskState(phidot=-0.5), rtol=1e-13, atol=1e-13)
    >>> bool(abs(error / (run.state.z[-1] - finer.state.z[-1]) - 1) < 1e-3)
    True
    """
    _check(run)
    if of is not None:
        require_callable("of", of, "run")
    errors = _carry_errors(run)
    if of is None:
        return errors.body if isinstance(errors, ReleasedState) else errors
    computed, corrected = of(run), of(_subtract_errors(run, errors))
    if not jax.tree.leaves(computed):
        raise TypeError(f"Argument `of` must be a function to numbers, but it returns {describe(computed)}.")
    if _form_of(computed) != _form_of(corrected):
        raise ValueError(
            "Argument `of` must be a function whose result has the same form for the run and for that without errors, "
            f"but it returns {describe(computed)} and {describe(corrected)}; return the same numbers of any run."
        )
    return jax.tree.map(_difference, computed, corrected)


def _check(run: Any) -> None:
    """Raises unless ``run`` is a trajectory whose error can be estimated."""
    require("run", run, Trajectory, "the trajectory of a run, as jaxball.simulate returns it")
    if is_traced(run.status):
        raise ValueError(
            "The error of a run is estimated outside jit, vmap and grad, by solves that are compiled on their own, but "
            "this run is traced; return it from the function, and estimate its error there."
        )
    require_one_run(run.status, "`estimate_error`")
    if run.times.dtype != np.float64:
        raise PrecisionError(
            f"The error of a run is estimated by solves at a tolerance of {TOLERANCE_BETWEEN_TIMES:g}, but this run is "
            f'in {run.times.dtype}; enable float64 before the first array is made, with `jax.config.update("'
            'jax_enable_x64", True)`.'
        )
    if not run.history.restarts:
        raise ValueError(
            "The error is estimated by solves from each saved state on, which is not possible in a run with "
            f"{run.history.described}; compare it with a run at tighter tolerances."
        )
    if not np.isfinite(np.concatenate([np.ravel(leaf[:2]) for leaf in jax.tree.leaves(run.state)])).all():
        raise ValueError(
            "The error is estimated of a run that came to its second saved time, at least, but this one did not: "
            f"{run.message}"
        )


class SlopeOfEnd(NamedTuple):
    """How fast the end of a run moves with its start: the ``derivative`` of a run, and ``differences`` of nearby ones.

    - ``spread``: by how much differences differ that are twice as wide, at each of their entries.
    """

    derivative: Float[np.ndarray, " size"]
    differences: Float[np.ndarray, " size"]
    spread: Float[np.ndarray, " size"]


def slope_of_end(
    run: Trajectory[Any, Any],
    direction: Float[np.ndarray, " size"],
    width: float,
    tolerances: tuple[float, float],
) -> SlopeOfEnd:
    """Computes the derivative of a run's end as its start moves in a ``direction``, and the same by differences.

    The derivative is that of a run at the ``tolerances``. Differences are of runs at a tolerance of 1e-14 that start
    ``width`` and twice that to both sides, in Richardson's combination. NaN where one of them fails. For runs without
    modes.
    """
    times: Any = np.asarray(run.times)[[0, -1]]
    start = _row(jax.tree.map(np.asarray, run.state), 0)
    vector, unravel = ravel_state(start)

    def solve(distance: float, tolerances: np.ndarray) -> list[np.ndarray]:
        moved = jax.tree.map(np.asarray, unravel(vector + distance * direction))
        ends, status = _solve_between(run.system, None, times, moved, None, tolerances, cast(Any, direction))
        return [np.where(int(status) in SUCCESSES, end, np.nan) for end in ends]

    _, derivative = solve(0.0, np.asarray(tolerances))
    ends = [solve(side * distance, TIGHT)[0] for distance in (width, 2 * width) for side in (-1, 1)]
    narrow, wide = (ends[1] - ends[0]) / (2 * width), (ends[3] - ends[2]) / (4 * width)
    return SlopeOfEnd(derivative, narrow + (narrow - wide) / 3, np.abs(narrow - wide))


def _carry_errors(run: Trajectory[Any, Any]) -> Any:
    """Returns the errors of the states at the saved times, as states from which a solve can start."""
    times: Any = np.asarray(run.times)
    states, law, modes = jax.tree.map(np.asarray, _take_given(run)), None, None
    if run.contact is not None:
        law, modes = run.contact.law, np.asarray(run.contact.mode)
    _, unravel = ravel_state(_row(states, 0))
    saved = np.concatenate([leaf.reshape(times.size, -1) for leaf in jax.tree.leaves(states)], axis=1)
    errors = np.full_like(saved, np.nan)
    errors[0] = 0.0
    for k in range(int(np.isfinite(saved).all(axis=1).sum()) - 1):
        span, start = times[k : k + 2], _row(states, k)
        mode: Any = None if modes is None else np.asarray(modes[k])  # a scalar would be static
        (end, carried), status = _solve_between(run.system, law, span, start, mode, TIGHT, errors[k])
        if int(status) not in SUCCESSES:
            raise SolveError(
                f"The error of this run cannot be estimated, because the solve from its saved time "
                f"{times[k]:.10g} to {times[k + 1]:.10g} at a tolerance of {TOLERANCE_BETWEEN_TIMES:g} ended with the "
                f"status {Status(int(status)).name}; leave out saved times at which the body strikes the ground, from "
                "which no solve can start as the run did, or compare the run with one at tighter tolerances."
            )
        # εₖ₊₁ = Jₖ εₖ + eₖ.
        errors[k + 1] = np.asarray(carried) + saved[k + 1] - np.asarray(end)
    return jax.vmap(unravel)(jnp.asarray(errors))


@programs.filter_jit
def _solve_between(
    system: AbstractSystem,
    law: Contact | None,
    times: Float[Array, "2"],
    state: Any,
    mode: Int[Array, ""] | None,
    tolerances: Float[Array | np.ndarray, "2"],
    deviation: Float[Array, " size"],
) -> tuple[tuple[Float[Array, " size"], Float[Array, " size"]], Int[Array, ""]]:
    """Solves over ``times`` from a saved state, by Dopri8; returns its end as a vector, the deviation carried there,
    and the status.
    """
    vector, unravel = ravel_state(state)

    def end_of(vector: Float[Array, " size"]) -> tuple[Float[Array, " size"], Int[Array, ""]]:
        run = simulate(
            system,
            times,
            _on_constraints(system, times[0], unravel(vector), mode),
            rtol=tolerances[0],
            atol=tolerances[1],
            contact=law,
            adjoint=diffrax.ForwardMode(),
            max_steps=STEPS_BETWEEN_TIMES,
            inside=False,
        )
        return ravel_state(_row(_take_given(run), -1))[0], run.status

    # One solve gives both its end and what the error before has become.
    end, carried, status = jax.jvp(end_of, (vector,), (deviation,), has_aux=True)
    return (end, carried), status


def _on_constraints(system: AbstractSystem, t: Float[Array, ""], state: Any, mode: Int[Array, ""] | None) -> Any:
    """Finds the nearest state that a solve can start from, in the mode that the run was in."""
    prepared = system.prepare()
    if mode is None:
        return prepared.projected(t, state)
    assert isinstance(prepared, AbstractBody)
    height = jnp.where(state.height < 0, 0.0, state.height)  # by rounding
    touching = ReleasedState(state.body.projected(), state.V, height)
    rolling, _ = rolling_contact(prepared, t, touching.body)
    sliding = with_rise(prepared, t, touching, jnp.zeros_like(height))
    # A saved state is in its mode up to rounding: a slip of 1e-16 would start a body that rolls as one that slides.
    rolls = (mode == int(Mode.ROLLING)) | (mode == int(Mode.REST))
    V = jnp.where(rolls, rolling, jnp.where(mode == int(Mode.SLIDING), sliding, state.V))
    return ReleasedState(touching.body, V.at[1].set(0.0) if prepared.planar else V, height)


def _take_given(run: Trajectory[Any, Any]) -> Any:
    """Returns the saved states with all that a solve needs to start from one of them."""
    contact = run.contact
    return run.state if contact is None else ReleasedState(run.state, contact.V, contact.height)


def _subtract_errors(run: Trajectory[Any, Any], errors: Any) -> Trajectory[Any, Any]:
    """Returns the run without the ``errors`` of its states; numbers that do not follow from these are NaN."""
    corrected = jax.tree.map(lambda saved, error: saved - error, _take_given(run), errors)
    interpolant, events, history = jax.tree.map(_as_unknown, (run.interpolant, run.events, run.history))
    if not isinstance(corrected, ReleasedState):
        return dataclasses.replace(run, state=corrected, interpolant=interpolant, events=events, history=history)
    unknown = {name: getattr(history, name) for name in ("switches", "slip", "friction_loss", "impact_loss")}
    contact = dataclasses.replace(run.history, V=corrected.V, height=corrected.height, **unknown)
    return dataclasses.replace(run, state=corrected.body, interpolant=interpolant, events=events, history=contact)


def _as_unknown(leaf: Any) -> Any:
    return jnp.full_like(leaf, jnp.nan) if eqx.is_inexact_array(leaf) else leaf


def _form_of(result: Any) -> tuple[Any, list[tuple[int, ...]]]:
    leaves, structure = jax.tree.flatten(result)
    return structure, [np.shape(leaf) for leaf in leaves]


def _difference(computed: Any, corrected: Any) -> Array:
    """Computes the error of a number that ``of`` returns, from its values for the run and for the run without
    errors.
    """
    first, second = np.asarray(computed), np.asarray(corrected)
    if not np.issubdtype(first.dtype, np.number):
        raise TypeError(f"Argument `of` must be a function to numbers, but it returns {describe(computed)}.")
    if np.any(np.isfinite(first) & ~np.isfinite(second)):
        raise ValueError(
            "Argument `of` must be a function of a run that reads its states at the saved times and what follows from "
            "these, but it reads dense output, events, switches, slip or losses, whose errors are not estimated; "
            "compare the run with one at tighter tolerances."
        )
    return jnp.asarray(first - second)


def _row(states: Part, k: int) -> Part:
    return jax.tree.map(lambda leaf: leaf[k], states)
