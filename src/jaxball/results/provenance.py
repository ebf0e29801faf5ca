"""The attributes of a result file: how its run ended, its scenario, and the versions of the packages."""

import dataclasses
import importlib.metadata
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

from ..interface.status import Status
from ..physics.body import AbstractBody
from ..physics.released import ReleasedState
from ..physics.state import ReducedState, RotationState
from ..scenario import Scenario, ScenarioError, read_scenario, write_scenario
from ..sensors import AbstractSensor
from ..simulation.extremes import contact_extremes
from ..simulation.trajectory import Trajectory
from .contact import contact_attributes
from .files import FORMAT, UNKNOWN_SOLVER

PACKAGES = ("jaxball", "jax", "diffrax")


def attributes(
    trajectory: Trajectory[Any, Any], scenario: Scenario | None, sensors: Mapping[str, AbstractSensor] | None = None
) -> dict[str, str | int | float]:
    """Title, how the solve ended, the scenario's text, and the versions of the packages.

    Without a ``scenario``, it is the one that was run; if there was none, its text describes the trajectory's system,
    initial state, times and ``sensors``, and is empty where a file cannot hold them. ``format`` is the version of the
    file format, which :func:`load_run` checks. ``ok`` is 1 for a solve that reached its end and 0 for one that failed.
    A run with dense output also has the extremes of the contact force over the whole run, ``friction_needed`` and the
    others of :class:`~jaxball.ContactExtremes`, with the same names as in the store of a sweep. One with a law of
    contact has its coefficients instead, ``contact_sliding`` and so on, and its ``contact_switches``.
    """
    text = _of_trajectory(trajectory, sensors or {}) if scenario is None else write_scenario(scenario)
    known = trajectory.scenario if scenario is None else scenario
    run: dict[str, str | int | float] = {
        "format": FORMAT,
        "title": "" if known is None else known.title,
        "ok": int(trajectory.ok),
        "status": Status(int(trajectory.status)).name,
        "message": trajectory.message,
        "reached": float(trajectory.reached),
        "steps": int(trajectory.steps),
        "rejected_steps": int(trajectory.rejected),
        "scenario": text,
    }
    if trajectory.contact is not None:
        run |= contact_attributes(trajectory.contact)
    elif trajectory.interpolant is not None and isinstance(trajectory.system, AbstractBody):
        extremes = contact_extremes(trajectory)
        names = [field.name for field in dataclasses.fields(extremes) if field.name != "constant"]
        run |= {name: float(getattr(extremes, name)) for name in names}
    return run | {f"{name}_version": importlib.metadata.version(name) for name in PACKAGES}


def _of_trajectory(trajectory: Trajectory[Any, Any], sensors: Mapping[str, AbstractSensor]) -> str:
    """The text of the scenario that was run, or of one made from the trajectory; empty where a file cannot hold it."""
    text = _text(trajectory.scenario)
    if not text and (made := _text(_made_of(trajectory, sensors))):
        text = UNKNOWN_SOLVER + made
    return text


def _text(scenario: Scenario | None) -> str:
    if scenario is None:
        return ""
    try:
        text = write_scenario(scenario)
        read_scenario(text)
    except ScenarioError:
        return ""
    return text


def _made_of(trajectory: Trajectory[Any, Any], sensors: Mapping[str, AbstractSensor]) -> Scenario | None:
    """A scenario of the system, the initial state and the times; None where the state has no position."""
    state = jax.tree.map(lambda leaf: leaf[0], trajectory.state)
    state = state.in_space() if isinstance(state, RotationState) else state
    if isinstance(state, ReducedState):
        return None
    contact, law = trajectory.contact, None
    if contact is not None:
        law = contact.law
        rolls = not isinstance(trajectory.start, ReleasedState)
        state = state if rolls else ReleasedState(state, contact.V[0], contact.height[0])
    return Scenario("", trajectory.system, state, np.asarray(trajectory.times), contact=law, sensors=sensors)
