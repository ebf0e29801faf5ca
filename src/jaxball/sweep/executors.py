"""Where chunks are computed: in this process, in processes of its own, or wherever an executor sends them."""

import concurrent.futures
import multiprocessing
import multiprocessing.context
import multiprocessing.util
import threading
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from .. import cache
from ..interface import interruption
from .chunk import Done, Task, solve_chunk, solve_chunk_elsewhere
from .errors import WorkerError

SECONDS_BETWEEN_LOOKS = 0.02
_starting = threading.Lock()


class _Here(concurrent.futures.Executor):
    """Computes at once, in this process."""

    def submit(self, fn, /, *args, **kwargs):
        future = concurrent.futures.Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class _Worker(multiprocessing.context.SpawnProcess):
    """Importing JAX takes seconds, in which a Ctrl-C at the terminal would reach it too."""

    def start(self) -> None:
        with _starting, interruption.blocked_in_children():
            super().start()


class _Context(multiprocessing.context.SpawnContext):
    Process = _Worker


def executor_of(workers: int) -> concurrent.futures.Executor:
    """An executor with so many processes, each started afresh; this process itself for one worker."""
    if workers == 1:
        return _Here()
    return concurrent.futures.ProcessPoolExecutor(
        workers, mp_context=_Context(), initializer=_begin, initargs=(cache.in_use(),)
    )


def _begin(folder: Path | None) -> None:
    """What a worker does first: it leaves Ctrl-C to its parent, and keeps programs where this does."""
    interruption.ignore_ctrl_c()
    if folder is not None:
        cache.enable(folder)


def kill_workers() -> None:
    """Ends the processes of :func:`executor_of` at once; what they have not finished has no mark in the store.

    For a process that ends: no worker can be started any more.
    """
    # A worker that is just being started is not yet among the children, and would complain of its parent's end.
    _starting.acquire()
    for process in multiprocessing.active_children():
        process.kill()
    # As Python does where a process ends by itself; else its tracker of resources complains of those that they shared.
    multiprocessing.util._run_finalizers(0)  # pyright: ignore[reportAttributeAccessIssue]


def solve_all(executor: Any, tasks: Iterable[Task], ahead: int, stop: threading.Event) -> Iterator[Done]:
    """What became of each task, in the order in which they end; no more than ``ahead`` are with the executor at a time.

    Once ``stop`` is set no task begins, and those that have begun come to their end. The executor's futures need
    ``done`` and ``result``, and no more.

    **Raises:** what a task raised, and :class:`WorkerError` when a worker was killed.
    """
    function = solve_chunk if isinstance(executor, _Here) else solve_chunk_elsewhere
    waiting, tasks = [], iter(tasks)
    ahead = 1 if isinstance(executor, _Here) else ahead
    try:
        while True:
            while len(waiting) < ahead and not stop.is_set():
                task = next(tasks, None)
                if task is None:
                    break
                waiting.append(executor.submit(function, task))
            if not waiting:
                return
            if stop.is_set():
                waiting = [future for future in waiting if not _cancelled(future)]
            ended = [future for future in waiting if future.done()]
            waiting = [future for future in waiting if future not in ended]
            for future in ended:
                yield future.result()
            if not ended:
                time.sleep(SECONDS_BETWEEN_LOOKS)
    except concurrent.futures.BrokenExecutor:
        raise WorkerError(
            "A worker ended before its chunk did: it was killed, perhaps for want of memory. What the store holds is "
            "whole; run the same command again, perhaps with fewer workers."
        ) from None
    finally:
        for future in waiting:
            _cancelled(future)


def _cancelled(future: Any) -> bool:
    """Cancels what has not begun, where the executor can; says whether it did."""
    return bool(getattr(future, "cancel", lambda: False)())
