"""Some rows of a store as scenarios, to be simulated again, with the events that may have ended them."""

import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..interface.wording import counted
from ..scenario import Scenario, ScenarioError, read_document
from ..scenario.paths import with_numbers
from ..simulation.events import AbstractEvent, Detachment
from .attributes import read_attributes
from .dataset import open_dataset
from .errors import StoreError
from .study import ends_at_detachment
from .whole import check_whole


def row_events(folder: str | Path) -> dict[str, AbstractEvent]:
    """The events that may have ended the runs of a store, by name, to be used with :func:`row_scenarios`.

    **Arguments:**

    - ``folder``: the store.

    **Raises:** :class:`StoreError` as :func:`open_dataset`.
    """
    return {"detachment": Detachment()} if ends_at_detachment(read_attributes(Path(folder))["settings"]) else {}


def row_scenarios(folder: str | Path, rows: Sequence[int]) -> list[Scenario]:
    """The scenarios of some rows of a store; simulated with :func:`row_events`, they repeat the runs of these rows.

    They have all save times, even where the study kept only the end.

    **Arguments:**

    - ``folder``: the store.
    - ``rows``: the numbers of the rows, from 0.

    **Raises:** :class:`StoreError` as :func:`open_dataset`, and for a row that does not exist, is not computed yet, or
    has impossible numbers.
    """
    check_whole(Path(folder))
    data = open_dataset(folder)
    paths, count = np.atleast_1d(data.attrs["paths"]).tolist(), data.sizes["row"]
    beyond = [row for row in rows if not 0 <= row < count]
    if beyond:
        raise StoreError(
            f'Rows must be among the {counted(count, "row")} of "{folder}", from 0 to {count - 1}, but {beyond[0]} is '
            "not."
        )
    document, chosen = tomllib.loads(data.attrs["scenario"]), data[["row", *paths]].isel(row=list(rows)).load()
    scenarios = []
    for k, row in enumerate(rows):
        if chosen["row"].values[k] < 0:
            raise StoreError(f'Rows must be computed, but row {row} of "{folder}" is not done yet.')
        values = {path: float(chosen[path].values[k]) for path in paths}
        try:
            scenarios.append(read_document(with_numbers(document, values)))
        except ScenarioError as error:
            raise StoreError(f"Row {row}: {error}") from None
    return scenarios
