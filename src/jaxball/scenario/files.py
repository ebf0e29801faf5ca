"""Scenario files: text to scenario and back."""

import tomllib
from pathlib import Path
from typing import Any

import tomli_w

from ..body import Ball, Disk
from ..classical import AbstractClassicalState, AbstractClassicalSystem
from ..simulable import SimulableState, SimulableSystem
from .actuation import apply_actuation, write_actuation
from .body import kind_of, read_force, read_shell, write_body
from .classical import CLASSICAL, read_classical, write_classical
from .initial import balanced, initial_state, read_initial, write_initial
from .library import builtin_scenarios, builtin_text, nearest
from .masses import read_masses, write_masses
from .scenario import Scenario
from .shell import check_confined
from .solve import SOLVE, check_dae
from .table import Key, read_table, write_table
from .times import read_times, write_times
from .values import Choice, Integer, Nested, ScenarioError, Text

FORMAT = 1


def _as_it_is(value: Any, path: str) -> Any:
    return value


_WHOLE = Nested(_as_it_is, _as_it_is)
_KEYS = {
    "format": Key(Integer(FORMAT, FORMAT)),
    "title": Key(Text(), ""),
    "kind": Key(Choice(("ball", "disk", *CLASSICAL))),
    "body": Key(_WHOLE),
    "force": Key(_WHOLE, None),
    "masses": Key(_WHOLE, ()),
    "actuation": Key(_WHOLE, None),
    "initial": Key(_WHOLE, None),
    "time": Key(_WHOLE),
    "solve": Key(_WHOLE, None),
}


_CLASSICAL_KEYS = {name: _KEYS[name] for name in ("format", "title", "kind", "initial", "time", "solve")}
_CLASSICAL_KEYS["body"] = Key(_WHOLE, None)


def load_scenario(source: str | Path) -> Scenario:
    """The scenario of a file, or the built-in one of that name.

    **Raises:** :class:`ScenarioError`, with one sentence, when there is no such file or name, when it
    is not TOML, and when a key is misspelt, missing, of the wrong type or shape, or impossible.
    """
    if isinstance(source, str) and source in builtin_scenarios():
        return read_scenario(builtin_text(source))
    try:
        text = Path(source).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise ScenarioError(
            f"Argument `source` must be a scenario file or one of {', '.join(builtin_scenarios())}, but "
            f'it is "{source}" ({reason}){nearest(str(source))}.'
        ) from None
    return read_scenario(text)


def read_scenario(text: str) -> Scenario:
    """The scenario that the text of a file describes.

    **Raises:** :class:`ScenarioError`, with one sentence, when the text is not TOML, or a key is
    misspelt, missing, of the wrong type or shape, or impossible.
    """
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"A scenario must be a TOML document, but it is not: {error}.") from None
    return read_document(document)


def read_document(document: dict[str, Any]) -> Scenario:
    """The scenario that a parsed file describes, which is left as it is.

    **Raises:** :class:`ScenarioError` as :func:`read_scenario`.
    """
    if document.get("kind") in tuple(CLASSICAL):
        return _classical(document)
    found = read_table(document, "", _KEYS)
    kind = found["kind"]
    shell = read_shell(found["body"], "body", kind)
    if found["force"] is not None:
        shell["force"] = read_force(found["force"], "force", kind)
    times = read_times(found["time"], "time")
    start = float(times[0])
    solve = read_table({} if found["solve"] is None else found["solve"], "solve", SOLVE)
    masses = read_masses(list(found["masses"]) if found["masses"] == () else found["masses"], "masses")
    initial = read_initial({} if found["initial"] is None else found["initial"], "initial", kind)
    masses = balanced(masses, shell, initial, "initial", kind, start)
    actuation = {"form": "prescribed"} if found["actuation"] is None else found["actuation"]
    masses, law, followed = apply_actuation(actuation, "actuation", masses)
    system = (Disk if kind == "disk" else Ball)(**shell, masses=masses, law=law)
    state = initial_state(initial, "initial", kind, followed, start)
    check_dae(system, solve["solver"], solve["dae"])
    check_confined(system, times, state)
    return Scenario(found["title"], system, state, times, **solve)


def _classical(document: dict[str, Any]) -> Scenario:
    found = read_table(document, "", _CLASSICAL_KEYS)
    times = read_times(found["time"], "time")
    solve = read_table({} if found["solve"] is None else found["solve"], "solve", SOLVE)
    system, state = read_classical(found["kind"], found["body"], found["initial"], float(times[0]))
    check_dae(system, solve["solver"], solve["dae"])
    return Scenario(found["title"], system, state, times, **solve)


def write_scenario(scenario: Scenario) -> str:
    """The text of a file that describes the scenario; reading it gives the same numbers, bit for bit.

    **Raises:** :class:`ScenarioError` for what a file cannot hold: Python functions, and states other
    than that of a ball with a versor and of a disk.
    """
    found = {
        "format": FORMAT,
        "title": scenario.title,
        **_tables(scenario.system, scenario.state),
        "time": write_times(scenario.times),
        "solve": write_table({name: getattr(scenario, name) for name in SOLVE}, "solve", SOLVE),
    }
    return tomli_w.dumps({name: value for name, value in found.items() if value not in ({}, [], "")})


def _tables(system: SimulableSystem, state: SimulableState) -> dict[str, Any]:
    """The kind of a system, and the tables of its parameters and of its state."""
    if isinstance(system, AbstractClassicalSystem) and isinstance(state, AbstractClassicalState):
        return write_classical(system, state)
    assert not isinstance(system, AbstractClassicalSystem)
    assert not isinstance(state, AbstractClassicalState)
    return {
        "kind": kind_of(system),
        **write_body(system),
        "masses": write_masses(system, "masses"),
        "actuation": write_actuation(system),
        "initial": write_initial(system, state),
    }
