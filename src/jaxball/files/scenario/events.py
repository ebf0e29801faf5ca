"""Events in a scenario file: what a run looks for, and what ends it."""

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import equinox as eqx

from ...numerics.arrays import to_array
from ...numerics.declare import POSITIVE
from ...physics.contact.law import Contact
from ...physics.system import AbstractSystem
from ...simulation.events import DOWN, EITHER, UP, AbstractEvent, Detachment, Event, Slip, check_events
from .errors import ScenarioError, each_of
from .imports import is_python_name
from .own import Function, Open, names_own, read_own, trying, trying_class
from .table import Family, Key, Module, join, keys_of, read_by_name, read_family, write_family
from .values import Choice, Flag, Integer, Numbers, Text, is_traced_document, unread

DIRECTIONS = {"rising": UP, "falling": DOWN, "both": EITHER}
MOST_KEPT = 10**6


@dataclass(frozen=True)
class _Quantity(Text):
    """What crosses a level: a number of the run by its name, or a function that can be imported."""

    words: str = 'the name of a number, such as "z[0]" or "normal_force", or a function, as "module:function"'

    def read(self, value: Any, path: str) -> Any:
        text = super().read(value, path)
        return Function().read(text, path) if is_python_name(text) else text

    def write(self, value: Any, path: str) -> str:
        return value if isinstance(value, str) else Function().write(value, path)


@dataclass(frozen=True)
class _Direction(Choice):
    """The name of a direction, which an event has as a number."""

    def write(self, value: Any, path: str) -> str:
        return next(name for name, direction in DIRECTIONS.items() if value in (name, direction))


def _crossing(of: Any, level: Any, direction: str, terminal: bool, capacity: int) -> Event:
    return Event(of, DIRECTIONS[direction], terminal, capacity, level)


_ENDING = {"terminal": Key(Flag(), True), "capacity": Key(Integer(1, MOST_KEPT), 8)}
CROSSING = Module(
    Event,
    {
        "of": Key(
            _Quantity(),
            says="the number of the run that crosses a level: an observable, a component of the state, of other "
            "systems also a "
            "law, or a function of yours, called with (system, t, state)",
        ),
        "level": Key(Numbers(), 0.0, says="the value that is crossed"),
        "direction": Key(_Direction(tuple(DIRECTIONS)), "both", says="the crossings that count"),
        "terminal": Key(Flag(), False),
        "capacity": Key(Integer(1, MOST_KEPT), 64),
    },
    build=_crossing,
)
_KINDS: Family = {
    "slip": Module(Slip, {"friction": Key(Numbers(rule=POSITIVE)), **_ENDING}),
    "detachment": Module(Detachment, _ENDING),
}
EVENTS = Open(AbstractEvent, {"": CROSSING, **_KINDS})
KEYS = {
    "events": Key(
        unread("a table of tables", keys_of(EVENTS), forms=("by name",)),
        None,
        says="what runs look for, each under [events.name]",
    )
}


def read_events(values: Any, path: str) -> dict[str, AbstractEvent]:
    """Reads the events by their names, which files and messages use."""
    return read_by_name(values, path, _read_event)


def _read_event(values: Any, path: str) -> AbstractEvent:
    if names_own(values):
        return read_own(values, path, EVENTS)
    if isinstance(values, dict) and "kind" in values:
        return read_family(values, path, _KINDS)
    with trying(join(path, "of"), "of"):
        return CROSSING.read(values, path)


def check_events_of(
    events: Mapping[str, AbstractEvent],
    path: str,
    system: AbstractSystem,
    contact: Contact | None,
    start: Any,
    state: Any,
) -> None:
    """Raises a :class:`ScenarioError` for an event that cannot happen to a system, and for one of no number of it.

    Of a document whose numbers are traced nothing is checked, because it has been read with known ones before.

    - ``start``, ``state``: the first time and the state then, of which only the shapes matter.
    """
    if not events or is_traced_document():
        return
    from ...simulation.arguments import system_to_solve  # here, because most files have no events

    solved = system_to_solve(system, contact)
    try:
        check_events(solved, events)
    except TypeError as error:
        raise ScenarioError(str(error).replace("Argument ", "Key ", 1)) from None
    arguments = solved, to_array(start), state
    each_of(*(functools.partial(_evaluate, event, join(path, name), *arguments) for name, event in events.items()))


def _evaluate(event: AbstractEvent, path: str, system: AbstractSystem, t: Any, state: Any) -> None:
    """Traces the function of an event, of which an error becomes one of its key."""

    def value(system: Any, t: Any, state: Any) -> Any:
        return event.value_in_solve(system.prepare(), t, system.start(t, state))

    crossing = isinstance(event, Event)
    with trying(join(path, "of"), "of") if crossing else trying_class(join(path, "kind"), type(event).__name__):
        # Traced for shapes only: an error appears, and nothing is computed.
        eqx.filter_eval_shape(value, system, t, state)


def write_events(events: Mapping[str, AbstractEvent], path: str) -> dict[str, Any]:
    """Returns the tables of the events by name."""
    return {name: write_family(event, join(path, name), EVENTS) for name, event in events.items()}
