"""Which parameters a body can have."""

import dataclasses
from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from .body import Ball, System
from .state import BallState, ReducedState, RotationState, State
from .vectors import cross, dot

UNIT = 1e-6  # how far the square of a unit vector may be from 1


class Condition(NamedTuple):
    """A condition on a parameter: whether it holds, which parameter, what it is and what it must be."""

    holds: Bool[Array, ""]
    name: str
    value: Array
    must: str


def shell_conditions(system: System) -> Iterator[Condition]:
    """Every condition that the parameters of the shell must meet; traceable."""
    yield Condition(_positive(system.mass), "mass", system.mass, "a positive number")
    yield Condition(_positive(system.radius), "radius", system.radius, "a positive number")
    yield Condition(_positive(system.inertia), "inertia", system.inertia, "positive")
    if isinstance(system, Ball):
        d = system.inertia
        yield Condition(
            jnp.all(2 * d <= jnp.sum(d) * (1 + 1e-6)),
            "inertia",
            d,
            "three moments of which none exceeds the sum of the other two, as in every real body",
        )
    yield Condition(jnp.isfinite(system.gravity), "gravity", system.gravity, "a finite number")
    yield Condition(
        jnp.sum(system.offset**2) <= system.radius**2,
        "offset",
        system.offset,
        "a point inside the shell, nearer to the centre than the radius",
    )


def possible(system: System) -> Bool[Array, ""]:
    """Whether a body with these parameters can exist; traceable."""
    masses = [_positive(group.mass) for group in system.groups]
    return jnp.all(jnp.stack([c.holds for c in shell_conditions(system)] + masses))


def state_conditions(state: State) -> Iterator[Condition]:
    """Every condition that an initial state must meet; traceable. What is not finite meets none."""
    if isinstance(state, BallState):
        size = jnp.sum(state.q**2)
        yield Condition(
            jnp.abs(size - 1) < UNIT, "state.q", state.q, "a versor, four numbers whose squares add up to 1"
        )
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


def possible_state(state: State) -> Bool[Array, ""]:
    """Whether a solve can start from this state; traceable."""
    return jnp.all(jnp.stack([c.holds for c in state_conditions(state)]))


def problems(system: System, state: State | None = None) -> list[str]:
    """One sentence for each number of a body, and of its initial state, that cannot be; empty when all is well."""
    found = list(shell_conditions(system))
    for index, item in enumerate(system.point_masses):
        found.append(Condition(_positive(item.mass), f"masses[{index}].mass", item.mass, "a positive number"))
    if state is not None:
        found.extend(state_conditions(state))
    return [
        f"Argument `{c.name}` must be {c.must}, but it is {np.asarray(c.value).tolist()}."
        for c in found
        if not bool(c.holds)
    ]


def _names(state: State) -> list[str]:
    return [field.name for field in dataclasses.fields(state)]


def _positive(x: Array) -> Bool[Array, ""]:
    return jnp.all((x > 0) & jnp.isfinite(x))
