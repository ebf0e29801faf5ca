"""The system that is solved: a body with modes, of its contact or of its joints, as one hybrid system."""

from collections.abc import Mapping
from typing import Any

from ..interface.arguments import described, require
from ..interface.wording import all_of
from ..physics.body import AbstractBody
from ..physics.contact.body_on_plane import BodyOnPlane
from ..physics.contact.law import Contact
from ..physics.state import ReducedState
from ..physics.stick_slip import StickSlip
from ..physics.system import AbstractSystem
from .events import AbstractEvent, Detachment, Slip


def system_to_solve(
    system: AbstractSystem, state: Any, contact: Contact | None, dae: bool, events: Mapping[str, AbstractEvent]
) -> AbstractSystem:
    """The system that is solved: with a law of contact, the body on its plane; with joints that stick, their modes.

    **Raises:** ``TypeError`` or ``ValueError`` for a law that the system or the state has no equations for.
    """
    if contact is None:
        return StickSlip(system) if isinstance(system, AbstractBody) and system.sticking else system
    require("contact", contact, Contact, "a Contact, such as Contact(sliding=0.3)")
    if not isinstance(system, AbstractBody):
        raise TypeError(
            f"Argument `contact` must be None for a {type(system).__name__}, which is neither a Ball nor a Disk, but "
            f"it is {described(contact)}."
        )
    if system.sticking:
        have = "has" if len(system.sticking) == 1 else "have"
        raise TypeError(
            "Argument `contact` must be None for a body with joints that stick, because both have modes, which are not "
            f"combined, but {all_of(system.sticking)} {have} a JointFriction; give that `smoothing`."
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
