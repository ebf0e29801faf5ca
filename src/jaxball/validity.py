"""Which parameters a body can have."""

import dataclasses
from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ._arrays import Numbers, to_array
from .body import Ball, System
from .classical import AbstractClassicalState, AbstractClassicalSystem
from .conditions import UNIT, Condition, positive, positive_inertia, real_inertia, versor
from .simulable import SimulableState, SimulableSystem, require_system
from .state import BallState, ReducedState, RotationState, State
from .vectors import cross, dot


def shell_conditions(system: System) -> Iterator[Condition]:
    """Every condition that the parameters of the shell must meet; traceable."""
    yield Condition(positive(system.mass), "mass", system.mass, "a positive number")
    yield Condition(positive(system.radius), "radius", system.radius, "a positive number")
    yield positive_inertia(system.inertia)
    if isinstance(system, Ball):
        yield real_inertia(system.inertia)
    yield Condition(jnp.isfinite(system.gravity), "gravity", system.gravity, "a finite number")
    yield Condition(
        jnp.sum(system.offset**2) <= system.radius**2,
        "offset",
        system.offset,
        "a point inside the shell, nearer to the centre than the radius",
    )


def possible(system: SimulableSystem) -> Bool[Array, ""]:
    """Whether a body with these parameters can exist; traceable."""
    if isinstance(system, AbstractClassicalSystem):
        return _all(system.conditions())
    masses = [positive(group.mass) for group in system.groups]
    return jnp.all(jnp.stack([c.holds for c in shell_conditions(system)] + masses))


def state_conditions(state: SimulableState) -> Iterator[Condition]:
    """Every condition that an initial state must meet; traceable. What is not finite meets none."""
    if isinstance(state, AbstractClassicalState):
        yield from state.conditions()
        return
    if isinstance(state, BallState):
        yield versor(state.q)
    if isinstance(state, RotationState):
        excess = jnp.sum(state.Lambda[:, :, None] * state.Lambda[:, None, :], axis=0) - jnp.eye(3, dtype=state.z.dtype)
        right_handed = dot(cross(state.Lambda[0], state.Lambda[1]), state.Lambda[2]) > 0
        holds = (jnp.max(jnp.abs(excess)) < UNIT) & right_handed
        yield Condition(holds, "state.Lambda", state.Lambda, "a rotation matrix")
    if isinstance(state, ReducedState):
        size = jnp.sum(state.Gamma**2)
        yield Condition(jnp.abs(size - 1) < UNIT, "state.Gamma", state.Gamma, "a unit vector")
    for name, value in zip(_names(state), jax.tree.leaves(state), strict=True):
        yield Condition(jnp.all(jnp.isfinite(value)), f"state.{name}", value, "finite")


def possible_state(state: SimulableState) -> Bool[Array, ""]:
    """Whether a solve can start from this state; traceable."""
    return _all(state_conditions(state))


def possible_start(system: SimulableSystem, t: Float[Array, ""], state: SimulableState) -> Bool[Array, ""]:
    """Whether a solve of ``system`` can start from ``state`` at time ``t``; traceable."""
    holds = possible(system) & possible_state(state)
    if isinstance(system, AbstractClassicalSystem):
        return holds & _all(system.start_conditions(t, state))
    return holds


def problems(system: SimulableSystem, state: SimulableState | None = None, t: Numbers = 0.0) -> list[str]:
    """One sentence for each number of a body, and of its state at ``t``, that cannot be; empty when all is well.

    **Arguments:**

    - ``system``: a body, or a system of :mod:`jaxball.classical`.
    - ``state``: its state; only the parameters are looked at if not given.
    - ``t``: the time of that state.
    """
    require_system(system)
    classical = isinstance(system, AbstractClassicalSystem)
    found = list(system.conditions() if classical else shell_conditions(system))
    if not classical:
        for index, item in enumerate(system.point_masses):
            found.append(Condition(positive(item.mass), f"masses[{index}].mass", item.mass, "a positive number"))
    if state is not None:
        found.extend(state_conditions(state))
    if state is not None and classical:
        found.extend(system.start_conditions(to_array(t, "t"), state))
    return [
        f"Argument `{c.name}` must be {c.must}, but it is {np.asarray(c.value).tolist()}."
        for c in found
        if not bool(c.holds)
    ]


def _names(state: State) -> list[str]:
    return [field.name for field in dataclasses.fields(state)]


def _all(conditions: Iterator[Condition]) -> Bool[Array, ""]:
    holds = [c.holds for c in conditions]
    return jnp.all(jnp.stack(holds)) if holds else jnp.asarray(True)
