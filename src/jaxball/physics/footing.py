"""How a ground of any form holds a body at a state: its footing, in body axes where the equations need them."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..numerics.arrays import selected
from ..numerics.vectors import apply, cross
from .parameters import BodyParameters
from .state import BallState, Rates, RotationState
from .surfaces import AbstractSurface, Footing


def footing(system: BodyParameters, t: Float[Array, ""], state: Any) -> Footing | None:
    """How the surface under a body holds it; None on a plane."""
    surface = system.ground
    if not isinstance(surface, AbstractSurface):
        return None
    assert isinstance(state, BallState | RotationState)
    return surface.footing(t, system.radius, state.z, apply(state.Lambda, state.Omega))


def released_footing(
    system: BodyParameters,
    t: Float[Array, ""],
    state: Any,
    V: Float[Array, "3"],
    height: Float[Array, ""],
    touching: Bool[Array, ""] | bool,
) -> Footing | None:
    """How the surface under a body holds it while that slips or flies with the velocity ``V``; None on a plane.

    In flight no ground acts, and the motion is described as on a level plane at rest, for any height: the normal is e3,
    and the contact axes are those of space. ``coordinate_rates`` are always those of the piece that is nearest.
    """
    surface = system.ground
    if not isinstance(surface, AbstractSurface):
        return None
    assert isinstance(state, BallState | RotationState)
    r, omega = system.radius, apply(state.Lambda, state.Omega)
    held = surface.footing(t, r, state.z, omega, V, height)
    axes, none = jnp.eye(3, dtype=r.dtype), jnp.zeros_like(V)
    free = held._replace(
        normal=axes[2],
        tangents=axes[:2],
        velocity=none,
        spin=none,
        centre_velocity=r * cross(omega, axes[2]),
        normal_rate=none,
        acceleration=none,
        turning=none,
    )
    return selected(jnp.asarray(touching), held, free)


def contact_normal(system: BodyParameters, t: Float[Array, ""], state: Any) -> Float[Array, "3"]:
    """The normal of the ground towards the body, in body axes: Γ on a plane."""
    surface = system.ground
    if not isinstance(surface, AbstractSurface):
        return state.Gamma
    assert isinstance(state, BallState | RotationState)
    return apply(state.Lambda.T, surface.normal(t, state.z))


def rates(
    system: BodyParameters,
    t: Float[Array, ""],
    state: Any,
    Omegadot: Float[Array, "3"],
    angles: Rates,
    under: Footing | None,
) -> Any:
    """ẋ where Ω̇ is known, and θ, θ̇, θ̈: the kinematics of rolling. ``under`` is the :func:`footing`."""
    moved = state.rates(system.radius, Omegadot, angles, system.drift(t, state))
    return moved if under is None else eqx.tree_at(lambda x: x.z, moved, under.coordinate_rates)
