"""Numbers along a run: those that events and reductions ask for, by a function or a name such as ``z[0]``, and the
contact force, in the mode that a body is in.
"""

import re
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..interface.arguments import traceable
from ..interface.wording import did_you_mean
from ..numerics.arrays import arrays_of
from ..numerics.vectors import root
from ..physics.body import AbstractBody
from ..physics.contact.body_on_plane import BodyOnPlane, has_contact
from ..physics.contact.modes import Mode
from ..physics.contact.released import slip_velocity
from ..physics.observables import Observables, compute_observables, movement
from ..physics.rolling import AbstractRollingSystem
from ..physics.state import ReducedState
from ..physics.system import AbstractState

Held = AbstractRollingSystem | BodyOnPlane  # what a plane holds, and so has a contact force
AnyQuantity = TypeVar("AnyQuantity", bound=Callable[..., Any])
_TAKE_MODES: list[Callable[..., Any]] = []
_PATH = re.compile(r"(\w+)((?:\[\d+\])*)")
# Of a body that may slip, fly and land, besides those of its state and its observables.
_RELEASED = ("V", "height", "friction_loss", "impact_loss")


def quantity(path: str, system: Any, t: Float[Array, ""], state: Any) -> Float[Array, ""]:
    """Evaluates a quantity by its path: a component of the state, an observable, or a law.

    - ``path``: its name, with the index of a component in brackets, counted from 0.
    - ``system``, ``state``: as they are solved, with modes if the system has any.

    **Raises:** ``ValueError`` where there is no such number.
    """
    matched = _PATH.fullmatch(path.strip())
    readers = _readers(system, t, state)
    if matched is None or matched[1] not in readers:
        hint = did_you_mean(path, readers, "it must be one of " + ", ".join(readers))
        raise ValueError(
            f'Argument `of` must be a function or the name of a number of a run, but it is "{path}", which a '
            f"{type(system.shown).__name__} does not have{hint}"
        )
    value = jnp.asarray(readers[matched[1]]())
    index = tuple(map(int, re.findall(r"\d+", matched[2])))
    if len(index) != value.ndim or any(k >= size for k, size in zip(index, value.shape, strict=True)):
        form = "a number, without an index" if not value.ndim else f"an array of shape {value.shape}; name one number"
        example = "" if not value.ndim else f", such as {matched[1]}{'[0]' * value.ndim}"
        raise ValueError(
            f'Argument `of` must name one number, but it is "{path}", and `{matched[1]}` is {form}{example}.'
        )
    return value[index]


def observables_of(system: Any, t: Float[Array, ""], state: Any) -> Observables:
    """Computes the observables of a body in one state, as ``run.observables`` has them; with modes, in its own mode.

    **Raises:** ``TypeError`` for another system, ``ValueError`` for a state without the position of the body.
    """
    if not isinstance(system.shown, AbstractBody):
        raise TypeError(
            f"Observables are those of a ball or a disk, but the system is a {type(system.shown).__name__}; leave the "
            "parameter `observables` out of the function."
        )
    if isinstance(state, ReducedState):
        raise ValueError("Observables need the full state, but the state is a ReducedState; simulate with a BallState.")
    return compute_observables(system.shown, t, movement(system, t, state))


def _readers(system: Any, t: Float[Array, ""], state: Any) -> dict[str, Callable[[], Any]]:
    """Returns functions without arguments, by the names of the numbers that they compute."""
    shown, seen = system.shown, system.state_to_show(state)
    readers: dict[str, Callable[[], Any]] = {name: lambda leaf=leaf: leaf for name, leaf in arrays_of(seen).items()}
    if has_contact(system):
        readers |= {name: lambda name=name: getattr(state, name) for name in _RELEASED}
    if isinstance(shown, AbstractBody) and not isinstance(state, ReducedState):
        names = (*Observables.__dataclass_fields__, "energy")
        return readers | {name: lambda name=name: getattr(observables_of(system, t, state), name) for name in names}
    if isinstance(shown, AbstractRollingSystem):
        readers["normal_force"] = lambda: shown.plane_reaction(t, seen).normal
        readers["friction_ratio"] = lambda: shown.plane_reaction(t, seen).ratio
    if not isinstance(shown, AbstractBody):
        laws = jax.eval_shape(shown.laws, t, seen)
        readers |= {name: lambda name=name: getattr(shown.laws(t, seen), name) for name in laws._fields}
    return readers


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
    # At the time at which a body lifts N is the error of that time, of either sign, and the ratio of both forces is
    # lost: of a body that slid it was μ, and one that rolled has needed no friction at the last.
    mu = system.coefficient(slip_velocity(system.body, t, state.released))  # pyright: ignore
    slides, lifts = state.is_in(Mode.SLIDING), state.is_in(Mode.FLIGHT) | (R.normal <= 0)
    return jnp.where(slides, mu / (1 + jnp.sqrt(1 + mu**2)), jnp.where(lifts, 0.0, half))


def tangent(half: Float[Array, "*runs"]) -> Float[Array, "*runs"]:
    """Computes |f| / N = tan α from tan(α/2); infinite where N ≤ 0."""
    held = ~(half >= 1)
    return jnp.where(held, 2 * half / jnp.where(held, 1 - half**2, 1.0), jnp.inf)
