"""The law of contact of a scenario file: Coulomb's friction and Newton's restitution."""

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from ..numerics.arrays import to_array
from ..physics.contact_law import SLOWEST, AbstractFriction, Contact
from ..physics.released import ReleasedState
from ..physics.system import AbstractState
from .own import Open, names_own, read_own
from .table import Key, Module, write_family
from .traced import require_conditions
from .values import Integer, Numbers, ScenarioError

ROOM = 64
COEFFICIENTS = ("sliding", "static", "restitution", "slowest")


FRICTIONS = Open(AbstractFriction, {})


@dataclass(frozen=True)
class _Sliding(Numbers):
    """The coefficient, or a user's class that has it for each slip speed."""

    def read(self, value: Any, path: str) -> Any:
        return read_own(value, path, FRICTIONS) if names_own(value) else super().read(value, path)

    def write(self, value: Any, path: str) -> Any:
        return (
            write_family(value, path, FRICTIONS) if isinstance(value, AbstractFriction) else super().write(value, path)
        )


def _law(sliding: Any, static: Any = None, *, room: int, **others: Any) -> Contact:
    """The law, without the checks of its constructor, because a reader reports these in the words of the file."""
    given, least = (sliding, sliding(jnp.zeros(()))) if isinstance(sliding, AbstractFriction) else (0.0, sliding)
    values = {"sliding": least, "static": least if static is None else static, **others}
    arrays = [to_array(values[name], name) for name in COEFFICIENTS]
    return eqx.tree_at(lambda law: [getattr(law, name) for name in COEFFICIENTS], Contact(given, room=room), arrays)


CONTACT = Module(
    Contact,
    {
        "sliding": Key(_Sliding()),
        "static": Key(Numbers(), None),
        "restitution": Key(Numbers(), 0.0),
        "slowest": Key(Numbers(), SLOWEST),
        "room": Key(Integer(1, 10**6), ROOM),
    },
    build=_law,
    attributes={"sliding": "law_of_sliding"},
)


def read_contact(values: Any, path: str) -> Contact:
    """The law of contact."""
    contact = CONTACT.read(values, path)
    require_conditions(contact)
    return contact


def rolling_state(
    state: AbstractState | ReleasedState, contact: Contact | None, what: str, error: type[ScenarioError] = ScenarioError
) -> AbstractState:
    """The state of a scenario, for ``what`` (with its verb), which is for bodies that always roll.

    **Raises:** ``error`` where the scenario has a law of contact.
    """
    if contact is not None:
        raise error(
            f"Key `contact` must be left out here, because {what} for bodies that always roll; `jaxball simulate` and "
            "studies accept it."
        )
    assert not isinstance(state, ReleasedState)  # which exists only with a law
    return state
