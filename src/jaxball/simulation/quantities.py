"""Evaluates numbers of a run by their names, such as ``z[0]`` or ``normal_force``, for events that are given a name."""

import re
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..interface.wording import did_you_mean
from ..numerics.arrays import arrays_of
from ..physics.body import AbstractBody
from ..physics.contact.body_on_plane import has_contact
from ..physics.observables import Observables, compute_observables, movement
from ..physics.rolling import AbstractRollingSystem
from ..physics.state import ReducedState

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
