"""Computes the chunks of a study: in this process, in processes of its own, or wherever an executor sends them."""

import concurrent.futures
import contextlib
import multiprocessing
import os
import socket
import threading
import time
import traceback
from collections.abc import Iterable, Iterator
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from ...interface import compat, interruption
from ...interface.status import SUCCESSES, Status
from ...programs.store import current
from .files import WorkerError
from .outputs import LEAST_FORCE, LEFT, Output, flag_departures, outputs_of, state_variables, went_on, with_extremes
from .rows import Engine, Request, read_rows
from .store import Store
from .study import Study


class Task(NamedTuple):
    """Everything that a worker needs to know."""

    study: Study
    store: Path
    chunk: int
    engine: Engine
    threads: int = 1


class ChunkResult(NamedTuple):
    """How many rows a chunk had, how many of them failed, and the name of the worker: its machine, process, thread.

    - ``left``: how many rows went on although the body would have left the plane.
    """

    rows: int
    failed: int
    worker: str
    left: int = 0


def solve_chunk(task: Task) -> ChunkResult:
    """Computes a chunk and writes it to the store."""
    study, outputs = task.study, outputs_of(task.study, task.study.template())
    rows = study.rows_of(task.chunk)
    arrays = compute(task, outputs, rows)
    Store(task.store, study, outputs).write(task.chunk, arrays)
    worker = f"{socket.gethostname()}-{os.getpid()}-{threading.get_ident()}"
    failed = int(np.sum(~np.isin(arrays["status"], SUCCESSES)))
    return ChunkResult(len(rows), failed, worker, went_on(arrays["status"], arrays[LEFT]) if LEFT in arrays else 0)


def solve_chunk_elsewhere(task: Task) -> ChunkResult:
    """Solves a chunk like :func:`solve_chunk`, but in a worker's process, which has JAX settings of its own."""
    # The setting of the parent does not reach a process on another machine.
    jax.config.update("jax_enable_x64", True)
    return solve_chunk(task)


def compute(task: Task, outputs: dict[str, Output], rows: np.ndarray) -> dict[str, np.ndarray]:
    """Computes the variables of ``rows``. An impossible row has the status IMPOSSIBLE, and does not affect
    the others.
    """
    study, template = task.study, task.study.template()
    arrays = {name: output.empty(len(rows)) for name, output in outputs.items()}
    values = study.values(rows)
    arrays["row"][:] = rows
    for column, path in enumerate(study.paths):
        arrays[path][:] = values[:, column]
    # What a row that cannot be simulated keeps: every other number stays at its fill value.
    arrays["status"][:] = Status.IMPOSSIBLE
    arrays["steps"][:] = arrays["rejected"][:] = 0
    possible, batch = read_rows(study, template, rows, values)
    if batch is None:
        return arrays
    if "time" in arrays:
        arrays["time"][possible] = batch.times
    solved = task.engine(batch, Request(study, task.threads))
    solved = with_extremes(solved, template if study.readings else None)
    if LEFT in outputs and LEAST_FORCE in solved:
        solved = solved | {LEFT: flag_departures(solved["status"], solved[LEAST_FORCE])}
    for name in outputs.keys() & solved.keys():
        array = solved[name]
        at_each_time = name in state_variables(template) and study.save == "end"
        arrays[name][possible] = array[:, -1] if at_each_time else array
    return arrays


SECONDS_BETWEEN_LOOKS = 0.02


class InThisProcess(concurrent.futures.Executor):
    """Computes at once, in this process."""

    def submit(self, fn, /, *args, **kwargs):
        """Returns the result of ``fn``, as a future."""
        future = concurrent.futures.Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            # Not BaseException: a Ctrl-C must end this process, and not become the result of a task.
            future.set_exception(error)
        return future

    def kill(self) -> None:
        """Does nothing, because there is nothing besides this process."""


class Processes(concurrent.futures.ThreadPoolExecutor):
    """A pool of processes, each started by a thread that passes it one call after another.

    Processes do not share pipes, so that the end of one, however it ends, does not block the others.
    """

    def __init__(self, workers: int):
        super().__init__(workers)
        self._of_thread, self._starting, self._killed = threading.local(), threading.Lock(), False
        self._started: list[tuple[Any, Any]] = []

    def submit(self, fn, /, *args, **kwargs):
        """Returns the result of ``fn``, a module-level function, as a future.

        Its ``result`` raises ``BrokenExecutor`` when the process was killed.
        """
        return super().submit(self._call, fn, args, kwargs)

    def kill(self) -> None:
        """Ends the processes at once; unfinished chunks have no mark in the store. No other process is started."""
        # With the lock that `_pipe` takes, a process either is in the list by now or is never started.
        with self._starting:
            self._killed = True
            for process, _ in self._started:
                process.kill()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Ends the processes when they have finished their current calls."""
        super().shutdown(wait, cancel_futures=cancel_futures)
        for process, pipe in self._started:
            # The process reads the end of its pipe, and ends its loop.
            pipe.close()
            process.join()

    def _call(self, *call: Any) -> Any:
        pipe = self._pipe()
        try:
            pipe.send(call)
            result, error = pipe.recv()
        # The other end is closed when a process ends, in whatever way.
        except (EOFError, OSError):
            raise concurrent.futures.BrokenExecutor("A process ended before its call did.") from None
        if error is not None:
            raise error
        return result

    def _pipe(self) -> Any:
        """Returns the pipe to the process of this thread, which is started if there is none."""
        with self._starting:
            if self._killed:
                raise concurrent.futures.BrokenExecutor("The processes were ended.")
            if not hasattr(self._of_thread, "pipe"):
                # A forked process would have JAX's threads in an unknown state.
                spawn = multiprocessing.get_context("spawn")
                here, there = spawn.Pipe()
                # On which results and the names of kept programs depend.
                settings = compat.settings().items()
                settings = {name: value for name, value in settings if isinstance(value, bool | int | float | str)}
                process = spawn.Process(target=_serve, args=(there, current.store(), settings), daemon=True)
                if os.name != "nt":  # where it starts one first, Python lets the signals through again
                    resource_tracker.ensure_running()
                # Importing JAX takes seconds, in which a Ctrl-C at the terminal would reach it too.
                with interruption.block_in_children():
                    process.start()
                # As long as this process held the other end, it would not notice when the worker closes it.
                there.close()
                self._started.append((process, here))
                self._of_thread.pipe = here
        return self._of_thread.pipe


def _serve(pipe: Connection, programs: current.Store | None, settings: dict[str, Any]) -> None:
    """Runs the loop of a process, until there is nothing more to do, or its parent has ended."""
    # A Ctrl-C goes to all processes of a terminal; the parent decides what becomes of the chunks.
    interruption.leave_to_parent()
    threading.Thread(target=_end_with_parent, name="end with parent", daemon=True).start()
    for name, value in settings.items():
        if compat.settings().get(name) != value:
            jax.config.update(name, value)
    current.keep_in(programs)
    with contextlib.suppress(EOFError, OSError):
        while True:
            function, args, kwargs = pipe.recv()
            try:
                answer = function(*args, **kwargs), None
            except Exception as error:
                # The pipe carries the error, but not its traceback, which becomes a note.
                error.add_note(f"In a worker: {traceback.format_exc()}")
                answer = None, error
            pipe.send(answer)


def _end_with_parent() -> None:
    """Ends this process, whatever it is doing, when its parent has ended in any way."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        # From a thread, an exception would end the thread only; a solve does not return to Python for long.
        os._exit(1)


def solve_all(executor: Any, tasks: Iterable[Task], ahead: int, stop: threading.Event) -> Iterator[ChunkResult]:
    """Returns the result of each task, in order of completion; at most ``ahead`` are submitted to the executor at a
    time.

    Once ``stop`` is set, no task begins, and those that have begun are completed. The executor's futures need only
    ``done`` and ``result``.

    **Raises:** whatever a task raised, and :class:`WorkerError` when a worker was killed.
    """
    function = solve_chunk if isinstance(executor, InThisProcess) else solve_chunk_elsewhere
    waiting, tasks = [], iter(tasks)
    # This process computes a task as it is submitted: with more than one ahead, progress would be shown late.
    ahead = 1 if isinstance(executor, InThisProcess) else ahead
    try:
        while True:
            while len(waiting) < ahead and not stop.is_set():
                task = next(tasks, None)
                if task is None:
                    break
                waiting.append(executor.submit(function, task))
            if not waiting:
                return
            # Those that have begun go on, since their work would be lost.
            if stop.is_set():
                waiting = [future for future in waiting if not _cancel(future)]
            ended = [future for future in waiting if future.done()]
            waiting = [future for future in waiting if future not in ended]
            for future in ended:
                yield future.result()
            # Futures of other libraries can only be asked, not waited for together.
            if not ended:
                time.sleep(SECONDS_BETWEEN_LOOKS)
    except concurrent.futures.BrokenExecutor:
        raise WorkerError(
            "A worker ended before its chunk was done: it was killed, perhaps because memory ran out. The store is "
            "intact; run the same command again, perhaps with fewer workers."
        ) from None
    # After an error of one task the others must not go on in a user's executor.
    finally:
        for future in waiting:
            _cancel(future)


def _cancel(future: Any) -> bool:
    """Cancels a task that has not begun, where the executor can; returns whether it did."""
    return bool(getattr(future, "cancel", lambda: False)())
