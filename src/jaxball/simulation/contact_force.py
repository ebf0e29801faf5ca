"""The contact force as numbers along a run, in the mode that a body is in; and quantities along runs, evaluated."""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..interface.arguments import traceable
from ..numerics.vectors import root
from ..physics.body import AbstractBodyWithModes
from ..physics.contact.body_on_plane import has_contact
from ..physics.contact.modes import Mode
from ..physics.contact.released import slip_velocity
from ..physics.rolling import AbstractRollingSystem
from ..physics.system import AbstractState

Held = AbstractRollingSystem | AbstractBodyWithModes  # what a plane holds, and so has a contact force
AnyQuantity = TypeVar("AnyQuantity", bound=Callable[..., Any])
_TAKE_MODES: list[Callable[..., Any]] = []


def takes_modes(quantity: AnyQuantity) -> AnyQuantity:
    """Marks a quantity that takes a system and its state as they are solved, with modes if the system has any."""
    _TAKE_MODES.append(quantity)
    return quantity


def values(
    quantities: Sequence[Callable[..., Any]], system: Any, t: Float[Array, ""], state: Any
) -> Float[Array, " k"]:
    """Returns the quantities at one time; of a body with modes those of the body, except for quantities that take
    modes.
    """
    # A user's quantity is written for a body, whatever its modes.
    shown = system.shown, system.state_to_show(state)

    def value(quantity: Callable[..., Any]) -> Float[Array, ""]:
        with traceable("quantity", quantity):
            model, model_state = (system, state) if quantity in _TAKE_MODES else shown
            return quantity(model, t, model_state)

    return jnp.stack([value(quantity) for quantity in quantities])


@takes_modes
def normal_force(system: Held, t: Float[Array, ""], state: AbstractState) -> Float[Array, ""]:
    """Returns N, the normal force."""
    return system.plane_reaction(t, state).normal


@takes_modes
def friction(system: Held, t: Float[Array, ""], state: AbstractState) -> Float[Array, ""]:
    """Returns |f|, the friction."""
    return system.plane_reaction(t, state).friction


@takes_modes
def half_tangent(system: Held, t: Float[Array, ""], state: Any) -> Float[Array, ""]:
    """Computes tan(α/2) for the angle α of the reaction from the vertical, which grows with |f| / N, smoothly past N =
    0.

    This avoids the arctangent, which takes as long as half of the equations of motion. With a law of contact, 0 in
    flight, and that of the coefficient of friction while the body slides.
    """
    R = system.plane_reaction(t, state)
    whole = R.normal + root(R.normal**2 + R.friction_squared)
    # Without friction a ground that would have to pull has α = π, where the quotient is 0/0.
    pulls = whole <= 0
    half = jnp.where(pulls, jnp.inf, R.friction / jnp.where(pulls, 1.0, whole))
    if not has_contact(system):
        return half
    # Where a sliding body lifts, N is the error of that time, of either sign, and the ratio of both forces is lost.
    mu = system.coefficient(slip_velocity(system.body, t, state.released))  # pyright: ignore
    slides, flies = state.is_in(Mode.SLIDING), state.is_in(Mode.FLIGHT)
    return jnp.where(slides, mu / (1 + jnp.sqrt(1 + mu**2)), jnp.where(flies, 0.0, half))


def tangent(half: Float[Array, "*runs"]) -> Float[Array, "*runs"]:
    """Computes |f| / N = tan α from tan(α/2); infinite where N ≤ 0."""
    held = ~(half >= 1)
    return jnp.where(held, 2 * half / jnp.where(held, 1 - half**2, 1.0), jnp.inf)
