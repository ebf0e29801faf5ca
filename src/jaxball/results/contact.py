"""The contact of a saved run: its modes at the saved times, its switches, and the law, in a file and back."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from ..numerics.arrays import to_array
from ..physics.contact_law import Contact
from ..physics.released import ReleasedState
from ..simulation.history import ContactHistory, Switches
from ..simulation.modal import NOWHERE
from .variables import CONTACT_STATE, STATE, Variable

COEFFICIENTS = ("sliding", "static", "restitution", "slowest")
SWITCHES = {
    "times": Variable((), "time", "when the mode of contact changed"),
    "cause": Variable((), "1", "why it changed, the number of a jaxball.Cause"),
    "source": Variable((), "1", "mode before it, the number of a jaxball.Mode"),
    "target": Variable((), "1", "mode after it, the number of a jaxball.Mode"),
    "lost": Variable((), "energy", "energy that an impact took"),
    "grazing": Variable((), "1", "whether what ended the mode touched zero rather than crossing it"),
}
SIDES = ("before", "after")


def law_attributes(contact: ContactHistory | None) -> dict[str, float | int]:
    """The law, how many switches there were and for how many there was room; nothing without a law of contact."""
    if contact is None:
        return {}
    numbers = {f"contact_{name}": float(getattr(contact.law, name)) for name in COEFFICIENTS}
    return numbers | {"contact_room": contact.law.room, "contact_switches": int(contact.switches.count)}


def switch_values(contact: ContactHistory | None) -> dict[str, tuple[Variable, np.ndarray]]:
    """Every variable of the kept switches with its array, ``switch`` first; nothing without a law of contact."""
    if contact is None:
        return {}
    kept = _kept(int(contact.switches.count), contact.law)
    values = {f"switch_{name}": (one, getattr(contact.switches, name)) for name, one in SWITCHES.items()}
    for side in SIDES:
        for name, leaf in _fields(getattr(contact.switches, side)).items():
            known = (STATE | CONTACT_STATE)[name]
            fits = known if np.ndim(leaf) == 1 + len(known.dimensions) else known._replace(dimensions=())
            values[f"switch_{side}_{name}"] = fits._replace(meaning=f"{known.meaning}, {side} a switch"), leaf
    return {name: (variable, np.asarray(leaf)[:kept]) for name, (variable, leaf) in values.items() if np.size(leaf)}


def history_in(arrays: Mapping[str, np.ndarray], about: Mapping[str, Any], states: Any) -> ContactHistory | None:
    """The contact that a file holds, of a run whose bodies have these ``states``; None where it has no law.

    **Raises:** ``KeyError`` where a part of it is missing.
    """
    if "contact_switches" not in about:
        return None
    count, room = int(about["contact_switches"]), int(about["contact_room"])
    law = Contact(*(float(about[f"contact_{name}"]) for name in COEFFICIENTS), room=room)

    def padded(values: Any, empty: Any) -> Any:
        return jnp.asarray(np.concatenate([values, np.full((room - len(values), *values.shape[1:]), empty)]))

    def side(which: str) -> ReleasedState:
        body = {field.name: getattr(states, field.name) for field in dataclasses.fields(states)}
        kept = {
            name: arrays.get(f"switch_{which}_{name}", np.zeros((_kept(count, law), *leaf.shape[1:])))
            for name, leaf in body.items()
        }
        V, height = (padded(arrays[f"switch_{which}_{name}"], np.nan) for name in ("V", "height"))
        return ReleasedState(type(states)(**{name: padded(leaf, np.nan) for name, leaf in kept.items()}), V, height)

    empty = {"times": np.nan, "lost": np.nan, "grazing": False}
    switches = {name: padded(arrays[f"switch_{name}"], empty.get(name, NOWHERE)) for name in SWITCHES}
    saved = {name: to_array(arrays[name]) for name in CONTACT_STATE if name != "mode"}
    return ContactHistory(
        law=law,
        mode=jnp.asarray(arrays["mode"]),
        **saved,
        switches=Switches(count=jnp.asarray(count), before=side("before"), after=side("after"), **switches),
    )


def _kept(count: int, law: Contact) -> int:
    return min(count, law.room)


def _fields(state: ReleasedState) -> dict[str, Any]:
    return {**vars(state.body), "V": state.V, "height": state.height}
