"""Perturbed copies of the paper's ball in heyoka's batch mode, in as many processes as cores."""

import contextlib
import multiprocessing
import time
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Barrier

import heyoka as hk
import numpy as np
from comparison.problems.rolling import BALL
from comparison.translate import heyoka_system
from harness import timed
from perturbed import states

LANES = 8


class Batch:
    """As ``turns.Batch``. The rows are shared out evenly; every process builds programs of its own."""

    def __init__(self, q: np.ndarray, Omega: np.ndarray, cores: int):
        context = multiprocessing.get_context("spawn")
        self.start = context.Barrier(cores)  # kept, because its name goes when it does
        self.pipes = []
        for x in np.array_split(states(q, Omega), cores):
            mine, theirs = context.Pipe()
            context.Process(target=_serve, args=(x, self.start, theirs), daemon=True).start()
            self.pipes.append(mine)

    def build(self, tolerance: float) -> float:
        return max(self._ask("build", tolerance))

    def solve(self, tolerance: float) -> tuple[float, np.ndarray]:
        starts, ends, states = zip(*self._ask("solve", tolerance), strict=True)
        return max(ends) - min(starts), np.concatenate(states)

    def _ask(self, *question):
        for pipe in self.pipes:
            pipe.send(question)
        return [pipe.recv() for pipe in self.pipes]


class Share:
    """The rows of one process, eight at a time; the last row fills what is left over of the last eight."""

    def __init__(self, x: np.ndarray, start: Barrier):
        hk.llvm_state.set_diskcache_enabled(False)  # so that the build time is one of building
        self.rows, self.start = len(x), start
        self.x = np.ascontiguousarray(np.concatenate([x, np.repeat(x[-1:], -len(x) % LANES, axis=0)]).T)
        self.equations = heyoka_system(BALL.rates, len(BALL.initial), len(BALL.pieces[0].parameters))
        self.built = {}

    def build(self, tolerance: float) -> float:
        """Builds the integrator of a tolerance, which decides the order of its series; the seconds that it took."""
        if tolerance not in self.built:
            pars = np.zeros((2, LANES))
            self.built[tolerance] = timed(
                lambda: hk.taylor_adaptive_batch(self.equations, self.x[:, :LANES].copy(), tol=tolerance, pars=pars)
            )
        return self.built[tolerance][0]

    def solve(self, tolerance: float) -> tuple[float, float, np.ndarray]:
        """When it began and ended, by a clock that all processes share, and (q, Ω, z) of each row at t = 20."""
        integrator = self.built[tolerance][1]
        found = np.empty_like(self.x)
        self.start.wait()
        begun = time.monotonic()
        for k in range(0, found.shape[1], LANES):
            integrator.set_time(0.0)
            integrator.state[:] = self.x[:, k : k + LANES]
            for piece in BALL.pieces:
                integrator.pars[:] = np.reshape(piece.parameters, (-1, 1))
                integrator.propagate_until(piece.end)
            found[:, k : k + LANES] = integrator.state
        return begun, time.monotonic(), found[-9:, : self.rows].T


def _serve(x: np.ndarray, start: Barrier, pipe: Connection) -> None:
    share = Share(x, start)
    with contextlib.suppress(EOFError):
        while True:
            what, tolerance = pipe.recv()
            pipe.send(getattr(share, what)(tolerance))
