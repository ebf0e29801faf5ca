"""The conditions that parameters and initial states must meet, in many rows."""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

from ...classical import SuslovProblem
from ...physics.body import AbstractBody, Ball, Disk
from ...physics.validity import possible_start
from .compiled import on_rows
from .furthest import LARGEST_PHASE, largest_phase
from .verdict import Verdicts, verdicts, worst

NUDGE = 1e-9


def conditions_hold(system: Any, state: Any, start: Float[np.ndarray, " rows"]) -> Verdicts:
    """Whether the shell of a ball or a disk can be, or a classical system with its state at the start.

    A program rounds otherwise than a reader does, and so a row is in doubt where a condition holds or not as one of
    its numbers is a little larger or smaller.
    """
    if not isinstance(system, AbstractBody):
        found = _robustly(_classical, (system, start, state))
        if isinstance(system, SuslovProblem):
            tame = largest_phase(getattr(system.xi, "series"), start) < LARGEST_PHASE  # noqa: B009
            found = worst(found, verdicts(tame))
        return found
    names = ("mass", "radius", "inertia", "offset", "gravity")
    shell = {name: getattr(system, name) for name in names}
    if isinstance(system, Ball):
        return _robustly(_ball, shell)
    return worst(_robustly(_disk, shell), _flat(system))


def _ball(shell: dict[str, Any]) -> Bool[Array, ""]:
    return jnp.all(jnp.stack([condition.holds for condition in Ball(**shell).conditions()]))


def _disk(shell: dict[str, Any]) -> Bool[Array, ""]:
    return jnp.all(jnp.stack([condition.holds for condition in Disk(**shell).conditions()]))


def _classical(parts: Any) -> Bool[Array, ""]:
    system, start, state = parts
    return possible_start(system, start[None], state)


def _flat(disk: Any) -> Verdicts:
    """Whether the force lies in a disk's plane; for numbers this is exact."""
    bad = np.full(len(disk.mass), False)
    for leaf in () if disk.force is None else (disk.force.series.constant, disk.force.series.amplitude):
        bad |= np.any(leaf[..., 1].reshape(len(bad), -1) != 0, axis=1)
    return verdicts(~bad, bad)


def _robustly(holds: Callable[[Any], Bool[Array, ""]], stacked: Any) -> Verdicts:
    every, some = on_rows(functools.partial(_every_and_some, holds), stacked)
    return verdicts(every, ~some)


@functools.partial(jax.jit, static_argnums=0)
def _every_and_some(holds: Callable[[Any], Bool[Array, ""]], stacked: Any) -> tuple[Array, Array]:
    """Whether the condition holds with every nudge, and whether with some."""

    def one(tree):
        x, unravel = ravel_pytree(tree)
        nudges = NUDGE * jnp.eye(x.size, dtype=x.dtype)
        found = jax.vmap(lambda nudge: holds(unravel(x + x * nudge)))(
            jnp.concatenate([jnp.zeros_like(nudges[:1]), nudges, -nudges])
        )
        return jnp.all(found), jnp.any(found)

    return jax.vmap(one)(stacked)
