"""Decides whether a system is possible and whether a solve can start from a state, and says what is wrong.

A solve asks :func:`possible_start` within its program; :func:`problems` tells users in sentences.
"""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from .. import programs
from ..interface.arguments import require_one
from ..numerics.arrays import Numbers, default_dtype, to_array, to_numpy
from .conditions import Condition, ExplainedCondition, Problem, all_hold
from .packing import Packing
from .system import AbstractState, AbstractSystem, require_system, shapes_of_state


def possible_start(
    system: AbstractSystem,
    prepared: AbstractSystem,
    times: Float[Array, " T"],
    state: AbstractState,
    inside: bool = True,
) -> Bool[Array, ""]:
    """Returns whether a solve of ``system`` over ``times`` can start from ``state``; traceable.

    ``prepared`` is the same system, prepared. ``inside`` says whether what it confines must be inside.
    """
    holds = jnp.all(times[1:] > times[:-1]) & all_hold(system.conditions()) & all_hold(state.conditions())
    holds &= all_hold(system.start_conditions(times[0], state)) & all_hold(system.run_conditions(times))
    return holds & prepared.is_confined(times, state) if inside else holds


def problems(system: AbstractSystem, state: AbstractState | None = None, t: Numbers = 0.0) -> list[str]:
    """Returns one sentence for each impossible number of a body and of its state; empty when all is well.

    **Arguments:**

    - ``system``: a body, a system of :mod:`jaxball.physics.classical`, or another :class:`~jaxball.AbstractSystem`.
    - ``state``: the state at the start; not checked if not given.
    - ``t``: the time of the start, or the times of a run, during which prescribed motions must stay in the body.

    **Raises:** ``TypeError`` for anything but a system, ``ValueError`` for several states.

    **Example:**

    >>> from jaxball import Ball, problems
    >>> problems(Ball(mass=-1.0, inertia=(1.0, 1.0, 1.0)))
    ['Argument `mass` must be a positive number, but it is -1.0.']
    """
    require_system(system)
    if state is not None:
        require_one("state", "state", state, shapes_of_state(type(state), default_dtype()))
    return [problem.sentence() for problem in find_problems(system, state, np.atleast_1d(to_numpy(t, "t")))]


def find_problems(
    system: AbstractSystem,
    state: AbstractState | None,
    times: Float[np.ndarray, " T"],
    states: AbstractState | None = None,
) -> list[Problem]:
    """Returns the problems that :func:`problems` reports; with the ``states`` of a run, also where it carried its
    masses.
    """
    conditions: list[Condition | ExplainedCondition] = list(system.conditions())
    if state is not None:
        conditions += state.conditions()
        conditions += system.start_conditions(jnp.asarray(times[0], default_dtype()), state)
    conditions += system.run_conditions(times)
    broken = [problem for condition in conditions for problem in condition.problems()]
    if not np.all(times[1:] > times[:-1]):
        broken.append(Problem("times", "be increasing", f"it is {times.tolist()}"))
    named = {problem.name for problem in broken}
    unknown = [problem for problem in not_numbers(system) if not problem.name.startswith(tuple(named))]
    broken.extend(unknown or system.breaches(times, state, states))
    if state is not None and not broken:
        broken.extend(beyond_arithmetic(system, state, times[0]))
    return broken


def not_numbers(system: AbstractSystem) -> Iterator[Problem]:
    """Yields the first NaN entry of each parameter, except parameters of functions."""
    for name, value in system.numbers():
        for index in np.argwhere(np.isnan(value))[: "parameters" not in name]:
            yield Problem(name + "".join(f"[{k}]" for k in index), "be a number", "it is nan")


def beyond_arithmetic(system: AbstractSystem, state: AbstractState, t: ArrayLike) -> Iterator[Problem]:
    """Yields the problem that keeps the vector of the initial state, or its rate of change, from being finite, though
    each number is.
    """
    packed, slope = jax.tree.map(np.asarray, _at_start(system, state, t))
    if np.all(np.isfinite(packed) & np.isfinite(slope)):
        return
    name, value = max(_numbers(system, state), key=lambda item: abs(np.log(abs(item[1]))), default=("", 1.0))
    if np.all(np.isfinite(packed)) and abs(np.log(abs(value))) < np.log(np.finfo(packed.dtype).max) / 4:
        return  # then it is something else, such as a force, that is not finite
    must = (
        "be closer to 1, for instance in other units, because products of such numbers are beyond the range of "
        f"{packed.dtype}"
    )
    yield Problem(name, must, f"it is {value:g}")


@programs.filter_jit
def _at_start(system: AbstractSystem, state: AbstractState, start: Float[ArrayLike, ""]):
    """Returns the vector that a solve would start from, and its rate of change."""
    packing, t = Packing.of(system.prepare(), state), to_array(start)
    packed = packing.pack(t, state)
    return packed, packing.field(t, packed)


def _numbers(system: AbstractSystem, state: AbstractState) -> Iterator[tuple[str, float]]:
    """Yields the numbers of system and state, entry by entry, except those that are 0."""
    of_state = ((f"state{jax.tree_util.keystr(path)}", x) for path, x in jax.tree_util.tree_leaves_with_path(state))
    for name, value in (*system.numbers(), *of_state):
        array = np.asarray(value)
        for k in np.argwhere((array != 0) & np.isfinite(array)):
            yield name + "".join(f"[{i}]" for i in k), float(array[tuple(k)])
