"""Which parameters a body can have."""

from collections.abc import Iterator
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from .body import Ball, System


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


def problems(system: System) -> list[str]:
    """One sentence for each parameter that no body can have; an empty list when all is well."""
    masses = [
        Condition(_positive(item.mass), f"masses[{index}].mass", item.mass, "a positive number")
        for index, item in enumerate(system.point_masses)
    ]
    return [
        f"Argument `{c.name}` must be {c.must}, but it is {np.asarray(c.value).tolist()}."
        for c in [*shell_conditions(system), *masses]
        if not bool(c.holds)
    ]


def _positive(x: Array) -> Bool[Array, ""]:
    return jnp.all((x > 0) & jnp.isfinite(x))
