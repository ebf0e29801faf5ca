"""Checks whether a scenario that was read is possible, with errors in the words of its file."""

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ... import programs
from ...interface.printing import is_array
from ...numerics.arrays import to_array
from ...physics.body import System
from ...physics.conditions import Condition, ExplainedCondition, Problem, all_hold
from ...physics.dynamics.coupling import mass_conditions
from ...physics.dynamics.equations import solvable_friction
from ...physics.dynamics.footing import has_end, surface_under
from ...physics.limits.breaches import breaches
from ...physics.limits.confinement import is_confined, surely_stay
from ...physics.state import BallState, DiskState
from ...physics.validity import beyond_arithmetic
from .errors import ScenarioError, raise_first
from .table import join
from .values import any_traced, leave_open

if TYPE_CHECKING:
    from ...simulation.trajectory import Trajectory


EXTREME = 1e20


def check_confinement(system: System, times: Any, state: BallState | DiskState) -> None:
    """Raises a :class:`ScenarioError` for the rails and masses that are not in the body (module ``confinement``).

    Where they are traced, this is a condition, which leaves undecided those that may leave an open rail or the shell.
    """
    motions = [group.motion for group in system.groups]
    if any_traced((system.radius, motions, system.mechanism_groups, times, state.theta)):
        span, prepared = jnp.asarray(times), system.prepare()
        kinks = prepared.kinks_of_paths()
        leave_open("masses", lambda: is_confined(prepared, span, state, kinks), lambda: surely_stay(system, *span))
    if any_traced((system, times, state)):
        return
    raise_first([_in_keys(problem) for problem in breaches(system, times, np.asarray(state.theta)[None])])


def check_run(system: System, times: Any) -> None:
    """Raises a :class:`ScenarioError` for what is prescribed but does not last as long as a run over these ``times``.

    Where they or its own times are traced, this is a condition.
    """
    if any_traced((system, times)):
        leave_open("time", lambda: all_hold(system.run_conditions(jnp.asarray(times))))
        return
    conditions = system.run_conditions(times)
    raise_first([_in_keys(problem) for condition in conditions for problem in condition.problems()])


def check_start(system: System, start: Any, state: BallState | DiskState) -> None:
    """Raises a :class:`ScenarioError` where the body's initial accelerations are not determined.

    That is, for the first free joint that moves no mass, for dry friction with which the normal force has no solution,
    for a surface that does not fit the body there, and for numbers so far from 1 that what a solve advances is not
    finite. Checks that depend on traced numbers become conditions; whether numbers are too far from 1 is left undecided
    for those that may be.
    """
    # Whether extreme numbers are too extreme is found by computing with them, which leaves traced ones undecided.
    if any_traced((system, start, state)):
        leave_open("body", lambda: jnp.asarray(True), lambda: jnp.asarray(~_has_extremes((system, state))))
    elif _has_extremes((system, state)):
        raise_first([_in_keys(problem) for problem in beyond_arithmetic(system, state, to_array(start))])
    rules = []
    if any(group.free for group in system.mechanism_groups):
        decisive = (system.mechanism_groups, system.radius, start, state.theta)
        rules.append(("mechanisms", mass_conditions, decisive))
    if system.resistance is not None and system.resistance.is_dry:
        rules.append(("resistance.dry", solvable_friction, (system, start, state)))
    if has_end(system):
        rules.append(("ground", _on_ground, (system.ground, system.radius, start, state)))
    for path, rule, decisive in rules:
        if any_traced(decisive):
            leave_open(path, lambda rule=rule: all_hold(rule(system.prepare(), to_array(start), state)))
    if not rules or any_traced((system, start, state)):
        return
    # One program for the whole answer, as a scenario is usually possible; conditions one by one only for its
    # sentences.
    if not bool(_can_start(system, to_array(start), state)):
        conditions = system.start_conditions(to_array(start), state)
        raise_first([_in_keys(problem) for condition in conditions for problem in condition.problems()][:1])


def _on_ground(
    system: System, t: Float[Array, ""], state: BallState | DiskState
) -> Iterator[Condition | ExplainedCondition]:
    """Returns the conditions on the surface under a body where it starts."""
    ground = surface_under(system, t, state)
    assert ground is not None
    yield from ground.start_conditions(t, system.radius, state)


def _in_keys(problem: Problem) -> ScenarioError:
    return ScenarioError(problem.sentence("Key", key_of(problem.name)))


def _has_extremes(tree: Any) -> Bool[Array, ""] | np.bool_:
    """Returns whether a number is so large or so small that products of a few may overflow or underflow."""
    xp = jnp if any_traced(tree) else np
    sizes = xp.concatenate([xp.abs(xp.ravel(leaf)).astype(float) for leaf in jax.tree.leaves(tree) if is_array(leaf)])
    # Squares and fourth powers of such numbers leave the range of float64.
    return xp.any((sizes > EXTREME) | (sizes < 1 / EXTREME) & (sizes > 0))


@programs.filter_jit
def _can_start(system: System, t: Float[Array, ""], state: BallState | DiskState) -> Bool[Array, ""]:
    return all_hold(system.start_conditions(t, state))


def message_in_keys(trajectory: "Trajectory[Any, Any]") -> str:
    """Says how the solve of a scenario ended, in a sentence that names the keys of its file whose values are
    impossible.
    """
    return trajectory.message_of([problem.sentence("Key", key_of(problem.name)) for problem in trajectory.problems])


def key_of(name: str) -> str:
    """Returns the key of a scenario file for the number with this ``name`` in Python."""
    if name.startswith("state."):
        return "initial." + re.sub(r"^V\b", "velocity", re.sub(r"^q\b", "versor", name.removeprefix("state.")))
    if name.startswith("masses["):
        return re.sub(r"\.motion$", ".free", name).replace(".motion.", ".")
    if name.startswith("mechanisms["):
        name = re.sub(r"\.drive$", ".schedule", re.sub(r"\.mass$", ".masses", name))
        return name.replace(".drive", ".force").replace(".terms[", "[")
    if name.startswith(("ground.", "resistance.", "contact.")):
        return name
    if name.startswith("law."):  # whose schedules are those of the coordinates that it drives
        return name.replace("law.", "actuation.") if name.startswith("law.signals") else "actuation"
    return {"force": "force", "ground": "ground", "law": "actuation"}.get(name, join("body", name))
