"""A law that is linear in the state, in a scenario file: its factors and signals."""

import functools
from collections.abc import Sequence
from typing import Any

from ..interface.wording import all_of
from ..physics.schedules import AbstractSchedule
from ..physics.signals import AbstractSignal
from .errors import each_of
from .mechanisms import JointInState
from .signals import SIGNALS, read_signal, write_signal
from .table import Key, join, keys_of
from .values import ACCELERATION, RATE, Dimension, Nested, Numbers, ScenarioError, key_error, shown

_SIGNALS_WORDS = "a list of numbers, and tables of signals or schedules"


def _read_signals(values: Any, path: str) -> tuple[AbstractSignal | AbstractSchedule, ...]:
    if not isinstance(values, list) or not values:
        raise key_error(path, _SIGNALS_WORDS, shown(values))
    readers = (functools.partial(read_signal, value, f"{path}[{index}]") for index, value in enumerate(values))
    return tuple(each_of(*readers))


def _write_signals(signals: Sequence[AbstractSignal | AbstractSchedule], path: str) -> list[Any] | None:
    return [write_signal(signal, f"{path}[{index}]") for index, signal in enumerate(signals)] or None


def _factor(dimension: Dimension) -> Key:
    return Key(Numbers((None, None), dimension=dimension), None)


FACTORS = {
    "theta": _factor(ACCELERATION),
    "thetadot": _factor(RATE),
    "Omega": _factor(RATE),
    "Gamma": _factor(ACCELERATION),
    "z": _factor(Dimension(-1, -2)),
}
LINEAR = {**FACTORS, "signals": Key(Nested(_read_signals, _write_signals, _SIGNALS_WORDS, keys_of(SIGNALS)), None)}


def check_factors(values: Any, path: str, names: Sequence[str], joints: Sequence[JointInState], kind: str) -> None:
    """Raises unless each factor has a row for each of ``names``, which the law drives, and columns for the state."""
    for joint in joints:
        if joint.accelerated and joint.target is not None:
            raise ScenarioError(
                f'Key `{joint.path}.schedule` must be left out where `{path}.form` is "linear", which follows no '
                "schedule; give `initial.theta`, and the motion as `signals`."
            )
    given = [name for name in LINEAR if name in values]
    if not given:
        raise ScenarioError(f"Key `{path}` must have one or more of the keys {', '.join(LINEAR)}, but it has none.")
    free = [joint for joint in joints if not joint.accelerated]
    coordinates = len(names) + len(free)
    columns = {"theta": coordinates, "thetadot": coordinates, "Omega": 3, "Gamma": 3, "z": 1 if kind == "disk" else 2}
    each = f"each of {all_of(names)}"
    for name in given:
        rows = values[name]
        if name == "signals":
            if len(rows) != len(names):
                raise key_error(join(path, name), f"a list of {len(names)}, one for {each}", f"one of {len(rows)}")
        elif (len(rows), len(rows[0])) != (len(names), columns[name]):
            must = f"{len(names)} by {columns[name]} numbers, a row for {each}"
            raise key_error(join(path, name), must, f"{len(rows)} by {len(rows[0])}")
