"""The progress of a store, read from the store alone."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..interface.status import Status
from ..scenario import ScenarioError, read_document
from ..scenario.paths import with_numbers
from .attributes import read_attributes
from .tally import column, tally
from .whole import STATUS, check_whole


def describe(folder: str | Path) -> str:
    """How many rows of a store are done, their statuses, and what is wrong with the first row that failed.

    **Raises:** :class:`StoreError` when there is nothing at ``folder``, or something other than the store of a study,
    and when a file of it has been changed from outside.
    """
    folder = Path(folder)
    attributes = read_attributes(folder)
    check_whole(folder)
    tallied = tally(folder)
    lines = [attributes["title"]] if attributes["title"] else []
    lines.append(
        f"{tallied.rows:,} of {attributes['rows']:,} rows are done ({100 * tallied.rows / attributes['rows']:.1f} %)"
    )
    lines += [f"  {int(tallied.counts[status]):,} {status.name}" for status in Status if tallied.counts[status]]
    if tallied.first is not None:
        lines.append(_failure(folder, attributes, tallied.first))
    return "\n".join(lines)


def _failure(folder: Path, attributes: Mapping[str, Any], row: int) -> str:
    size = attributes["chunk"]
    chunk, place = divmod(row, size)
    values = {path: float(column(folder, path, chunk, size, np.dtype("<f8"))[place]) for path in attributes["paths"]}
    shown = ", ".join(f"{path} = {value:.6g}" for path, value in values.items())
    status = Status(int(column(folder, "status", chunk, size, STATUS)[place]))
    line = f"  the first failed row is {row}, {status.name}, with {shown}"
    try:
        read_document(with_numbers(tomllib.loads(attributes["scenario"]), values))
    except ScenarioError as error:
        line += f"\n  {error}"
    return line
