"""Estimates the error of a result that a function computes with runs, such as a derivative, by finer runs."""

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .. import programs
from ..compat import HAS_SETTINGS_OF_TRACES, is_traced
from ..interface.arguments import describe, refusal
from ..interface.status import SolveError
from ..programs import traces

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
    >>> from jaxball import Disk, DiskState, estimate_error_of, simulate
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
