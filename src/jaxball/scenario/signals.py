"""Signals in a scenario file: a number, steps, polynomials in pieces, or a schedule."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..physics.schedules import AbstractSchedule
from ..physics.signals import AbstractSignal, ConstantSignal, PiecewiseSignal
from .schedules import SCHEDULES, TIMES, row_for_each_interval
from .table import Family, Key, Module, keys_of, read_family, write_family, write_table
from .values import Nested, Numbers


@dataclass(frozen=True)
class _Constant(Numbers):
    """A number, where a table might be as well."""

    @property
    def words(self) -> str:
        return "a finite number, or the table of a signal or a schedule"


_NUMBER = _Constant()
_STEPS = Module(
    PiecewiseSignal,
    {"times": Key(TIMES), "values": Key(Numbers((None,)))},
    check=row_for_each_interval("values", "number"),
)
_PIECES = Module(
    PiecewiseSignal,
    {"times": Key(TIMES), "values": Key(Numbers((None, None)))},
    check=row_for_each_interval("values"),
)
SIGNALS: Family = {"steps": _STEPS, "piecewise": _PIECES, **SCHEDULES}
_WRITTEN: Family = {"piecewise": _PIECES, **SCHEDULES}


def read_signal(value: Any, path: str) -> AbstractSignal | AbstractSchedule:
    """A signal, or a schedule whose value it is."""
    return read_family(value, path, SIGNALS) if isinstance(value, dict) else ConstantSignal(_NUMBER.read(value, path))


def write_signal(signal: AbstractSignal | AbstractSchedule, path: str) -> Any:
    """The number or the table of a signal."""
    if isinstance(signal, ConstantSignal):
        return _NUMBER.write(signal.value, path)
    if isinstance(signal, PiecewiseSignal) and signal.values.shape[1] == 1:
        steps = {"times": signal.times, "values": np.ravel(signal.values)}
        return {"kind": "steps", **write_table(steps, path, _STEPS.keys)}
    return write_family(signal, path, _WRITTEN)


SIGNAL = Nested(read_signal, write_signal, _NUMBER.words, keys_of(SIGNALS))
