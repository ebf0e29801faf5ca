"""A run through several modes, as a trajectory of the body."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..interface.arguments import described, require
from ..physics.body import AbstractBody
from ..physics.body_on_plane import BodyOnPlane
from ..physics.contact_law import Contact
from ..physics.modes import ContactState
from ..physics.packing import Packing
from ..physics.state import ReducedState
from .events import AbstractEvent, Detachment, Slip
from .history import NOWHERE, ContactHistory, Switches
from .switching import Kept


def on_plane(system: Any, state: Any, contact: Contact, dae: bool, events: Mapping[str, AbstractEvent]) -> BodyOnPlane:
    """The system of a body with a law of contact.

    **Raises:** ``TypeError`` or ``ValueError`` for a system without contact, or a state without equations for it.
    """
    require("contact", contact, Contact, "a Contact, such as Contact(sliding=0.3)")
    if not isinstance(system, AbstractBody):
        raise TypeError(
            f"Argument `contact` must be None for a {type(system).__name__}, which touches no plane, but it is "
            f"{described(contact)}."
        )
    if isinstance(state, ReducedState):
        raise TypeError(
            "Argument `state` must be a BallState, a RotationState, a DiskState or a ReleasedState with `contact`, "
            "because a body that may slip has a velocity and a position, but it is a ReducedState."
        )
    if dae:
        raise ValueError(
            "Argument `dae` must be False with `contact`, whose modes are differential equations, but it is True."
        )
    for name, event in events.items():
        if isinstance(event, Detachment | Slip):
            raise TypeError(
                f"Argument `events` must hold no {type(event).__name__} with `contact`, which says what happens then, "
                f'but "{name}" is one; `trajectory.contact.switches` has the times.'
            )
    return BodyOnPlane(system, contact)


class Unpacked(NamedTuple):
    """Switches as they are kept, with their states before and after."""

    kept: Kept
    before: ContactState
    after: ContactState


def unpacked_switches(packing: Packing, kept: Kept) -> Unpacked:
    """All switches of a run; NaN where there is room for more."""

    def unpacked(one: Kept) -> Unpacked:
        known = jnp.isfinite(one.times)
        t = jnp.where(known, one.times, 0.0)
        return Unpacked(one, *(packing.unpack_where(known, t, vector) for vector in (one.before, one.after)))

    return jax.lax.map(unpacked, kept)


def history(
    law: Contact, saved: ContactState, slip: Array, sigma: Array, count: Array, switches: Unpacked
) -> ContactHistory:
    """The history of the contact in one run."""
    (times, causes, _, _, grazing), before, after = switches
    known = jnp.isfinite(times)
    return ContactHistory(
        law=law,
        mode=_whole(saved.mode),
        V=saved.V,
        height=saved.height,
        slip=slip,
        sigma=sigma,
        rubbed=saved.rubbed,
        struck=saved.struck,
        switches=Switches(
            count=count,
            times=times,
            cause=jnp.where(known, causes, NOWHERE),
            source=_whole(before.mode),
            target=_whole(after.mode),
            before=before.released,
            after=after.released,
            lost=after.struck - before.struck,
            grazing=grazing & known,
        ),
    )


def _whole(mode: Array) -> Array:
    return jnp.where(jnp.isfinite(mode), mode, NOWHERE).astype(int)
