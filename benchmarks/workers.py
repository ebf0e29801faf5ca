"""Processes that do one job after another, each within a time limit: one that hangs or crashes costs its job alone."""

import contextlib
import importlib
import multiprocessing
import os
import signal
import time
import traceback
from collections.abc import Sequence
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess

import harness

HONEST = {"CUDA_CACHE_DISABLE": "1", "JAXBALL_NO_CACHE": "1"}  # or compiling would take no time in a second session
LONGEST = 300  # characters of a reason
PATIENCE = 5.0  # seconds


class LostError(Exception):
    """Why a job has no result, as a sentence; ``details`` has the traceback where there is one."""

    def __init__(self, reason: str, details: str = ""):
        super().__init__(reason)
        self.details = details


class Worker:
    """A process with settings of its own for JAX, started at its first job, and anew after a job that failed.

    - ``platform``: ``"gpu"`` for the device that JAX chooses, or ``"cpu"``.
    - ``compiler``: for ``JAXBALL_COMPILER``; empty for the default.
    """

    def __init__(self, platform: str, compiler: str = ""):
        self.platform = platform
        self._compiler = compiler
        self._process: SpawnProcess | None = None
        self._pipe: Connection | None = None

    def ask(self, seconds: float, place: str, *arguments):
        """The result of a job; see :meth:`begin` and :meth:`result`."""
        self.begin(place, *arguments)
        return self.result(seconds)

    def begin(self, place: str, *arguments) -> None:
        """Starts a job, the function ``module:name`` with these arguments."""
        if self._process is None or self._pipe is None:
            context = multiprocessing.get_context("spawn")
            self._pipe, theirs = context.Pipe()
            self._process = context.Process(target=_serve, args=(self.platform, self._compiler, theirs))
            self._process.start()
            theirs.close()
        with contextlib.suppress(OSError):  # where the process has ended, which `result` says
            self._pipe.send((place, arguments))

    def result(self, seconds: float):
        """What the job returned.

        **Raises:** :class:`LostError` where it took longer than ``seconds``, raised an exception or ended its process.
        """
        assert self._pipe is not None
        try:
            if not self._pipe.poll(max(seconds, 0.0)):
                self.close(patience=0.0)
                raise LostError(f"it did not end within {seconds:.0f} s")
            reason, answer = self._pipe.recv()
        except (EOFError, OSError):
            raise LostError(f"its process ended{self._exit_code()}") from None
        if reason:
            self.close()  # after an error of a GPU, all that follows in its process fails
            raise LostError(reason, answer)
        return answer

    def close(self, patience: float = PATIENCE) -> None:
        """Lets the process end, and ends it with its own processes where it has not within ``patience`` seconds."""
        if self._process is not None and self._pipe is not None:
            self._pipe.close()
            self._process.join(patience)
            if self._process.is_alive():
                _kill(self._process)
        self._process = self._pipe = None

    def __enter__(self) -> "Worker":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def _exit_code(self) -> str:
        assert self._process is not None
        self._process.join(5.0)
        code = self._process.exitcode
        self.close()
        if code is None:
            return ""
        return f" by signal {-code}" if code < 0 else f" with exit code {code}"


class Budget:
    """The seconds that are left of a total, and of the part that belongs to the section in progress."""

    def __init__(self, total: float):
        self._start = time.monotonic()
        self._end = self._end_of_section = self._start + total

    def begin_section(self, share: float, later_shares: Sequence[float]) -> None:
        """Gives a section its share of what is left, the others' being ``later_shares``."""
        self._end_of_section = time.monotonic() + self.total_left() * share / (share + sum(later_shares))

    def left(self, at_most: float = float("inf")) -> float:
        """Seconds left to the section, but not more than ``at_most``."""
        return min(self._end_of_section - time.monotonic(), at_most)

    def stop(self) -> None:
        """Leaves no time to anything."""
        self._end = self._end_of_section = time.monotonic()

    def spent(self) -> float:
        """Seconds since it began."""
        return time.monotonic() - self._start

    def total_left(self) -> float:
        """Seconds left of the total."""
        return self._end - time.monotonic()


def _kill(process: SpawnProcess) -> None:
    """Ends a process of :func:`_serve` and those that it started, which are its group."""
    assert process.pid is not None
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except (AttributeError, OSError):  # there are no groups on this system, or it has not made its own yet
        process.kill()
    process.join(PATIENCE)  # a driver may hold it for longer


def _serve(platform: str, compiler: str, pipe: Connection) -> None:
    if hasattr(os, "setsid"):
        os.setsid()  # Ctrl-C is for the process that waits, which ends this one
    os.environ.update(HONEST)
    if compiler:
        os.environ["JAXBALL_COMPILER"] = compiler
    harness.set_up_jax(cpu_settings=False, gpu=platform == "gpu")
    while True:
        try:
            place, arguments = pipe.recv()
        except (EOFError, KeyboardInterrupt):
            return
        pipe.send(_outcome(place, arguments))


def _outcome(place: str, arguments: tuple) -> tuple:
    """An empty reason and the result, or the last line of a traceback and the traceback."""
    try:
        module, name = place.split(":")
        return "", getattr(importlib.import_module(module), name)(*arguments)
    except ModuleNotFoundError as missing:
        return harness.not_installed(str(missing.name)), ""
    except (Exception, KeyboardInterrupt) as error:
        lines = traceback.format_exception_only(error)[-1].strip().splitlines()
        return (lines or [type(error).__name__])[0][:LONGEST], traceback.format_exc()
