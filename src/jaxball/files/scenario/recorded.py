"""Signals and schedules from logs as tables of a scenario file."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...physics.prescribed.recorded import RecordedSchedule, RecordedSignal
from .errors import ScenarioError, key_error
from .logs import TIME, VALUE, LogError, RecordedColumn, columns_of, text_of_file, text_of_log, with_stop
from .table import Key, Module, join, read_table
from .values import Choice, Flag, Text


@dataclass(frozen=True)
class LogModule(Module):
    """How a signal or a schedule from a log stands in a file: by the numbers of the log, or by its file."""

    def read(self, values: Any, path: str) -> Any:
        table = read_table(values, path, self.keys)
        if self.check is not None:
            self.check(table, path)
        del table["unit"]  # which check_units_of_logs compares with those of the scenario
        file, text = table.pop("file"), table.pop("csv")
        if (file is None) == (text is None):
            raise ScenarioError(
                f"Key `{path}` must have exactly one of the keys `file` and `csv`, but it has "
                f"{'none of them' if file is None else 'both'}."
            )
        try:
            text, name = (text, "its text") if file is None else (text_of_file(Path(file)), f'"{file}"')
            log = columns_of(text, name, table.pop("time"), table.pop("column"))
        except LogError as error:
            raise ScenarioError(
                f"Key `{join(path, 'csv' if file is None else 'file')}` must be a log, but {with_stop(error)}"
            ) from None
        return self.type(*log, **table)

    def write(self, item: Any, path: str) -> dict[str, Any]:
        log = RecordedColumn(*(np.asarray(array, float) for array in (item.times, item.values)))
        written = {"csv": text_of_log(log), "time": TIME, "column": VALUE}
        for name in ("interpolation", "outside"):
            if name in self.keys and getattr(item, name) != self.keys[name].default:
                written[name] = getattr(item, name)
        return written


def _check_schedule(table: dict[str, Any], path: str) -> None:
    interpolation = table.pop("interpolation")
    if interpolation != RecordedSchedule.interpolation:
        must = '"spline", because a schedule has a rate and an acceleration'
        got = f'"{interpolation}"; "previous" and "linear" are for signals, such as torques'
        raise key_error(join(path, "interpolation"), must, got)


@dataclass(frozen=True)
class SignalOrSchedule(LogModule):
    """How the signal of a motor from a log stands in a file: as a signal, or, with ``schedule``, as a schedule."""

    def read(self, values: Any, path: str) -> Any:
        settings = {name: value for name, value in values.items() if name != "schedule"}
        flag = self.keys["schedule"]
        if not flag.kind.read(values.get("schedule", flag.default), join(path, "schedule")):
            if settings.get("outside") == "continue":
                got = '"continue"; a schedule goes on at its rate, with `schedule = true`'
                raise key_error(join(path, "outside"), '"refuse", "hold" or "zero" for a signal', got)
            return SIGNAL_FROM_LOG.read(settings, path)
        return SCHEDULE_FROM_LOG.read(settings, path)

    def write(self, item: Any, path: str) -> dict[str, Any]:
        is_schedule = isinstance(item, RecordedSchedule)
        written = (SCHEDULE_FROM_LOG if is_schedule else SIGNAL_FROM_LOG).write(item, path)
        return written | ({"schedule": True} if is_schedule else {})


_KEYS = {
    "file": Key(
        Text(), None, "a CSV file whose first row names its columns, relative to the scenario's file; or else `csv`"
    ),
    "csv": Key(Text(), None, "the text of a CSV file, in place of `file`"),
    "time": Key(Text(), says="the name of the column with the times, which increase"),
    "column": Key(Text(), says="the name of the column with the values"),
    "unit": Key(Text(), None, 'the unit of that column, such as "N m"; a file is refused if `units` make it another'),
}
_INTERPOLATIONS = Choice(("previous", "linear", "spline"))
SIGNAL_FROM_LOG = LogModule(
    RecordedSignal,
    {
        **_KEYS,
        "interpolation": Key(_INTERPOLATIONS, "linear"),
        "outside": Key(Choice(RecordedSignal.choices_outside), "refuse"),
    },
)
SCHEDULE_FROM_LOG = LogModule(
    RecordedSchedule,
    {
        **_KEYS,
        "interpolation": Key(_INTERPOLATIONS, "spline", says="a spline, because the others of a signal have no rate"),
        "outside": Key(Choice(RecordedSchedule.choices_outside), "refuse"),
    },
    check=_check_schedule,
)
_OUTSIDE = (*RecordedSignal.choices_outside, "continue")
SIGNAL_OR_SCHEDULE_FROM_LOG = SignalOrSchedule(
    RecordedSignal,
    {
        **SIGNAL_FROM_LOG.keys,
        "outside": Key(
            Choice(_OUTSIDE),
            "refuse",
            says='before the first time and after the last, "hold" for the first and the last value, "zero" for 0, or '
            '"refuse" for a run that must not go beyond the log; where `schedule` is true "refuse" or "continue", for '
            "motion at the rate at that end",
        ),
        "schedule": Key(Flag(), False, says="whether the signal is the value of a schedule from the log, a spline"),
    },
)
