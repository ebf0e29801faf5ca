"""The search for a design: Adam from many starts, and a polish of the most promising within an augmented Lagrangian."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ...numerics.batches import in_batches
from ..problem.variables import DesignError
from . import bfgs, newton
from .adam import Moments
from .lagrangian import Lagrangians, Multipliers, by_gauss_newton, by_reverse_mode
from .program import AbstractProgram
from .progress import Merit, Progress
from .settings import Settings

Report = Callable[[Progress], None]
DERIVATIVES = {"bfgs": by_reverse_mode, "gauss-newton": by_gauss_newton}
# How much closer to a stationary point Newton's method gets in each round, for a step or two more.
CLOSER = 1e-3
REPORT_EVERY = 10
ENOUGH = 0.25
GROWTH = 4.0


class Optimiser:
    """Solves a program step by step; each step advances a :class:`Progress`.

    **Arguments:**

    - ``program``: what is minimised, and under which constraints.
    - ``settings``: those of the search.
    """

    def __init__(self, program: AbstractProgram, settings: Settings):
        self.program, self.settings = program, settings

    def begin(self) -> Progress:
        """The starts.

        **Raises:** :class:`DesignError` when no start can be simulated.
        """
        y = self.program.starts(self.settings)
        progress = Progress("adam", 0, y, list(Moments.none(y.shape)), y[0])
        leader = self._offer(progress, y, self.evaluate(y, self.penalised(len(y))))
        if not np.isfinite(leader.objective):
            raise DesignError(
                f"None of the {len(y)} starts can be simulated to its end; start from a design that can be, or use a "
                "smaller spread."
            )
        progress.history.append((0.0, 0.0, *leader))
        return progress

    def run(self, progress: Progress, report: Report) -> Progress:
        """Steps until the end; ``report`` is called after every few."""
        while progress.phase != "done":
            progress = self.advance(progress)
            report(progress)
        return progress

    def advance(self, progress: Progress) -> Progress:
        """A few steps of Adam, or a round of the polish."""
        return self._descend(progress) if progress.phase == "adam" else self._polish(progress)

    def tighten(self, progress: Progress, excess: Float[np.ndarray, " places"]) -> Progress:
        """The polish restarted with the margin of each point increased by ``excess``."""
        value, penalty, margin, _ = progress.arrays
        progress.phase, progress.step = "polish", 0
        progress.y[0], progress.merit = progress.best, Merit()
        progress.arrays = [value, penalty, margin + excess[None], np.full(len(penalty), np.inf)]
        return progress

    def evaluate(self, y: Float[np.ndarray, "starts n"], multipliers: Multipliers) -> Lagrangians:
        """The augmented Lagrangian and its derivatives at any number of points, ``lanes`` at a time."""
        function = DERIVATIVES[self.settings.method](self.program)
        return in_batches(lambda rows: function(*jax.tree.map(jnp.asarray, rows)), (y, multipliers), self.lanes)

    @property
    def lanes(self) -> int:
        """The number of designs computed side by side."""
        return min(self.settings.starts, self.settings.polished)

    def penalised(self, count: int) -> Multipliers:
        """No multipliers, and the first penalty, for so many designs."""
        nothing = np.zeros((count, self.program.places.size))
        return Multipliers(nothing, np.full(count, self.settings.penalty), nothing)

    def _descend(self, progress: Progress) -> Progress:
        y, before = progress.y, progress.y
        moments, multipliers, leader = Moments(*progress.arrays), self.penalised(len(y)), Merit()
        count = min(REPORT_EVERY, self.settings.steps - progress.step)
        for _ in range(count):
            at = self.evaluate(y, multipliers)
            leader = self._offer(progress, y, at)
            good = np.all(np.isfinite(at.gradient), axis=1, keepdims=True) & np.isfinite(at.value)[:, None]
            moments = moments.after(np.where(good, at.gradient, 0.0))
            onwards = y + moments.step(self.settings.learning_rate)
            # A design that cannot be simulated moves half way back.
            y, before = np.where(good, onwards, (y + before) / 2), np.where(good, y, before)
            progress.step += 1
        progress.y, progress.arrays = y, list(moments)
        if count:
            progress.history.append((0.0, float(progress.step), *leader))
        if progress.step >= self.settings.steps:
            self._choose(progress)
        return progress

    def _choose(self, progress: Progress) -> None:
        """The most promising are polished: among the starts' current points and the best, which one may have passed."""
        y = np.unique([*progress.y, progress.best], axis=0)
        promising = np.argsort(self.evaluate(y, self.penalised(len(y))).value, kind="stable")[: self.lanes]
        progress.y, progress.phase, progress.step = y[promising], "polish", 0
        multipliers = map(np.asarray, self.penalised(len(promising)))
        progress.arrays = [*multipliers, np.full(len(promising), np.inf)]

    def _polish(self, progress: Progress) -> Progress:
        settings = self.settings
        multipliers, before = Multipliers(*progress.arrays[:3]), progress.arrays[3]
        y = self._minimised(progress.y, multipliers).y
        at = self.evaluate(y, multipliers)
        leader = self._offer(progress, y, at)
        slow = np.isfinite(before) & ~(at.violation <= np.maximum(ENOUGH * before, settings.tolerance))
        penalty = np.where(slow, GROWTH * multipliers.penalty, multipliers.penalty)
        value = np.where(np.isfinite(at.multipliers), at.multipliers, multipliers.value)
        progress.y, progress.step = y, progress.step + 1
        progress.arrays = [value, penalty, np.asarray(multipliers.margin), at.violation]
        progress.history.append((1.0, float(progress.step), *leader))
        if progress.step >= settings.rounds or self._solved(at, progress):
            progress.phase = "done"
        return progress

    def _minimised(self, y: Float[np.ndarray, "starts n"], multipliers: Multipliers) -> bfgs.Point:
        """Where the augmented Lagrangian is least."""
        settings = self.settings

        def function(y: Float[np.ndarray, "starts n"]):
            at = self.evaluate(y, multipliers)
            return at.value, at.gradient, at.hessian

        if settings.method == "gauss-newton":
            return newton.minimise(function, y, settings.evaluations, CLOSER * settings.stationary)
        return bfgs.minimise(function, y, settings.evaluations, settings.stationary)

    def _solved(self, at: Lagrangians, progress: Progress) -> bool:
        """Whether the best design is stationary, and no other start may lead to a better one."""
        merits, settings = self._merits(at), self.settings
        done = [m.violation <= settings.tolerance and m.gradient <= 10 * settings.stationary for m in merits]
        hopeless = [not np.isfinite(m.objective) or m.objective > 1.05 * progress.merit.objective for m in merits]
        best = progress.merit.violation <= settings.tolerance
        return any(done) and best and all(a or b for a, b in zip(done, hopeless, strict=True))

    def _offer(self, progress: Progress, y: np.ndarray, at: Lagrangians) -> Merit:
        return progress.offer(y, self._merits(at), self.settings.tolerance)

    def _merits(self, at: Lagrangians) -> list[Merit]:
        objective = at.at.terms @ self.program.weights
        gradient = np.max(np.abs(at.gradient), axis=1, initial=0.0)
        rows = zip(objective, at.violation, gradient, at.worst, strict=True)
        return [Merit(*map(float, row)) for row in rows]
