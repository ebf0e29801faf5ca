"""Scenario files: text to scenario and back."""

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
import tomli_w

from ...interface.arguments import require
from ...physics.body import System
from ...physics.contact.law import Contact
from ...physics.prescribed.motion import Driven
from ...physics.sensors import AbstractSensor
from ...physics.system import AbstractSystem
from ...simulation.events import AbstractEvent
from .actuation import FORMS, apply_actuation, is_linear, targets_of, write_actuation
from .body import (
    BODIES,
    CONTACT,
    KEYS as BODY_KEYS,
    check_contact,
    check_force,
    check_own_states,
    check_sensors,
    kind_of,
    read_contact,
    read_sensors,
    read_shell,
    read_surroundings,
    write_body,
    write_sensors,
)
from .checks import check_confinement, check_run, check_start
from .classical import CLASSICAL, INITIAL as CLASSICAL_INITIAL, RESISTED, read_classical, write_classical
from .errors import ScenarioError, all_problems, each_of, raise_first, try_readers
from .events import KEYS as EVENT_KEYS, check_events_of, read_events, write_events
from .feedback import (
    ESTIMATOR,
    FEEDBACK,
    KEYS as FEEDBACK_KEYS,
    AbstractFeedbackSettings,
    EstimatorSettings,
    check_feedback,
    write_settings,
)
from .grounds import ReadPlate, write_targets
from .imports import is_python_name
from .initial import INITIAL, balance_schedules, initial_state, read_initial, release, write_initial
from .logs import with_logs
from .mechanisms import MECHANISM, joints_in_state, read_mechanisms, write_mechanisms
from .motions import MASSES, read_masses, write_masses
from .paths import has_path, key_of, numbers_of, value_at, with_values
from .scenario import Scenario
from .solve import SOLVE, TIMES, SaveTimes, check_dae, check_projection, read_times, write_times
from .sources import SCENARIO, document_of, naming, scenario_text
from .table import Key, keeping_defaults, keys_of, read_family, read_table, write_table
from .units import UNITS_KEY, Units, check_units_of_logs, write_units
from .values import Choice, Integer, Text, namespace, unread

FORMAT = 1


@dataclass(frozen=True)
class _KindOfSystem(Choice):
    """A body or a classical system by its name, or a user's class of systems."""

    def read(self, value: Any, path: str) -> str:
        return value if is_python_name(value) else super().read(value, path)


_START = "the state at the first of the times; at rest, upright and at the origin if not given"
# The keys that files of scenarios, studies and problems of design share, and those of the latter two.
ABOUT = {
    "format": Key(Integer(FORMAT, FORMAT), says="the version of the format"),
    "title": Key(Text(), "", says="a one-line description"),
}
OF_SCENARIO = {
    "scenario": Key(unread(SCENARIO, others=(Text(),)), says="a scenario, the name of a built-in one, or a file")
}
_SHARED = {
    **ABOUT,
    "units": UNITS_KEY,
    "kind": Key(_KindOfSystem((*BODIES, *CLASSICAL)), says="the body or the classical system"),
    "time": Key(unread(tables=TIMES), says="the times to save"),
    "solve": Key(unread(tables={"": SOLVE}), None, says="the solver and its tolerances"),
    **EVENT_KEYS,
}
KEYS = {
    **_SHARED,
    **BODY_KEYS,
    "masses": Key(
        unread("a list of tables", MASSES, forms=("list",)), [], says="the point masses, each under [[masses]]"
    ),
    "mechanisms": Key(
        unread("a list of tables", {"": MECHANISM}, forms=("list",)),
        [],
        says="joints with masses, each mechanism under [[mechanisms]]",
    ),
    "actuation": Key(
        unread(tables=keys_of(FORMS), by="form"),
        None,
        says="what drives masses on rails, accelerated joints and angles of a plate; their schedules if not given",
    ),
    "initial": Key(unread(tables=INITIAL), None, says=_START),
    **FEEDBACK_KEYS,
}
CLASSICAL_KEYS = {
    **_SHARED,
    "body": Key(unread(tables=keys_of(CLASSICAL)), None, says="the parameters of the system"),
    "initial": Key(unread(tables=CLASSICAL_INITIAL), None, says=_START),
}
RESISTED_KEYS = {**CLASSICAL_KEYS, "resistance": BODY_KEYS["resistance"]}


def load_scenario(source: str | Path) -> Scenario:
    """Reads the scenario of a file, or the built-in one, whose path or name is ``source``.

    **Raises:** :class:`ScenarioError`, with one sentence, when there is no such file or name, when it is not TOML, and
    when a key is misspelt, missing, of the wrong type or shape, or has an impossible value.

    **Example:**

    >>> from jaxball import load_scenario
    >>> scenario = load_scenario("disk")
    >>> scenario.title
    "The paper's disk: four masses on concentric circles"
    >>> scenario.system.n_masses
    4
    """
    text = scenario_text(source)
    with naming(source):
        return read_document(with_logs(document_of(text, "scenario", ScenarioError), Path(source).parent))


def read_scenario(text: str) -> Scenario:
    """Reads the scenario that the ``text`` of a file describes.

    **Raises:** :class:`ScenarioError`, with one sentence, when the text is not TOML, or a key is misspelt, missing, of
    the wrong type or shape, or has an impossible value.

    **Example:**

    >>> from jaxball import read_scenario
    >>> scenario = read_scenario('''
    ... format = 1
    ... kind = "disk"
    ... body = { mass = 1.0, inertia = 0.5, radius = 1.0, gravity = 1.0, offset = [0.0, 0.0, 0.0] }
    ... time = { start = 0.0, end = 2.0, step = 1.0 }
    ... ''')
    >>> scenario.times
    array([0., 1., 2.])
    """
    return read_document(document_of(text, "scenario", ScenarioError))


def read_document(document: dict[str, Any]) -> Scenario:
    """Reads the scenario that a ``document`` describes, a file as parsed by :mod:`tomllib`, which is not changed.

    **Raises:** :class:`ScenarioError` as :func:`read_scenario`.

    **Example:**

    >>> from jaxball.files.scenario import read_document
    >>> times = {"start": 0.0, "end": 2.0, "step": 1.0}
    >>> read_document({"format": 1, "kind": "nonholonomic-particle", "time": times}).times
    array([0., 1., 2.])
    """
    return read_contents(document).scenario()


class Contents(NamedTuple):
    """The contents of a file, whose numbers may be traced: a :class:`Scenario` without its save times."""

    title: str
    system: AbstractSystem
    state: Any
    contact: Contact | None
    times: SaveTimes
    solve: dict[str, Any]
    sensors: dict[str, AbstractSensor]
    events: dict[str, AbstractEvent]
    feedback: AbstractFeedbackSettings | None = None
    estimator: EstimatorSettings | None = None
    units: Units | None = None

    def scenario(self) -> Scenario:
        """Builds the scenario, whose numbers must be known."""
        times = self.times.array(self.times.count)
        others = {
            name: getattr(self, name) for name in ("contact", "sensors", "events", "feedback", "estimator", "units")
        }
        return Scenario(self.title, self.system, self.state, times, **self.solve, **others)


# What is read by itself and without which there is no body: the keys that are in no table, and the tables themselves.
_OF_BODY = ("top", "shell", "times", "masses", "mechanisms", "initial")


def read_contents(document: dict[str, Any]) -> Contents:
    """Reads the contents of a file; raises as :func:`read_document`.

    Numbers of ``document`` may be traced within :func:`~jaxball.files.scenario.values.collect_conditions`.
    """
    if document.get("kind") in tuple(CLASSICAL) or is_python_name(document.get("kind")):
        return _read_classical(document)
    kind = str(document.get("kind"))
    # An unknown kind has no keys of its own; this raises for the kind, and for all other keys that are wrong.
    if kind not in BODIES:
        read_table(document, "", KEYS)
    readers = {
        "top": lambda: read_table(document, "", KEYS),
        "shell": lambda: read_shell(document["body"], "body", kind) if "body" in document else None,
        "surroundings": lambda: read_surroundings(document, kind),
        "contact": lambda: read_contact(document["contact"], "contact") if "contact" in document else None,
        "times": lambda: read_times(document["time"], "time") if "time" in document else None,
        "solve": lambda: read_table(document.get("solve", {}), "solve", SOLVE),
        "masses": lambda: read_masses(document.get("masses", []), "masses", not is_linear(document.get("actuation"))),
        "mechanisms": lambda: read_mechanisms(document.get("mechanisms", []), "mechanisms"),
        "initial": lambda: read_initial(document.get("initial", {}), "initial", kind),
        "sensors": lambda: read_sensors(document.get("sensors", {}), "sensors"),
        "events": lambda: read_events(document.get("events", {}), "events"),
        "feedback": lambda: read_family(document["feedback"], "feedback", FEEDBACK) if "feedback" in document else None,
        "estimator": lambda: ESTIMATOR.read(document["estimator"], "estimator") if "estimator" in document else None,
    }
    read, errors = try_readers(*readers.values())
    # None where one is missing or cannot be read.
    tables = dict(zip(readers, read, strict=True))
    if all(tables[name] is not None for name in _OF_BODY):
        # Errors elsewhere must not hide errors in the body.
        contents, later = try_readers(lambda: _join_tables(kind, document, tables))
        if not errors and not later:
            return contents[0]
        errors += later
    raise_first(errors)
    raise AssertionError("A part that could not be read has an error.")


def _join_tables(kind: str, document: Mapping[str, Any], tables: Mapping[str, Any]) -> Contents:
    """Makes the contents of tables, which must fit each other."""
    top, shell, times, masses, mechanisms, initial = (tables[name] for name in _OF_BODY)
    check_units_of_logs(document, top["units"])
    start, surroundings, angles = times.start, dict(tables["surroundings"] or {}), []
    ground = surroundings.get("ground")
    if isinstance(ground, ReadPlate):
        surroundings["ground"], angles = ground.ground, ground.angles
        # A balance is found at rest, where angles that a law drives are level.
        ground = ground.without_law()
    if initial["balance"] is not None:
        shell_and_ground = {**shell, "ground": ground}
        masses = balance_schedules(masses, mechanisms, shell_and_ground, initial, "initial", kind, start)
    actuation = {"form": "prescribed"} if top["actuation"] is None else top["actuation"]
    actuated = apply_actuation(actuation, "actuation", masses, mechanisms, angles, kind)
    driven = sum(isinstance(item.motion, Driven) for item in actuated.masses)
    coordinates = driven + len(joints_in_state(mechanisms)) + len(angles)
    own_states = surroundings.get("own_states")
    check_force(surroundings.get("force"), "force", coordinates, 0 if own_states is None else len(own_states.names))
    system = BODIES[kind].type(
        **shell,
        **surroundings,
        masses=actuated.masses,
        law=actuated.law,
        mechanisms=[item.mechanism for item in mechanisms],
    )
    # Only now: the angles of masses may have been shifted into balance.
    state = initial_state(initial, "initial", kind, system.coordinates, actuated.targets, start, own_states)
    check_own_states(system, start, state)
    span = namespace(times.start, times.end).stack([times.start, times.end])
    sensors, contact, feedback, estimator = (tables[name] for name in ("sensors", "contact", "feedback", "estimator"))
    solve, events = tables["solve"] or {}, tables["events"] or {}
    _, first_state, _ = each_of(
        lambda: each_of(
            lambda: contact is None or check_contact(contact, "contact", system),
            lambda: solve and check_dae(system, contact, solve["solver"], solve["dae"]),
            lambda: solve and check_projection(system, contact, state, solve["project"]),
            lambda: check_run(system, span),
            lambda: check_confinement(system, span, state),
            lambda: check_start(system, start, state),
            lambda: sensors is None or check_sensors(sensors, "sensors", system),
        ),
        lambda: release(initial, "initial", state, "contact" in document),
        lambda: each_of(
            lambda: (
                solve
                and sensors is not None
                and check_feedback(feedback, estimator, sensors, system, times, solve, document, read_contents)
            ),
            lambda: events and check_events_of(events, "events", system, contact, start, state),
        ),
    )
    settings = sensors or {}, events, feedback, estimator, top["units"]
    return Contents(top["title"], system, first_state, contact, times, solve, *settings)


def _read_classical(document: dict[str, Any]) -> Contents:
    keys = RESISTED_KEYS if document["kind"] in RESISTED else CLASSICAL_KEYS
    table, times, solve, events = each_of(
        lambda: read_table(document, "", keys),
        lambda: "time" in document and read_times(document["time"], "time"),
        lambda: read_table(document.get("solve", {}), "solve", SOLVE),
        lambda: read_events(document.get("events", {}), "events"),
    )
    resistance = table.get("resistance")
    system, state = read_classical(table["kind"], table["body"], table["initial"], times.start, resistance)
    check_dae(system, None, solve["solver"], solve["dae"])
    check_projection(system, None, state, solve["project"])
    check_events_of(events, "events", system, None, times.start, state)
    return Contents(table["title"], system, state, None, times, solve, {}, events, units=table["units"])


def write_scenario(scenario: Scenario) -> str:
    """Writes the text of a file that describes ``scenario``; reading it gives the same numbers, bit for bit.

    **Raises:** :class:`ScenarioError` for what a file cannot hold: Python functions, and states other
    than that of a ball with a versor and of a disk.

    **Example:**

    >>> from jaxball import load_scenario, read_scenario, write_scenario
    >>> scenario = load_scenario("disk")
    >>> again = read_scenario(write_scenario(scenario))
    >>> bool((again.times == scenario.times).all())
    True
    """
    require("scenario", scenario, Scenario, "a Scenario, such as that of a run that was loaded")
    # NumPy arrays are indexed without compiling anything.
    parts = scenario.system, scenario.state, scenario.contact, dict(scenario.sensors)
    system, state, contact, sensors = jax.tree.map(np.asarray, parts)
    tables = {
        "format": FORMAT,
        "title": scenario.title,
        "units": write_units(scenario.units),
        **_tables(system, state),
        "contact": CONTACT.write(contact, "contact") if scenario.may_slip else {},
        "time": write_times(scenario.times),
        "solve": write_table({name: getattr(scenario, name) for name in SOLVE}, "solve", SOLVE),
        "sensors": write_sensors({name: sensors[name] for name in scenario.sensors}, "sensors"),
        "events": write_events(scenario.events, "events"),
        **write_settings(scenario.feedback, scenario.estimator),
    }
    return tomli_w.dumps({name: value for name, value in tables.items() if value not in ({}, [], "")})


def document_with_defaults(scenario: Scenario) -> dict[str, Any]:
    """Returns a document that describes the scenario, in which every key with a default is written.

    **Raises:** as :func:`write_scenario`.
    """
    with keeping_defaults():
        return tomllib.loads(write_scenario(scenario))


def with_defaults(document: Mapping[str, Any], scenario: Scenario, paths: Iterable[str]) -> dict[str, Any]:
    """Returns the document of ``scenario``, in which the keys at these paths are also written if they have their
    defaults.

    A key that does not exist, or that does not go with those that are there, is left out.
    """
    written = dict(document)
    absent = dict.fromkeys(key_of(path) for path in paths if not has_path(document, key_of(path)))
    if not absent:
        return written
    try:
        whole = document_with_defaults(scenario)
    except ScenarioError:  # for what a file cannot hold
        return written
    number_keys = {key_of(path) for path in numbers_of(whole, measured=True)}
    for key in filter(number_keys.__contains__, absent):
        longer = with_values(written, [f"{key}={value_at(whole, key)!r}"])
        same = False
        with all_problems() as problems:
            # The scenario must be the same in all its other keys too, or the default stands for something else there.
            same = document_with_defaults(read_document(longer)) == whole
        written = longer if same and not problems else written
    return written


def _tables(system: AbstractSystem, state: Any) -> dict[str, Any]:
    """Returns the kind of a system, and the tables of its parameters and of its state."""
    if not isinstance(system, System):
        return write_classical(system, state)
    targets = targets_of(system)
    body = write_body(system)
    if any(path.startswith("ground.") for path in targets):
        body["ground"] |= write_targets(targets)
    return {
        "kind": kind_of(system),
        **body,
        "masses": write_masses(system, targets, "masses"),
        "mechanisms": write_mechanisms(system, targets, "mechanisms"),
        "actuation": write_actuation(system),
        "initial": write_initial(system, state),
    }
