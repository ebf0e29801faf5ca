"""Runs or resumes a study, whose workers write each chunk to the store when it is done, or estimates its cost."""

import contextlib
import math
import multiprocessing
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array

from ... import programs
from ...interface.arguments import require_flags, whole_number
from ...interface.interruption import on_interrupt, stop_requested
from ...interface.wording import duration, number_of
from ...numerics.arrays import arrays_of
from ...physics.rolling import AbstractRollingSystem
from ...programs.batches import of_rows
from ...programs.cpu import cores
from ...simulation.ensemble import AbstractReduction, simulate_ensemble
from ...simulation.ensemble.reductions import CONTACT as CONTACT_REDUCTIONS
from ...simulation.events import AbstractEvent, Detachment
from ...simulation.trajectory import Trajectory
from .executors import InThisProcess, Processes, Task, compute, solve_all, solve_chunk, solve_chunk_elsewhere
from .files import BYTES_OF_A_CHECKSUM, Damage, StudyError, list_chunks, remove_dead_parts
from .outputs import Output, history_results, outputs_of
from .progress import Progress, Stream, status_counts
from .rows import Batch, Engine, Request
from .store import POINTS_TOGETHER, Store, write_table
from .study import Study

# Rows that are computed together; results do not depend on it. A GPU has tens of thousands of threads.
ROWS_OF_CALL, ROWS_OF_CALL_ON_GPU = 2048, 2**17

WAITING = "Another process is at work on this part of the study; waiting until it ends.\n"


def solve_in_lanes(batch: Batch, request: Request) -> dict[str, np.ndarray]:
    """Solves the rows by :func:`jaxball.simulation.ensemble.simulate_ensemble`; an ``Engine``.

    **Arguments:**

    - ``batch``: the rows.
    - ``request``: what to compute for them.
    """
    first = batch.template
    rolls = isinstance(first.system, AbstractRollingSystem)
    reductions: dict[str, AbstractReduction] = {**CONTACT_REDUCTIONS} if request.study.contact and rolls else {}
    reductions |= {find.name: find.reduction() for find in request.study.finds}
    if first.feedback is not None:
        from .closed_loops import solve_loops  # which other studies do without

        return solve_loops(batch, request, reductions)
    # An event besides those of the scenario, of which nothing is kept.
    others: dict[str, AbstractEvent] = {"detachment": Detachment()} if request.study.detachment else {}
    # Arrays that are the same in all rows are not repeated for each, and what depends on them alone is computed once.
    system, state, events = batch.unstack_shared()
    *axes, axes_of_events = batch.in_axes
    settings: dict[str, Any] = {**first.settings, "rtol": batch.rtol, "atol": batch.atol}
    ensemble = simulate_ensemble(
        system,
        batch.times,
        state,
        # Further events have no numbers that change.
        in_axes=(*axes, axes_of_events | dict.fromkeys(others)),
        events=events | others,
        contact=batch.contact,
        **settings,
        reductions=reductions,
        # As many for each call, so that all chunks share one compiled program.
        chunk=min(request.study.chunk, ROWS_OF_CALL if jax.default_backend() == "cpu" else ROWS_OF_CALL_ON_GPU),
        threads=request.threads,
    )
    trajectory = ensemble.trajectory
    rows = {name: np.asarray(getattr(trajectory, name)) for name in ("status", "steps", "rejected", "reached")}
    results = arrays_of(trajectory.state) | history_results(trajectory.history) | ensemble.reductions
    for name in events:
        seen = trajectory.events[name]
        results |= {f"{name}_count": seen.count, f"{name}_time": seen.times[:, 0]}
    if request.study.readings:
        results |= {f"measured_{name}": read for name, read in _measure(batch.sensors, trajectory).items()}
    return rows | jax.tree.map(np.asarray, results)


@programs.filter_jit
def _measure(sensors: Any, trajectory: Trajectory[Any, Any]) -> dict[str, Array]:
    """Reads the sensors of each row."""
    return of_rows(lambda sensors, run: run.measured(sensors), sensors, trajectory)


TASKS_PER_WORKER = 2
STOPPING = "Stopping when the chunks being computed are in the store; {again} to stop at once."


class Outcome(NamedTuple):
    """The progress of a study.

    - ``store``, ``table``: the Zarr store, and the Parquet table, which exists once ``finished``.
    - ``rows``, ``done``: how many rows there are, and how many of them are in the store.
    - ``finished``: whether all are.
    - ``interrupted``: whether a signal, Ctrl-C or a command's SIGTERM or SIGHUP, ended the run.
    """

    store: Path
    table: Path
    rows: int
    done: int
    finished: bool
    interrupted: bool


def complete(
    store: Store, shard: tuple[int, int], workers: int, executor: Any, engine: Engine, stream: Stream, words: str
) -> Outcome:
    """Computes what is missing in a shard of the store, and says ``words`` when a signal stops it."""
    study = store.study
    stream.write(_describe_repair(study, store.repair()))
    # An executor of another library may not say how many workers it has.
    parallel = workers if executor is None else int(getattr(executor, "_max_workers", 0) or 32)
    before, counts = set(list_chunks(store.folder)), status_counts(store.folder)
    # Marks are read before the work: chunks that other shards finish meanwhile are not this shard's.
    shard_chunks = [k for k in range(shard[0] - 1, study.chunks, shard[1]) if k not in before]
    progress = Progress(stream, study.rows, counts, sum(len(study.rows_of(k)) for k in shard_chunks), parallel)
    threads = _threads(workers) if executor is None else 1
    tasks = (Task(study, store.folder, k, engine, threads) for k in shard_chunks)
    # No more processes than there are chunks, since each takes seconds to start.
    with stop_requested(words) as stop, _running(executor, min(workers, max(len(shard_chunks), 1))) as pool:
        try:
            for done in solve_all(pool, tasks, TASKS_PER_WORKER * parallel, stop):
                progress.add(done)
        except BaseException:
            # The line of progress is ended, so that an error begins on a line of its own.
            progress.close()
            raise
        # As counted in the store, which has the rows of other shards, too.
        progress.close(status_counts(store.folder))
        interrupted = stop.is_set()
    return _finish(store, interrupted)


def _describe_repair(study: Study, damages: list[Damage]) -> str:
    """Writes the line that says what is recomputed; empty if nothing is."""
    if not damages:
        return ""
    others = f" and {number_of(len(damages) - 1, 'other file')}" if damages[1:] else ""
    chunks = {damage.chunk for damage in damages if damage.chunk is not None}
    rows = sum(len(study.rows_of(chunk)) for chunk in chunks)
    again = f"{number_of(rows, 'row')} {'is' if rows == 1 else 'are'} computed again" if rows else "it is written again"
    return f'Something has changed "{damages[0].path}"{others}; {again}.\n'


def _finish(store: Store, interrupted: bool) -> Outcome:
    """Returns the outcome; the table is written if all chunks are done."""
    study, done = store.study, list_chunks(store.folder)
    finished = len(done) == study.chunks
    # A table's bytes depend on the store alone, so that one that exists is right, also after chunks were computed
    # again.
    if finished and not store.table.exists():
        # Of those who live, another sweep may be writing a chunk that has been done meanwhile.
        remove_dead_parts(store.folder, everywhere=True)
        write_table(store)
    rows = sum(len(study.rows_of(k)) for k in done)
    return Outcome(store.folder, store.table, study.rows, rows, finished, interrupted and not finished)


@contextlib.contextmanager
def _running(executor: Any, workers: int) -> Iterator[Any]:
    """Yields the given executor, which is left running, or a new one, which ends with the run."""
    if executor is not None:
        yield executor
        return
    # One worker is this process itself.
    pool = InThisProcess() if workers == 1 else Processes(workers)
    try:
        # A second Ctrl-C does not wait for the chunks being computed.
        with on_interrupt(pool.kill):
            yield pool
    except BaseException:
        # Without this, `shutdown` would wait for chunks that nobody will use.
        pool.kill()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _threads(workers: int) -> int:
    """Returns the number of cores that each of ``workers`` processes uses."""
    # Threads that share a core would only slow each other.
    return max(1, cores() // workers)


def check_arguments(workers: int, shard: tuple[int, int]) -> None:
    # A worker that is still importing the script would wait for the store, and the script for the worker.
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise StudyError(
            'A script that runs a sweep with several workers must do so under `if __name__ == "__main__":`, because '
            "each worker imports the script."
        )
    whole_number("workers", workers, 1)
    whole = isinstance(shard, tuple | list) and len(shard) == 2 and all(isinstance(part, int) for part in shard)
    if not whole or not 1 <= shard[0] <= shard[1]:
        raise ValueError(f"Argument `shard` must be (k, n) with k from 1 to n, but it is {shard!r}.")
    if not jax.config.read("jax_enable_x64"):
        raise StudyError(
            "A sweep needs float64, which is not enabled; call "
            '`jax.config.update("jax_enable_x64", True)` before the first array is made.'
        )


# How many rows are tried at first, and how many seconds a whole chunk may take to be tried as well.
TRIED, LONGEST = 512, 10.0
STARTING = 2.0  # seconds that a process takes at least to import JAX: what is done before needs no second one


class Estimate(NamedTuple):
    """Rows, chunks, the size of the store and, if measured, how long the sweep takes.

    **Arguments:**

    - ``rows``, ``chunks``, ``size``: how many, and the bytes of the store.
    - ``compiling``: how long compiling takes, seconds; what is kept is not compiled again.
    - ``starting``, ``solving``: how long the workers then take to start, and to solve all rows and write them, seconds.
    - ``workers``: for how many processes that is.
    """

    rows: int
    chunks: int
    size: int
    compiling: float | None = None
    solving: float | None = None
    starting: float = 0.0
    workers: int = 1

    def sentence(self) -> str:
        """Formats the estimate as text."""
        words = f"{number_of(self.rows, 'row')} in {number_of(self.chunks, 'chunk')}, a store of {_bytes(self.size)}"
        if self.compiling is None or self.solving is None:
            return words
        share = f", {duration(self.starting)} of it to start" if self.starting else ""
        return (
            f"{words}, about {duration(self.starting + self.solving)} with {number_of(self.workers, 'worker')}{share} "
            f"after compiling for {duration(self.compiling)}"
        )


def estimate(
    study: Study, engine: Engine | None = None, *, measure: bool = False, workers: int | None = None
) -> Estimate:
    require_flags(measure=measure)
    whole_number("workers", 1 if workers is None else workers, 1)
    outputs = outputs_of(study, study.template())
    numbers = sum(item.empty(study.chunk).nbytes for item in outputs.values()) * study.chunks
    points = sum(8 * axis.size * len(axis.paths) for axis in study.axes)
    files = len(outputs) * study.chunks + sum(-(-axis.size // POINTS_TOGETHER) * len(axis.paths) for axis in study.axes)
    unmeasured = Estimate(study.rows, study.chunks, numbers + points + BYTES_OF_A_CHECKSUM * files)
    if not measure:
        return unmeasured
    together = min(cores() if workers is None else workers, study.chunks)
    # A signal ends the process without leaving this block, which would remove the folder.
    with tempfile.TemporaryDirectory() as folder, on_interrupt(lambda: shutil.rmtree(folder)):
        task = Task(study, Path(folder), 0, engine or solve_in_lanes, _threads(1))
        alone = unmeasured._replace(**_alone(task, outputs))
        if together == 1 or (workers is None and _total(alone) < STARTING):
            return alone
        task = task._replace(threads=_threads(workers or together))
        if _total(alone) > LONGEST * study.chunks:  # beside which the start of a process is nothing
            shared = _alone(task, outputs)["solving"] / together
            others = alone._replace(solving=shared, workers=together)
        else:
            others = alone._replace(**_together(task, together), workers=together)
    return others if workers is not None else min(alone, others, key=_total)


def _total(estimate: Estimate) -> float:
    assert estimate.solving is not None
    return estimate.starting + estimate.solving


def _alone(task: Task, outputs: dict[str, Output]) -> dict[str, float]:
    """Measures how long this process takes to compile, and to solve all rows and write them unless a chunk
    takes long.
    """
    study, chunk = task.study, task.study.rows_of(task.chunk)
    # From all over the study, because rows at one end may take much longer than those at the other.
    tried = np.unique(np.linspace(0, study.rows - 1, min(TRIED, study.chunk)).astype(int))

    def solve_trial() -> None:
        compute(task, outputs, tried)

    # The first call compiles, the second one does not.
    first, again = _seconds(solve_trial), _seconds(solve_trial)
    each = again / len(tried)
    # Writing takes a part of the time, which only a whole chunk shows.
    if each * len(chunk) <= LONGEST:
        each = _seconds(lambda: solve_chunk(task)) / len(chunk)
    return {"compiling": max(0.0, first - again), "solving": each * study.rows}


def _together(task: Task, workers: int) -> dict[str, float]:
    """Measures how long ``workers`` processes take to start, and to solve and write all chunks, one each at a time."""
    # One chunk for each worker at the same time, as they share memory and cores in the sweep.
    tasks = [task._replace(chunk=chunk) for chunk in range(workers)]
    with _running(None, workers) as pool:

        def solve_all_of_them() -> None:
            for future in [pool.submit(solve_chunk_elsewhere, chunk_task) for chunk_task in tasks]:
                future.result()

        first, again = _seconds(solve_all_of_them), _seconds(solve_all_of_them)
    # Workers take chunks in rounds, of which the last may be incomplete.
    return {"starting": max(0.0, first - again), "solving": again * math.ceil(task.study.chunks / workers)}


def _seconds(call: Callable[[], Any]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def _bytes(size: int) -> str:
    units = ("B", "kB", "MB", "GB", "TB")
    power = min(int(math.log10(max(size, 1))) // 3, len(units) - 1)
    return f"{size / 1000**power:.3g} {units[power]}"


@contextlib.contextmanager
def only_one(store: Path, shard: tuple[int, int], stream: Stream) -> Iterator[None]:
    """Runs the block when no other process is in such a block for the same store and shard, which ``stream`` is told.

    The system releases the lock of a process that is killed. Where a file system has no locks there are none: two
    processes then compute the same rows, and write the same files.
    """
    # Imported here, because it belongs to the extra `sweep`.
    import filelock

    # Beside the store, whose files are the same whatever wrote them.
    path = store.with_name(f".lock-{store.name}-{shard[0]}-{shard[1]}")
    lock = filelock.FileLock(path)
    with contextlib.suppress(OSError, NotImplementedError):
        try:
            lock.acquire(timeout=0)
        except filelock.Timeout:
            stream.write(WAITING)
            lock.acquire()
    try:
        yield
    finally:
        if lock.is_locked:
            with contextlib.suppress(OSError):
                path.unlink()  # whoever waits for it has it open, and finds all rows done
        lock.release()
