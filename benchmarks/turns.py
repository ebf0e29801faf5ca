"""Contenders in processes of their own, which take turns on the same cores.

XLA reads its flags once a process, and the threads of one package would disturb another's.
"""

import abc
import importlib
import multiprocessing
import traceback
from collections.abc import Sequence
from multiprocessing.connection import Connection
from typing import NamedTuple, Protocol

import harness
import numpy as np
import perturbed


class Batch(Protocol):
    """A way to solve many runs, made of the initial q and Ω of each and of the number of cores."""

    def __init__(self, q: np.ndarray, Omega: np.ndarray, cores: int): ...

    def build(self, tolerance: float) -> float:
        """Compiles what a tolerance needs, where that was not done before; the seconds that it took then."""
        ...

    def solve(self, tolerance: float) -> tuple[float, np.ndarray]:
        """The seconds that all runs took, and (q, Ω, z) of each at t = 20."""
        ...


class Compiled(abc.ABC):
    """Solves whose programs know no tolerance, so that one is built for all: the first call, less the second."""

    _seconds: float | None = None

    def build(self, tolerance: float) -> float:
        """As :class:`Batch`."""
        if self._seconds is None:
            self._seconds = self.solve(tolerance)[0] - self.solve(tolerance)[0]
        return self._seconds

    def solve(self, tolerance: float) -> tuple[float, np.ndarray]:
        """As :class:`Batch`."""
        return harness.timed(lambda: self.final(tolerance))

    @abc.abstractmethod
    def final(self, tolerance: float) -> np.ndarray:
        """(q, Ω, z) of each row at t = 20."""


class Contender(NamedTuple):
    """A :class:`Batch` by name, and how many of the runs it solves.

    ``place`` is ``module:class``; ``cpu_settings`` and ``gpu`` are what ``harness.set_up_jax`` is given.
    """

    name: str
    place: str
    rows: int
    cpu_settings: bool = True
    gpu: bool = False


class LeftOutError(Exception):
    """Why a contender does not take part, as a sentence."""


class Seat:
    """The process in which a contender lives. What it was asked to do has ended when a method returns."""

    def __init__(self, contender: Contender, total: int, cores: int):
        context = multiprocessing.get_context("spawn")
        self.contender = contender
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(contender, total, cores, theirs))
        self._process.start()
        theirs.close()
        self._answer()

    def ask(self, what: str, tolerance: float):
        """What a method of the batch returns, ``what`` being its name."""
        self._pipe.send((what, tolerance))
        return self._answer()

    def close(self) -> None:
        """Ends the process."""
        self._pipe.close()
        self._process.join()

    def _answer(self):
        try:
            failure, answer = self._pipe.recv()
        except EOFError:
            failure, answer = "its process ended.", None
        if failure:
            self.close()
            raise LeftOutError(f"Left out: {self.contender.name}, because {failure}")
        return answer


class Seats:
    """The contenders that take part. One that fails leaves, and a line says why; ``with`` ends their processes."""

    def __init__(self, contenders: Sequence[Contender], total: int, cores: int):
        self._seats: dict[str, Seat] = {}
        for contender in contenders:
            try:
                self._seats[contender.name] = Seat(contender, total, cores)
            except LeftOutError as reason:
                print(reason, flush=True)

    @property
    def contenders(self) -> list[Contender]:
        """Those that are still there."""
        return [seat.contender for seat in self._seats.values()]

    def build(self, contender: Contender, tolerance: float) -> float | None:
        """As :meth:`Batch.build`; None where it fails."""
        return self._ask(contender, "build", tolerance)

    def solve(self, contender: Contender, tolerance: float) -> tuple[float, np.ndarray] | None:
        """As :meth:`Batch.solve`; None where it fails."""
        return self._ask(contender, "solve", tolerance)

    def __enter__(self) -> "Seats":
        return self

    def __exit__(self, *_) -> None:
        for seat in self._seats.values():
            seat.close()

    def _ask(self, contender: Contender, what: str, tolerance: float):
        try:
            return self._seats[contender.name].ask(what, tolerance) if contender.name in self._seats else None
        except LeftOutError as reason:
            print(reason, flush=True)
            del self._seats[contender.name]
            return None


def apart(function, *arguments):
    """The result of a function in a process of its own, which leaves nothing behind in this one."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(function, arguments)


def _serve(contender: Contender, total: int, cores: int, pipe: Connection) -> None:
    try:
        harness.set_up_jax(contender.cpu_settings, contender.gpu)
        module, name = contender.place.split(":")
        q, Omega = perturbed.initial(total)
        batch = getattr(importlib.import_module(module), name)(q[: contender.rows], Omega[: contender.rows], cores)
        pipe.send(("", None))
        while True:
            what, tolerance = pipe.recv()
            pipe.send(("", getattr(batch, what)(tolerance)))
    except EOFError:
        pass
    except ModuleNotFoundError as missing:
        pipe.send((f"{harness.not_installed(str(missing.name))}.", None))
    except Exception as reason:
        traceback.print_exc()
        pipe.send((f"it raised {type(reason).__name__}: {reason}", None))
