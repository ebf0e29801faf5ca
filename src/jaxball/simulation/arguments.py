"""Checks the arguments of a solve, has their defaults, and chooses the system to solve, such as a body with modes.

``simulate``, ensembles, chaos and stability call these functions before they compile anything.
"""

import functools
import math
import warnings
from collections.abc import Iterator, Mapping
from typing import Any, SupportsFloat

import diffrax
import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..interface.arguments import describe, refusal, require, require_one, whole_number
from ..interface.compat import is_traced
from ..interface.wording import UserError
from ..numerics.arrays import Numbers, default_dtype, has_shape, require_numbers, to_array
from ..numerics.declare import shapes_of_fields
from ..physics.body import AbstractBody
from ..physics.contact.body_on_plane import BodyOnPlane, has_contact
from ..physics.contact.law import COEFFICIENTS, Contact
from ..physics.contact.released import ReleasedState
from ..physics.contact.slide import find_rival
from ..physics.dae import WITH_UNIT
from ..physics.system import AbstractState, AbstractSystem, require_state, require_system, shapes_of_state
from ..programs import traces
from ..programs.derivatives.differentiation import is_differentiated_forward
from . import DEFAULT_TOLERANCE as DEFAULT_TOLERANCE, MOST_STEPS
from .solvers import NDF, TRBDF2, RadauIIA, Trapezoidal

DEFAULT_SOLVER = diffrax.Dopri8()
DEFAULT_ADJOINT = diffrax.RecursiveCheckpointAdjoint()
NO_PROGRESS = diffrax.NoProgressMeter()
KNOW_MASS_MATRICES = (RadauIIA, NDF, Trapezoidal, TRBDF2)
PLAIN = 1e30  # numbers between this and its negative have a place in every floating-point type
LEAST_REFINEMENT = 1 / 3  # of the tolerance, by which the error can still be told
FINEST = {name: 8 * float(np.finfo(name).eps) for name in ("float32", "float64")}


@functools.cache
def _finest(dtype: np.dtype) -> float:
    return FINEST[dtype.name]


class PrecisionError(UserError):
    """The tolerances are too tight for the floating-point type in use."""


def _refine(rtol: Array | np.ndarray, atol: Array | np.ndarray) -> tuple[Any, Any]:
    """Returns tolerances as they are, or within a block for finer runs tightened, as far as their type allows.

    **Raises:** :class:`PrecisionError` where they are known and cannot be tightened to a third.
    """
    finer = traces.finer.value
    if finer is None:
        return rtol, atol
    finer.met.append(None)
    xp: Any = jnp if is_traced(rtol) or is_traced(atol) else np
    factor = xp.maximum(finer.tolerance, xp.minimum(_finest(rtol.dtype) / xp.maximum(rtol, atol), 1.0))
    if xp is np and np.any(factor > max(finer.tolerance, LEAST_REFINEMENT)):
        raise PrecisionError(
            f"The error at the tolerances {rtol[()]!s} and {atol[()]!s} is measured by a run at tighter ones, but "
            f"{_finest(rtol.dtype):.1e} is the least in {rtol.dtype}; choose tolerances of three times that or more."
        )
    return xp.asarray(factor * rtol, rtol.dtype), xp.asarray(factor * atol, atol.dtype)


def _as_array(name: str, x: Numbers) -> Array | np.ndarray:
    """Returns ``x`` as an array; a known one stays in NumPy, which saves microseconds a call."""
    if is_traced(x):
        return to_array(x, name)
    require_numbers(name, x)
    try:
        return np.asarray(x, dtype=default_dtype())
    except (TypeError, ValueError, OverflowError):
        raise refusal(name, "numbers", x) from None


def check_times(times: Numbers) -> Array | np.ndarray:
    """Checks times, and returns them as an array.

    **Raises:** ``ValueError`` unless they are two or more in one axis and, where that is known, increasing.
    """
    if isinstance(times, tuple | list) and len(times) == 2 and {*map(type, times)} <= {float, int}:
        start, end = times
        near = start > -PLAIN and end < PLAIN and abs(start) <= FAR * (end - start)
        if near and (array := np.asarray(times, default_dtype()))[0] < array[1]:
            return array  # after a few microseconds; the rest takes ten
    array = _as_array("times", times)
    if array.ndim != 1 or array.size < 2:
        raise ValueError(
            "Argument `times` must be two or more increasing numbers, from the start to the end of the run, such as "
            f"[0.0, 10.0], but its shape is {array.shape}."
        )
    if isinstance(array, np.ndarray) and not ((array[1:] > array[:-1]).all() and np.isfinite(array[-1])):
        raise ValueError(
            "Argument `times` must be increasing and finite, but it starts with "
            f"{array[:3].tolist()} and ends with {array[-3:].tolist()}."
        )
    if isinstance(array, np.ndarray):
        _warn_of_far_times(array)
    return array


FAR = 100  # spans from zero, from where on counting times from the start is worth it
FINE = 1e-8  # of the shortest interval: how finely times must be known


def _warn_of_far_times(times: np.ndarray) -> None:
    """Warns of times such as 1.7e9, in seconds since 1970, of which few digits tell one moment from the next."""
    start, span, spacing = float(times[0]), float(times[-1] - times[0]), float(np.spacing(abs(times[0])))
    if abs(start) > FAR * span and spacing > FINE * float(np.min(np.diff(times))):
        # At the line that calls `simulate`: a search for the user's own reads more than its arguments, and programs of
        # functions that do are not kept.
        warnings.warn(
            f"Argument `times` starts at {start:.12g} and lasts {span:.6g}: so far from 0, times are known to "
            f"{spacing:.1g} only, which costs accuracy and steps. Count the times of the run, and those of its logs, "
            "from the start: times - times[0].",
            UserWarning,
            stacklevel=4,
        )


def check_solver(solver: diffrax.AbstractAdaptiveSolver | None) -> diffrax.AbstractAdaptiveSolver:
    """Checks a solver, or chooses the default.

    **Raises:** ``TypeError`` for anything but a solver that estimates its error.
    """
    if solver is None or isinstance(solver, diffrax.AbstractAdaptiveSolver):
        return DEFAULT_SOLVER if solver is None else solver
    if isinstance(solver, str):
        remedy = "names are for scenario files"
    elif isinstance(solver, diffrax.AbstractSolver):
        remedy = "it has no error estimate by which to choose its steps, and diffrax.HalfSolver(...) gives it one"
    else:
        remedy = ""
    raise refusal("solver", "an adaptive solver, such as diffrax.Dopri8()", solver, remedy)


def check_steps(max_steps: int) -> int:
    """Checks the number of steps.

    **Raises:** ``TypeError`` or ``ValueError`` for anything but a whole number from 1 to 10⁹.
    """
    max_steps, finer = whole_number("max_steps", max_steps, 1, MOST_STEPS), traces.finer.value
    return max_steps if finer is None else min(finer.steps * max_steps, MOST_STEPS)


def check_longest_step(max_step: float | None) -> float | None:
    """Checks the longest step.

    **Raises:** ``TypeError`` for anything but None and a number that is known when a program is compiled;
    ``ValueError`` for one that is not positive and finite.
    """
    if max_step is None:
        return None
    if is_traced(max_step):
        raise TypeError(
            "Argument `max_step` must be a number that is known, because a program is compiled for it, but it is "
            "traced; make it a Python number, or a static argument of the function that jax.jit compiles."
        )
    if isinstance(max_step, bool) or np.ndim(max_step) or not isinstance(max_step, SupportsFloat):
        raise refusal("max_step", "None or a single number, the longest step", max_step)
    longest = float(max_step)
    if not 0 < longest < math.inf:
        raise ValueError(
            f"Argument `max_step` must be positive and finite, but it is {longest}; for no limit, give None."
        )
    return longest


def check_adjoint(
    adjoint: diffrax.AbstractAdjoint | None,
) -> diffrax.RecursiveCheckpointAdjoint | diffrax.ForwardMode | None:
    """Checks the adjoint; None, if it is that of the mode in which the solve is differentiated.

    **Raises:** ``TypeError`` for anything else, and for an adjoint that is not supported.
    """
    if adjoint is None:
        return None
    if isinstance(adjoint, diffrax.RecursiveCheckpointAdjoint | diffrax.ForwardMode):
        return adjoint
    require("adjoint", adjoint, diffrax.AbstractAdjoint, "an adjoint, such as diffrax.ForwardMode()")
    why = (
        "which repeats steps with other lengths where rounding decides them, and so is wrong in reverse mode"
        if isinstance(adjoint, diffrax.DirectAdjoint)
        else "which needs a loop of its own, but simulate uses its own"
    )
    raise TypeError(
        "Argument `adjoint` must be None, for both modes, diffrax.RecursiveCheckpointAdjoint() for reverse mode alone "
        f"or diffrax.ForwardMode() for forward mode alone, but it is diffrax.{type(adjoint).__name__}(), {why}."
    )


def adjoint_in_mode(
    adjoint: diffrax.RecursiveCheckpointAdjoint | diffrax.ForwardMode | None,
) -> diffrax.RecursiveCheckpointAdjoint | diffrax.ForwardMode:
    """Returns the adjoint that was chosen, or else the one for the mode in which traced numbers are differentiated."""
    if adjoint is not None:
        return adjoint
    return diffrax.ForwardMode() if is_differentiated_forward() else DEFAULT_ADJOINT


def check_progress(progress: diffrax.AbstractProgressMeter | None) -> diffrax.AbstractProgressMeter:
    """Checks the progress meter, or chooses none.

    **Raises:** ``TypeError`` for anything else.
    """
    if progress is None:
        return NO_PROGRESS
    must = "a progress meter, such as diffrax.TextProgressMeter()"
    require("progress", progress, diffrax.AbstractProgressMeter, must)
    return progress


def require_kind_of_state(system: AbstractSystem, state: AbstractState | ReleasedState) -> None:
    """Raises ``TypeError`` for a state that needs a law of contact without one, or is not of the system to solve."""
    if isinstance(state, ReleasedState) and not has_contact(system):
        raise TypeError(
            "Argument `contact` must be given where `state` is a ReleasedState, because a body that may slip or fly "
            "needs a law of friction and impact, such as Contact(friction=0.3), but it is None."
        )
    require_state(system, state)


def require_single(system: AbstractSystem, state: AbstractState | ReleasedState) -> None:
    """Raises ``TypeError`` or ``ValueError`` for anything but one system to solve, and one state of it."""
    require_kind_of_state(system, state)
    if has_contact(system):
        require_one("contact", "law", system.contact, dict.fromkeys(COEFFICIENTS, ()))
    if isinstance(state, ReleasedState):
        require_one("state", "state", state, {"V": (3,), "height": ()})
        state = state.body
    require_one("state", "state", state, shapes_of_state(type(state), default_dtype()))


def require_single_numbers(system: AbstractSystem, events: Mapping[str, Any]) -> None:
    """Raises ``ValueError`` where an array of a system or an event has other axes than the argument that it was.

    Those of many systems, or of an array put in by ``equinox.tree_at``, would be taken for the entries of vectors, and
    change the motion without a word. For the shapes that a program is traced with, because it takes too long at each
    call.
    """
    for argument, part in (("system", getattr(system, "body", system)), ("events", events)):
        for path, shape, actual in _other_shapes(part, "", 0):
            raise ValueError(
                f"Argument `{argument}` must be {'one system' if argument == 'system' else 'events of one run'}, with "
                f"`{path}` of shape {shape}, but its shape is {actual}; for many runs use jax.vmap or "
                "jaxball.simulation.ensemble.simulate_ensemble."
            )


def _other_shapes(part: Any, path: str, stacked: int) -> Iterator[tuple[str, tuple[Any, ...], tuple[int, ...]]]:
    """Yields the path of each array whose shape is not that of its argument, the latter's shape, and its own.

    ``stacked`` is the number of axes along which parts of one structure are stacked, as in the groups of a body.
    """
    if isinstance(part, list | tuple):
        for index, item in enumerate(part):
            yield from _other_shapes(item, f"{path}[{index}]", stacked)
    elif isinstance(part, Mapping):
        for name, item in part.items():
            yield from _other_shapes(item, f"{path}{name}", stacked)
    elif isinstance(part, eqx.Module):
        yield from _other_shapes_of_fields(part, f"{path}." if path else "", stacked)


def _other_shapes_of_fields(
    module: eqx.Module, start: str, stacked: int
) -> Iterator[tuple[str, tuple[Any, ...], tuple[int, ...]]]:
    parts, shapes = dict(vars(module)), shapes_of_fields(type(module))
    if isinstance(module, AbstractBody):
        for name, kind, order in (("groups", "masses", "order"), ("mechanism_groups", "mechanisms", "mechanism_order")):
            for group, indices in zip(parts.pop(name), parts[order], strict=True):
                yield from _other_shapes(group, f"{start}{kind}[{indices[0]}]", stacked + 1)
    for name, part in parts.items():
        if name not in shapes:
            yield from _other_shapes(part, start + name, stacked)
        elif hasattr(part, "shape") and not has_shape(part.shape[stacked:], shapes[name]):
            yield start + name, shapes[name], part.shape[stacked:]


def require_dae(
    system: AbstractSystem, state: AbstractState | ReleasedState, solver: diffrax.AbstractSolver | None
) -> None:
    """Raises ``TypeError`` where a differential-algebraic form is asked for but does not exist.

    That is of a hybrid system, of a state without a unit vector, and for a solver that does not support a mass matrix.
    """
    if system.is_hybrid:
        name = type(system).__name__ if system.shown is system else system.title
        raise TypeError(
            f"Argument `dae` must be False for a {name}, whose modes are differential equations, but it is True."
        )
    assert not isinstance(state, ReleasedState)  # which exists only with a law of contact
    if state.unit_vector is None:
        raise TypeError(
            f"Argument `state` must be {WITH_UNIT} where `dae` is True, because it is a component of their unit "
            f"vector that becomes algebraic, but it is a {type(state).__name__}."
        )
    if not isinstance(solver, KNOW_MASS_MATRICES):
        raise TypeError(
            "Argument `solver` must be a RadauIIA, NDF, Trapezoidal or TRBDF2 of jaxball.simulation.solvers where "
            "`dae` is True, because other solvers do not support a mass matrix, "
            f"but it is a {type(DEFAULT_SOLVER if solver is None else solver).__name__}."
        )


def has_projection(system: AbstractSystem, state: AbstractState | ReleasedState) -> bool:
    """Returns whether there is anything for ``project`` to keep: a unit vector, a rotation matrix, or constraints."""
    kind = type(state.body if isinstance(state, ReleasedState) else state)
    if isinstance(system, BodyOnPlane) or type(system).projected is AbstractSystem.projected:
        return kind.unit_vector is not None or kind.projected is not AbstractState.projected
    return True


def require_projection(system: AbstractSystem, state: AbstractState | ReleasedState) -> None:
    """Raises ``TypeError`` where ``project`` is asked for but would change nothing."""
    if not has_projection(system, state):
        raise TypeError(
            f"Argument `project` must be False for a {system.shown.title}, whose state has nothing to normalise, "
            "but it is True."
        )


def check_tolerances(
    rtol: Numbers, atol: Numbers, of_many: bool = False
) -> tuple[Array | np.ndarray, Array | np.ndarray]:
    """Checks tolerances, and returns them as arrays; with many runs they may have an axis.

    **Raises:** ``ValueError`` for more than one number for a single run, and where they are known and negative or not
    finite, and :class:`PrecisionError` when the floating-point type cannot reach the larger of them.
    """
    if type(rtol) is float and type(atol) is float:
        dtype = default_dtype()
        if 0 <= rtol < math.inf and 0 <= atol < math.inf and max(rtol, atol) >= _finest(dtype):
            # This takes microseconds, the rest tens.
            return _refine(np.asarray(rtol, dtype), np.asarray(atol, dtype))
    rtol, atol = _as_array("rtol", rtol), _as_array("atol", atol)
    concrete_values = {name: x for name, x in (("rtol", rtol), ("atol", atol)) if isinstance(x, np.ndarray)}
    for name, x in (("rtol", rtol), ("atol", atol)):
        if x.ndim and not of_many:
            raise ValueError(f"Argument `{name}` must be a single number, but its shape is {x.shape}.")
    for name, x in concrete_values.items():
        wrong = np.argwhere(~((x >= 0) & np.isfinite(x)))
        if len(wrong):
            where = "".join(f"[{k}]" for k in wrong[0])
            got = x[tuple(wrong[0])]
            raise ValueError(f"Argument `{name}{where}` must be 0 or a positive number, but it is {got}.")
    dtype, finest = rtol.dtype, _finest(rtol.dtype)
    if not concrete_values or np.all(functools.reduce(np.maximum, concrete_values.values()) >= finest):
        return _refine(rtol, atol)
    remedy = (
        'enable float64 before the first array is made, with `jax.config.update("jax_enable_x64", True)`, or '
        if dtype == jnp.float32
        else ""
    )
    tolerances = f"{rtol[()]!s} and {atol[()]!s}"  # with the digits of their type
    raise PrecisionError(
        f"Arguments `rtol` and `atol` must not both be below {finest:.1e} in {dtype}, but they are {tolerances}; "
        f"{remedy}choose looser ones."
    )


def system_to_solve(system: AbstractSystem, contact: Contact | None) -> AbstractSystem:
    """Returns the system that is solved: with a law of contact, the body on its plane; with parts that stick or rest,
    its modes.

    Everything else asks it, and not whether there is a law.

    **Raises:** ``TypeError`` for what is no system, and for a law that the system has no equations for; ``ValueError``
    for a limit surface beside what it cannot be solved with.
    """
    require_system(system)
    if contact is None:
        if not isinstance(system, AbstractBody):
            return system.with_modes
        return BodyOnPlane(system, None) if system.is_hybrid else system
    require("contact", contact, Contact, "a Contact, such as Contact(friction=0.3)")
    if not isinstance(system, AbstractBody):
        raise TypeError(
            f"Argument `contact` must be None for a {type(system).__name__}, which is neither a Ball nor a Disk, but "
            f"it is {describe(contact)}."
        )
    if (rival := find_rival(system, contact)) is not None:
        raise ValueError(f"Argument `contact` must have no LimitSurface where there is {rival}.")
    return BodyOnPlane(system, contact)
