"""The task of a worker: a chunk of rows is computed and written to the store."""

import os
import socket
import threading
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from ..interface.status import Status
from ..scenario import Scenario
from .batch import Engine, Wanted
from .outputs import Output, outputs_of, state_variables
from .rows import read_rows
from .store import Store
from .study import Study


class Task(NamedTuple):
    """Everything that a worker needs to know."""

    study: Study
    store: Path
    chunk: int
    engine: Engine
    threads: int = 1


class Done(NamedTuple):
    """How many rows a chunk had, how many of them failed, and the name of the worker: its machine, process, thread."""

    rows: int
    failed: int
    worker: str


def solve_chunk(task: Task) -> Done:
    """Computes a chunk and writes it to the store."""
    study, template = task.study, task.study.template()
    outputs = outputs_of(study, template)
    rows = study.rows_of(task.chunk)
    arrays = compute(study, template, outputs, rows, task.engine, task.threads)
    Store(task.store, study, outputs).write(task.chunk, arrays)
    worker = f"{socket.gethostname()}-{os.getpid()}-{threading.get_ident()}"
    return Done(len(rows), int(np.sum(arrays["status"] != Status.SUCCESS)), worker)


def solve_chunk_elsewhere(task: Task) -> Done:
    """The same in a worker's process, which has JAX settings of its own."""
    jax.config.update("jax_enable_x64", True)
    return solve_chunk(task)


def compute(
    study: Study,
    template: Scenario,
    outputs: dict[str, Output],
    rows: np.ndarray,
    engine: Engine,
    threads: int = 1,
) -> dict[str, np.ndarray]:
    """The variables of ``rows``. An impossible row has the status IMPOSSIBLE, and does not affect the others."""
    arrays = {name: output.empty(len(rows)) for name, output in outputs.items()}
    values = study.values(rows)
    arrays["row"][:] = rows
    for column, path in enumerate(study.paths):
        arrays[path][:] = values[:, column]
    arrays["status"][:] = Status.IMPOSSIBLE
    arrays["steps"][:] = arrays["rejected"][:] = 0
    possible, batch = read_rows(study, template, rows, values)
    if batch is None:
        return arrays
    if "time" in arrays:
        arrays["time"][possible] = batch.times
    solved = engine(batch, Wanted(study.contact, study.detachment, study.finds, study.chunk, threads))
    for name in outputs.keys() & solved.keys():
        array = solved[name]
        at_each_time = name in state_variables(template) and study.save == "end"
        arrays[name][possible] = array[:, -1] if at_each_time else array
    return arrays
