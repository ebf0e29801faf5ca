"""Logs: columns of numbers over time in a CSV file, which a scenario file names, or in its text.

A scenario that is saved has the numbers themselves, because a file beside it may change or be left behind. Nothing here
needs JAX.
"""

import csv
import functools
import io
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ...interface.wording import UserError, did_you_mean, number_of

if TYPE_CHECKING:
    import numpy as np

KIND = "log"
DELIMITERS = ",;\t"
TIME, VALUE = "t", "value"  # the columns of a log that is written


class RecordedColumn(NamedTuple):
    """A column of a log: ``times`` and ``values``, the two first arguments of signals and schedules from a log."""

    times: "np.ndarray"
    values: "np.ndarray"


class LogError(UserError):
    """A log cannot be read; the message is one sentence that names the file and the row."""


def load_log(path: str | Path, *, time: str, column: str) -> RecordedColumn:
    """Reads a column of the CSV file at ``path`` and the times of its rows.

    **Arguments:**

    - ``path``: a file of text in UTF-8 whose first row has the names of its columns; commas, semicolons or tabs
      separate them. Other columns may contain anything.
    - ``time``: the name of the column with the times, which increase from row to row.
    - ``column``: the name of the column with the values.

    **Raises:** :class:`LogError`, with one sentence, where there is no such file or column, where an entry is no finite
    number, and where a time is not later than the one before; the sentence has the number of the row in the file.

    **Example:**

    >>> import pathlib, tempfile
    >>> from jaxball import RecordedSignal
    >>> from jaxball.files.scenario import load_log
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "motor.csv")
    ...     _ = file.write_text("t,u\\n0.0,0.0\\n0.5,1.0\\n1.0,0.0\\n")
    ...     signal = RecordedSignal(*load_log(file, time="t", column="u"))
    >>> signal.values.tolist()
    [0.0, 1.0, 0.0]
    """
    try:
        return columns_of(text_of_file(Path(path)), f'"{path}"', time, column)
    except LogError as error:
        raise LogError(f"Argument `path` must be a log, but {with_stop(error)}") from None


def with_stop(clause: object) -> str:
    """Ends a clause with a full stop, unless it ends with a question."""
    return str(clause) if str(clause).endswith("?") else f"{clause}."


def text_of_file(path: Path) -> str:
    try:
        # Spreadsheets begin files with a byte-order mark.
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise LogError(f'"{path}" cannot be read: {error.strerror}') from None
    except UnicodeDecodeError:
        raise LogError(f'"{path}" is not UTF-8 text') from None


@functools.lru_cache(maxsize=8)
def columns_of(text: str, name: str, time: str, column: str) -> RecordedColumn:
    """Reads the times and the values in a text, which messages call ``name``.

    **Raises:** :class:`LogError` with a clause.
    """
    import numpy as np  # here, because it takes as long as Python itself to start, and few scenarios have logs

    first = text[: text.find("\n")] if "\n" in text else text
    # By the names of the columns, which have no decimal commas.
    delimiter = next((mark for mark in DELIMITERS if mark in first), ",")
    reader = csv.reader(io.StringIO(text), delimiter=delimiter, skipinitialspace=True)
    names = [entry.strip() for entry in next(reader, [])]
    places = [_place_of(heading, names, name) for heading in (time, column)]
    lines: list[int] = []
    numbers: list[list[float]] = []
    for row in reader:
        if row:  # a line without anything is not a row
            lines.append(reader.line_num)
            if any(entry.strip() for entry in row[len(names) :]):
                raise LogError(
                    f"row {lines[-1]} of {name} has {len(row)} entries for {number_of(len(names), 'column')}; where "
                    "commas separate them, numbers have decimal points, and texts with commas are quoted"
                )
            numbers.append([_number(row, place, names[place], f"row {lines[-1]} of {name}") for place in places])
    if len(numbers) < 2:
        raise LogError(f"{name} has fewer than two rows below the names of its columns")
    times, values = np.asarray(numbers).T
    late = np.flatnonzero(np.diff(times) <= 0)
    if late.size:
        row = late[0] + 1
        raise LogError(
            f"row {lines[row]} of {name} has the time {times[row]} after {times[row - 1]}; sort the rows, and keep one "
            "of those with equal times"
        )
    return RecordedColumn(times, values)


def _place_of(heading: str, names: list[str], name: str) -> int:
    count = names.count(heading)
    if count == 1:
        return names.index(heading)
    if count:
        raise LogError(f'{name} has {count} columns "{heading}"')
    hint = did_you_mean(heading, names, f"its columns are {', '.join(names)}" if any(names) else "it is empty")
    raise LogError(f'{name} has no column "{heading}"{hint.rstrip(".")}')


_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")


def _number(row: list[str], place: int, column: str, where: str) -> float:
    entry = row[place] if place < len(row) else ""
    try:
        number = float(entry)
    except ValueError:
        number = math.nan
    if math.isfinite(number):
        return number
    if _DECIMAL_COMMA.fullmatch(entry.strip()):
        raise LogError(
            f'{where} has "{entry.strip()}" in column "{column}", a number with a decimal comma; write decimal points'
        )
    raise LogError(
        f'{where} has "{entry.strip()}" in column "{column}", which is not a finite number; leave such rows out, and '
        "the log is interpolated between those on both sides"
    )


def with_logs(document: Any, folder: Path) -> Any:
    """Returns the document with the numbers of the logs that it names by ``file``, looked for relative to ``folder``.

    What cannot be read is left to the reader of its table, which says why; it is given the place of the file.
    """
    if isinstance(document, list):
        return [with_logs(item, folder) for item in document]
    if not isinstance(document, Mapping):
        return document
    # A saved scenario has the numbers already.
    if document.get("kind") != KIND or not isinstance(document.get("file"), str) or "csv" in document:
        return {name: with_logs(item, folder) for name, item in document.items()}
    path = folder / document["file"]
    time, column = document.get("time"), document.get("column")
    try:
        log = columns_of(text_of_file(path), "", str(time), str(column))
    # The reader of the table finds the same error, and names its key.
    except LogError:
        return {**document, "file": str(path)}
    rest = {name: item for name, item in document.items() if name != "file"}
    return {**rest, "csv": text_of_log(log, str(time), str(column))}


def text_of_log(log: RecordedColumn, time: str = TIME, column: str = VALUE) -> str:
    """Writes the text of a log; reading it gives the same numbers, bit for bit."""
    rows = io.StringIO()
    writer = csv.writer(rows, lineterminator="\n")
    writer.writerow([time, column])
    writer.writerows(zip(log.times.tolist(), log.values.tolist(), strict=True))
    return rows.getvalue()
