"""How a ground of any form holds a body at a state: its footing, in body axes where the equations need them."""

from typing import Any

import equinox as eqx
from jaxtyping import Array, Float, Int

from ..numerics.vectors import apply
from .parameters import BodyParameters
from .state import BallState, PlacedState, Rates
from .surfaces import AbstractSurface, Footing


def surface_under(system: BodyParameters, t: Float[Array, ""], state: Any) -> AbstractSurface | None:
    """The surface under a body at a state, which tells where a law has driven it; None on a plane."""
    surface = system.ground
    if not isinstance(surface, AbstractSurface):
        return None
    if not surface.driven:
        return surface
    assert system.law is not None
    count = len(surface.driven)
    accelerations = system.law.among(system.accelerated, t, state)
    return surface.following(t, *(values[-count:] for values in (state.theta, state.thetadot, accelerations)))


def footing(system: BodyParameters, t: Float[Array, ""], state: Any) -> Footing | None:
    """How the surface under a body holds it; None on a plane."""
    surface = surface_under(system, t, state)
    if surface is None:
        return None
    assert isinstance(state, PlacedState)
    return surface.footing(t, system.radius, state.z, apply(state.Lambda, state.Omega))


def contact_normal(system: BodyParameters, t: Float[Array, ""], state: Any) -> Float[Array, "3"]:
    """The normal of the ground towards the body, in body axes: Γ on a plane."""
    surface = surface_under(system, t, state)
    if surface is None:
        return state.Gamma
    assert isinstance(state, PlacedState)
    return apply(state.Lambda.T, surface.normal(t, state.z))


def in_space(system: BodyParameters, state: Any) -> BallState:
    """A state as that of a ball in space; on a surface ``z`` has both coordinates of the contact point of a disk."""
    space, surface = state.in_space(), system.ground
    if not isinstance(surface, AbstractSurface) or not system.planar:
        return space
    return eqx.tree_at(lambda x: x.z, space, surface.coordinates(state.z))


def has_end(system: Any) -> bool:
    """Whether a system is a body on a surface, which may not let it go on."""
    return isinstance(getattr(system, "ground", None), AbstractSurface)


def end_of_ground(system: BodyParameters, t: Float[Array, ""], state: Any) -> Int[Array, ""]:
    """Whether the surface under a body does not let it go on from a state: a status, or SUCCESS if it does."""
    surface = surface_under(system, t, state)
    assert surface is not None
    return surface.end(t, system.radius, state.z)


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
