"""Estimates the errors of runs, and of results that functions compute with runs.

Of a run, from the errors between its saved times and how each grows until later ones; of a result, such as a
derivative, by finer runs.
"""

import contextlib
import dataclasses
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, TypeVar, cast

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .. import programs
from ..interface.arguments import describe, refusal, require, require_callable, require_one_run
from ..interface.compat import HAS_SETTINGS_OF_TRACES, is_traced
from ..interface.status import SUCCESSES, SolveError, Status
from ..physics.body import AbstractBody
from ..physics.contact.law import Contact
from ..physics.contact.modes import Mode
from ..physics.contact.released import ReleasedState, rolling_contact, with_rise
from ..physics.packing import ravel_state
from ..physics.system import AbstractSystem
from ..programs import traces
from .arguments import PrecisionError
from .simulate import simulate
from .trajectory import Trajectory

Part = TypeVar("Part")

TOLERANCE_BETWEEN_TIMES = 1e-14  # of the solves from one saved time to the next
TIGHT = np.full(2, TOLERANCE_BETWEEN_TIMES)  # an array, because numbers would distinguish programs
STEPS_BETWEEN_TIMES = 2**18
FINER_BY = 1e-2  # the factor of the tolerances of finer runs, whose errors are about as much smaller
MORE_STEPS = 16  # times as many: at a hundredth of the tolerance a method of order 2 takes five to ten times the steps
OUT_OF_STEPS = (
    "The result of `function` has NaN that are numbers where its runs may take 16 times as many steps: a run in it "
    "took `max_steps` steps, or, if its status is SUCCESS, its derivative did, which needs as many steps at rest as in "
    "motion; raise `max_steps`, loosen the tolerances, or shorten the run."
)
OUT_OF_STEPS_WHEN_FINER = (
    "The error cannot be estimated, because at a hundredth of the tolerances the result of `function` has NaN, even "
    "where its runs may take 16 times as many steps; loosen the tolerances, or shorten the run."
)


def estimate_error(run: Trajectory[Any, Any], of: Callable[[Trajectory[Any, Any]], Any] | None = None) -> Any:
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
    require_one_run(run.status, "`error_estimate`")
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


def estimate_error_of(function: Callable[..., Any], *arguments: Any) -> Any:
    """Estimates the error of a result that a function computes with runs, such as a derivative: the computed value less
    the true one.

    The function is computed as it is, and with all of its runs at a hundredth of their tolerances. The difference is
    the error of the former up to that of the latter, which is about a hundred times smaller. What the tolerance does
    not change is not seen: errors of the model, and of runs that were simulated before the function is called.

    **Arguments:**

    - ``function``: a function that simulates and returns numbers, arrays or a pytree of these, such as
      ``jax.grad(loss)`` or ``jax.jit(jax.jacfwd(place))``. A compiled one is compiled once more.
    - ``arguments``: those with which it is called.

    **Returns:** what ``function`` returns, with the error of each number in its place, in its unit. NaN where a number
    is NaN.

    **Raises:** ``TypeError`` for a ``function`` that is none or does not return numbers; ``ValueError`` where an
    argument is traced, where the form of the result depends on the tolerances, and for a function that does not
    simulate; :class:`PrecisionError` where tolerances cannot be tightened; and :class:`~jaxball.SolveError` where a
    number is NaN because a run, or the derivative of one, took ``max_steps`` steps.

    **Example:**

    >>> import jax
    >>> jax.config.update("jax_enable_x64", True)
    >>> from jaxball import Disk, DiskState, simulate
    >>> from jaxball.simulation import estimate_error_of
    >>> slope = Disk(mass=1.0, inertia=0.5, offset=(0.0, 0.0, -0.2))  # it rocks to and fro
    >>> def end(speed, tolerance=1e-6):
    ...     return simulate(slope, [0.0, 9.0], DiskState(phidot=-speed), rtol=tolerance, atol=tolerance).state.z[-1]
    >>> error = estimate_error_of(jax.grad(end), 0.5)
    >>> bool(abs(error / (jax.grad(end)(0.5) - jax.grad(end)(0.5, 1e-12)) - 1) < 0.1)
    True
    """
    if not callable(function):
        raise refusal("function", "a function that simulates, such as jax.grad(loss)", function)
    if any(map(is_traced, jax.tree.leaves(arguments))):
        raise ValueError(
            "The error of a result is estimated outside jit, vmap and grad, because its runs are solved again, but an "
            "argument is traced; give the whole function, as in estimate_error_of(jax.grad(loss), parameters)."
        )
    value = _numbers(function(*arguments))
    tighter = traces.Finer(FINER_BY)
    finer = _compute_with(tighter, function, arguments)
    if _form_of(value) != _form_of(finer):
        raise ValueError(
            "Argument `function` must return a result of the same form at any tolerance, but it returns "
            f"{describe(value)}, and {describe(finer)} at a hundredth of it."
        )
    if any(np.any(np.isnan(number)) for number in jax.tree.leaves(value)):
        longer = _compute_with(traces.Finer(steps=MORE_STEPS), function, arguments)
        if _is_unknown(value, longer):
            raise SolveError(OUT_OF_STEPS)
    if _is_unknown(finer, value):
        finer = _compute_with(traces.Finer(FINER_BY, MORE_STEPS), function, arguments)
        if _is_unknown(finer, value):
            raise SolveError(OUT_OF_STEPS_WHEN_FINER)
    errors = jax.tree.map(lambda x, y: x - y, value, finer)
    changes, counts = (any(map(np.any, jax.tree.leaves(result))) for result in (errors, value))
    if counts and not changes and not tighter.met:
        raise ValueError(
            "Argument `function` must simulate when it is called, because the error is that of its runs, but there was "
            "no run and its result stays the same; write a function that calls simulate."
        )
    return jax.tree.map(jnp.asarray, errors)


def _compute_with(finer: traces.Finer, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """Computes the function with finer runs."""
    with contextlib.nullcontext() if HAS_SETTINGS_OF_TRACES else _forget_traces(), traces.finer(finer):
        return _numbers(function(*arguments))


@contextlib.contextmanager
def _forget_traces() -> Iterator[None]:
    """Keeps what is traced in this block apart from all else, where JAX does not."""
    for forget in (jax.clear_caches, programs.forget):
        forget()
    yield
    for forget in (jax.clear_caches, programs.forget):
        forget()


def _numbers(result: Any) -> Any:
    """Returns a result as arrays of NumPy.

    **Raises:** ``TypeError`` for anything but numbers.
    """
    leaves, structure = jax.tree.flatten(result)
    arrays = [np.asarray(leaf) for leaf in leaves]
    if not arrays or not all(np.issubdtype(array.dtype, np.number) for array in arrays):
        raise TypeError(f"Argument `function` must return numbers, but it returns {describe(result)}.")
    return structure.unflatten(arrays)


def _form_of(result: Any) -> tuple[Any, list[tuple[int, ...]]]:
    leaves, structure = jax.tree.flatten(result)
    return structure, [np.shape(leaf) for leaf in leaves]


def _is_unknown(result: Any, other: Any) -> bool:
    """Returns whether a number is NaN that the ``other`` result knows."""
    pairs = zip(jax.tree.leaves(result), jax.tree.leaves(other), strict=True)
    return any(np.any(np.isnan(x) & ~np.isnan(y)) for x, y in pairs)
