"""The system that is solved: a body with modes, of its contact or of its joints, as one hybrid system."""

from ..interface.arguments import described, require
from ..interface.wording import all_of
from ..physics.body import AbstractBody
from ..physics.contact.body_on_plane import BodyOnPlane
from ..physics.contact.law import Contact
from ..physics.stick_slip import StickSlip
from ..physics.system import AbstractSystem


def system_to_solve(system: AbstractSystem, contact: Contact | None) -> AbstractSystem:
    """The system that is solved: with a law of contact, the body on its plane; with joints that stick, their modes.

    Everything else asks it, and not whether there is a law.

    **Raises:** ``TypeError`` for a law that the system has no equations for.
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
    return BodyOnPlane(system, contact)
