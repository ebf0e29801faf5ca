"""The law of contact on the command line: that of ``--contact``, and the history of the contact in a run."""

from typing import Any

import numpy as np

from ...physics.contact_law import Contact
from ...physics.modes import Cause, Mode
from ...scenario import ScenarioError
from ...scenario.body import CONTACT
from ...scenario.classical import CLASSICAL
from ...scenario.paths import with_values
from ...simulation.events import AbstractEvent
from ...simulation.history import ContactHistory, Switches


def with_contact(document: dict[str, Any], law: str | None) -> dict[str, Any]:
    """The document with its law replaced by that of ``--contact``, a kinetic coefficient or keys with values.

    **Raises:** :class:`~jaxball.ScenarioError` for a system that touches no plane.
    """
    if law is None:
        return document
    if document.get("kind") in CLASSICAL:
        raise ScenarioError(
            "Argument `--contact` must be left out for a system that touches no plane, such as a scenario of the kind "
            f'"{document["kind"]}".'
        )
    keys = law.split(",") if "=" in law else [f"sliding={law}"]
    others = {name: value for name, value in document.items() if name != "contact"}
    return with_values(others, [f"contact.{key.strip()}" for key in keys])


def check_against_contact(contact: Contact | None, events: dict[str, AbstractEvent]) -> None:
    """Raises where ``events`` would end a run at something that a law of contact allows."""
    if contact is not None and events:
        raise ScenarioError(
            "Arguments `--friction` and `--detachment` must be left out where the scenario has a law of contact, with "
            "which the body slips and flies instead of the run ending."
        )


def content(contact: ContactHistory) -> dict[str, Any]:
    """The contact in --json: the law, the mode at each saved time, the switches, and how it ended."""
    end = {name: np.asarray(getattr(contact, name))[-1] for name in ("V", "height", "slip", "rubbed", "struck")}
    modes = [_name(mode) for mode in np.asarray(contact.mode)]
    law = CONTACT.write(contact.law, "contact")
    return {"law": law, "modes": modes, "end": end, "count": int(contact.switches.count), "switches": _all(contact)}


def _all(contact: ContactHistory) -> list[dict[str, Any]]:
    switches: Switches = contact.switches
    kept = min(int(switches.count), switches.times.shape[-1])
    return [
        {
            "time": float(switches.times[k]),
            "from": _name(switches.source[k]),
            "to": _name(switches.target[k]),
            "cause": Cause(int(switches.cause[k])).sentence,
            "lost": float(switches.lost[k]),
            "grazing": bool(switches.grazing[k]),
        }
        for k in range(kept)
    ]


def _name(mode: Any) -> str | None:
    """The name of a mode; None at times that the solve did not reach."""
    return Mode(int(mode)).name.lower() if int(mode) >= 0 else None
