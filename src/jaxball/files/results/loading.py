"""Loads a saved run."""

import dataclasses
import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ...interface.status import Status
from ...numerics.arrays import arrays_of, to_array
from ...physics.contact.released import ReleasedState
from ...physics.system import AbstractState, AbstractSystem
from ...simulation.trajectory import Trajectory
from ..scenario.errors import ScenarioError
from ..scenario.files import read_scenario
from ..scenario.scenario import Scenario
from .feedback import INPUTS, read_feedback
from .files import UNKNOWN_SOLVER, RunError, attribute_of, load_arrays, load_attributes, no_run, refuse_errors, text_in
from .variables import read_history

DRIVEN_FIELDS = ("theta", "thetadot")  # left out of a file where no mass is driven


def load_run(path: str | Path, system: AbstractSystem | None = None) -> Trajectory[Any, Any]:
    """Reads the trajectory that :func:`save` wrote to a ``.nc`` or ``.npz`` file, its states identical bit for bit.

    Its system is that of the scenario in the file, and its observables, or laws, are recomputed from the states. Its
    status is that of the run, so a failed run is not ``ok``. Dense output and the states at events are not saved:
    ``at`` raises, and ``events`` is empty. The ``history`` of a run with modes is restored, with its switches.
    ``scenario`` is the one that was run, if the file has its settings too.

    **Arguments:**

    - ``path``: the file.
    - ``system``: the system, for a file without a scenario, such as one with a rail that is a Python function.

    **Raises:** :class:`RunError`, with one sentence, when there is no such file, when it is not a run or is from a
    later version, and when it has no scenario and no ``system`` is given.

    **Example:**

    >>> import tempfile
    >>> from jaxball import Disk, DiskState, load_run, simulate
    >>> run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], DiskState(phidot=-1.0))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     again = load_run(run.save(f"{folder}/run.npz"))
    >>> again
    Trajectory of a disk with no point masses
      3 times from 0 to 2
      4 steps, 0 of them rejected
      The solve reached t = 2.
      z at the end: 2
    """
    path = Path(path)
    about = load_attributes(path)
    scenario = None
    if system is None:
        scenario = _scenario(path, about)
        system = scenario.system
    arrays = load_arrays(path)
    with refuse_errors(path):
        return _run_in(path, about, arrays, system, scenario)


def _run_in(
    path: Path,
    about: Mapping[str, Any],
    arrays: Mapping[str, np.ndarray],
    system: AbstractSystem,
    scenario: Scenario | None,
) -> Trajectory[Any, Any]:
    """Returns the run with the attributes ``about`` and these arrays."""
    state = _state(arrays, system, path)
    under_feedback = INPUTS in about
    # The robot of the loop: the inputs that acted are held, as in the run itself.
    if scenario is not None and scenario.feedback is not None and under_feedback:
        from ..scenario.closed_loop import system_of_run  # here, because other runs are read without solvers

        system = system_of_run(scenario, arrays["inputs"])
    attribute = functools.partial(attribute_of, path, about)
    law = None if scenario is None else scenario.contact
    try:
        modes = read_history(about, arrays, attribute, state, system, law)
        run = Trajectory(
            system=system,
            times=arrays["time"],
            state=state,
            reached=to_array(attribute("reached", float)),
            status=jnp.asarray(int(attribute("status", lambda name: Status[str(name)]))),
            steps=jnp.asarray(attribute("steps", int)),
            rejected=jnp.asarray(attribute("rejected", int)),
            start=None if scenario is None or under_feedback else scenario.state,
            history=read_feedback(about, arrays, state, modes) if under_feedback else modes,
        )
    except KeyError as error:
        raise no_run(path, f"it has no {error}") from None
    _require_rows(path, run)
    if scenario is not None:
        _require_shapes_of(path, state, scenario.state)
    settings_known = not str(about.get("scenario", "")).startswith(UNKNOWN_SOLVER)
    return run.set_scenario(scenario) if scenario is not None and settings_known else run


def _require_rows(path: Path, run: Trajectory[Any, Any]) -> None:
    """Raises a :class:`RunError` unless everything over time has as many rows as there are times."""
    if jnp.ndim(run.times) != 1:
        raise no_run(path, f"its times have the shape {jnp.shape(run.times)}")
    fields = vars(run.history) | vars(run.history.of_body)
    recorded = {name: value for name, value in fields.items() if name not in ("modes", "switches", "law")}
    for place, leaf in jax.tree_util.tree_leaves_with_path({"state": run.state, **recorded}):
        if isinstance(leaf, str):  # the name of an input
            continue
        if jnp.ndim(leaf) == 0 or len(leaf) != len(run.times):
            name = jax.tree_util.keystr(place, simple=True, separator=".")
            raise no_run(path, f"it has {len(run.times)} times, but its `{name}` has the shape {jnp.shape(leaf)}")


def _require_shapes_of(path: Path, states: AbstractState, start: Any) -> None:
    """Raises a :class:`RunError` where states over time are not of the shapes of the one that they began with."""
    body = start.body if isinstance(start, ReleasedState) else start
    if type(body) is not type(states):
        return
    for name, leaf in arrays_of(states).items():
        shape = jnp.shape(getattr(body, name))
        if leaf.shape[1:] != shape:
            raise no_run(path, f"its `{name}` has the shape {leaf.shape}, but at each time it must have {shape}")


def saved_scenario(path: str | Path) -> Scenario:
    """Reads the scenario of a saved run, for simulating it again: ``saved_scenario("run.nc").simulate(rtol=1e-12)``.

    **Arguments:**

    - ``path``: the file, as :func:`load_run` reads it.

    **Raises:** :class:`RunError` as :func:`load_run`.
    """
    path = Path(path)
    return _scenario(path, load_attributes(path))


def _scenario(path: Path, about: Mapping[str, Any]) -> Scenario:
    try:
        return read_scenario(text_in(path, about))
    except RunError:
        raise
    except ScenarioError as error:
        raise RunError(f'The scenario in the run "{path}" cannot be read by this version of jaxball: {error}') from None


def _state(arrays: Mapping[str, np.ndarray], system: AbstractSystem, path: Path) -> AbstractState:
    """Returns the states, of the type whose fields are in the file."""
    types = (system.state_type, *system.other_state_types)
    fields = {type_: [field.name for field in dataclasses.fields(type_)] for type_ in types}
    for type_, names in fields.items():
        if all(name in arrays or name in (*DRIVEN_FIELDS, "own") for name in names):
            filled = dict.fromkeys(DRIVEN_FIELDS, np.zeros((len(arrays["time"]), 0))) | dict(arrays)
            return type_(**{name: to_array(filled[name]) for name in names if name in filled})
    raise no_run(path, f"it has no states of a {type(system).__name__}")
