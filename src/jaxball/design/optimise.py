"""The search for a design: Adam from many starts, and a polish of the most promising within an augmented Lagrangian."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..numerics.batches import in_batches
from . import bfgs, newton
from .adam import Moments
from .curvature import curved_at
from .errors import DesignError
from .lagrangian import Multipliers
from .looked import Looked, looked_at
from .program import AbstractProgram
from .settings import Settings
from .state import Progress, Worth

Report = Callable[[Progress], None]
SEEN_BY = {"bfgs": looked_at, "gauss-newton": curved_at}
# How much nearer to a stationary point Newton's method comes in each round, for a step or two more.
CLOSER = 1e-3
REPORT_EVERY = 10
ENOUGH = 0.25
GROWTH = 4.0


class Optimiser:
    """Solves a program step by step; each step takes a :class:`Progress` further.

    **Arguments:**

    - ``program``: what is minimised, and under which constraints.
    - ``settings``: how it is searched.
    """

    def __init__(self, program: AbstractProgram, settings: Settings):
        self.program, self.settings = program, settings

    def begin(self) -> Progress:
        """The starts.

        **Raises:** :class:`DesignError` when no start can be simulated.
        """
        z = self.program.starts(self.settings)
        progress = Progress("adam", 0, z, list(Moments.none(z.shape)), z[0])
        leader = self._offer(progress, z, self.look(z, self.penalised(len(z))))
        if not np.isfinite(leader.objective):
            raise DesignError(
                f"None of the {len(z)} starts can be simulated to its end; start from a design that can, or with a "
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
        """The polish begun anew with each place to be overfulfilled by ``excess`` more."""
        value, penalty, margin, _ = progress.arrays
        progress.phase, progress.step = "polish", 0
        progress.z[0], progress.worth = progress.best, Worth()
        progress.arrays = [value, penalty, margin + excess[None], np.full(len(penalty), np.inf)]
        return progress

    def look(self, z: Float[np.ndarray, "starts n"], multipliers: Multipliers) -> Looked:
        """The augmented Lagrangian and its derivatives at any number of designs, ``lanes`` at a time."""
        function = SEEN_BY[self.settings.method](self.program)
        return Looked(
            *in_batches(lambda rows: function(*jax.tree.map(jnp.asarray, rows)), (z, multipliers), self.lanes)
        )

    @property
    def lanes(self) -> int:
        """How many designs are computed side by side."""
        return min(self.settings.starts, self.settings.polished)

    def penalised(self, count: int) -> Multipliers:
        """No multipliers, and the first penalty, for so many designs."""
        nothing = np.zeros((count, self.program.places.size))
        return Multipliers(nothing, np.full(count, self.settings.penalty), nothing)

    def _descend(self, progress: Progress) -> Progress:
        z, before = progress.z, progress.z
        moments, multipliers, leader = Moments(*progress.arrays), self.penalised(len(z)), Worth()
        count = min(REPORT_EVERY, self.settings.steps - progress.step)
        for _ in range(count):
            looked = self.look(z, multipliers)
            leader = self._offer(progress, z, looked)
            good = np.all(np.isfinite(looked.gradient), axis=1, keepdims=True) & np.isfinite(looked.value)[:, None]
            moments = moments.after(np.where(good, looked.gradient, 0.0))
            onwards = z + moments.step(self.settings.learning_rate)
            # A design that cannot be simulated goes half way back.
            z, before = np.where(good, onwards, (z + before) / 2), np.where(good, z, before)
            progress.step += 1
        progress.z, progress.arrays = z, list(moments)
        if count:
            progress.history.append((0.0, float(progress.step), *leader))
        if progress.step >= self.settings.steps:
            self._choose(progress)
        return progress

    def _choose(self, progress: Progress) -> None:
        """The most promising are polished: of where the starts have come to, and of the best, past which one may be."""
        z = np.unique([*progress.z, progress.best], axis=0)
        promising = np.argsort(self.look(z, self.penalised(len(z))).value, kind="stable")[: self.lanes]
        progress.z, progress.phase, progress.step = z[promising], "polish", 0
        multipliers = map(np.asarray, self.penalised(len(promising)))
        progress.arrays = [*multipliers, np.full(len(promising), np.inf)]

    def _polish(self, progress: Progress) -> Progress:
        settings = self.settings
        multipliers, before = Multipliers(*progress.arrays[:3]), progress.arrays[3]
        found = self._minimised(progress.z, multipliers)
        looked = self.look(found.z, multipliers)
        leader = self._offer(progress, found.z, looked)
        violation = looked.violation
        wanted = np.maximum(ENOUGH * before, settings.tolerance)
        slow = np.isfinite(before) & ~(violation <= wanted)
        penalty = np.where(slow, GROWTH * multipliers.penalty, multipliers.penalty)
        value = np.where(np.isfinite(looked.pushed), looked.pushed, multipliers.value)
        progress.z, progress.step = found.z, progress.step + 1
        progress.arrays = [value, penalty, np.asarray(multipliers.margin), violation]
        progress.history.append((1.0, float(progress.step), *leader))
        if progress.step >= settings.rounds or self._solved(looked, progress):
            progress.phase = "done"
        return progress

    def _minimised(self, z: Float[np.ndarray, "starts n"], multipliers: Multipliers) -> bfgs.Point:
        """Where the augmented Lagrangian is least."""
        settings = self.settings

        def sloped(z):
            looked = self.look(z, multipliers)
            return looked.value, looked.gradient

        def curved(z):
            looked = self.look(z, multipliers)
            assert looked.hessian is not None
            return looked.value, looked.gradient, looked.hessian

        if settings.method == "gauss-newton":
            return newton.minimise(curved, z, settings.evaluations, CLOSER * settings.stationary)
        return bfgs.minimise(sloped, z, settings.evaluations, settings.stationary)

    def _solved(self, looked: Looked, progress: Progress) -> bool:
        """Whether the best design is stationary, and no start promises a better one."""
        worths, settings = self._worths(looked), self.settings
        done = [w.violation <= settings.tolerance and w.gradient <= 10 * settings.stationary for w in worths]
        hopeless = [not np.isfinite(w.objective) or w.objective > 1.05 * progress.worth.objective for w in worths]
        best = progress.worth.violation <= settings.tolerance
        return any(done) and best and all(a or b for a, b in zip(done, hopeless, strict=True))

    def _offer(self, progress: Progress, z: np.ndarray, looked: Looked) -> Worth:
        return progress.offer(z, self._worths(looked), self.settings.tolerance)

    def _worths(self, looked: Looked) -> list[Worth]:
        objective = looked.at.terms @ self.program.weights
        gradient = np.max(np.abs(looked.gradient), axis=1, initial=0.0)
        rows = zip(objective, looked.violation, gradient, looked.worst, strict=True)
        return [Worth(*map(float, row)) for row in rows]
