"""The search for a design: Adam from many starts, and a polish of the most promising within an augmented Lagrangian.

All starts are evaluated together, by one compiled program, which is called again and again: a solve inside a compiled
loop of a minimiser takes much longer to compile. Adam, BFGS and Newton's method work on arrays of NumPy.
"""

import dataclasses
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ....interface.output import replacing
from ....programs.batches import in_batches
from ..problem.space import DesignError
from .program import AbstractProgram, Lagrangians, Multipliers, Settings, by_gauss_newton, by_reverse_mode

FIRST, SECOND, ADAM_EPSILON = 0.9, 0.999, 1e-8
HOPELESS = 0.05  # of the best objective: a start that is worse by more need not be finished


class Adam(NamedTuple):
    """Adam (Kingma & Ba, ICLR 2015, algorithm 1), whose state can be written to a file.

    It is the running means of gradients and of their squares, and how many there were.
    """

    first: Float[np.ndarray, "starts n"]
    second: Float[np.ndarray, "starts n"]
    taken: np.ndarray

    @staticmethod
    def none(shape: tuple[int, ...]) -> "Adam":
        """Returns the state of Adam before the first gradient."""
        return Adam(np.zeros(shape), np.zeros(shape), np.asarray(0))

    def after(self, gradient: Float[np.ndarray, "starts n"]) -> "Adam":
        """Returns the state of Adam with one gradient more."""
        first = FIRST * self.first + (1 - FIRST) * gradient
        return Adam(first, SECOND * self.second + (1 - SECOND) * gradient**2, self.taken + 1)

    def step(self, rate: float) -> Float[np.ndarray, "starts n"]:
        """Returns the step to take."""
        # Both means start from 0; these denominators remove that bias.
        first = self.first / (1 - FIRST**self.taken)
        return -rate * first / (np.sqrt(self.second / (1 - SECOND**self.taken)) + ADAM_EPSILON)


DECREASE, CURVATURE = 1e-4, 0.9
LONGEST_NEWTON_STEP = 1.0

# To values, shape (starts,), gradients, (starts, n), and, for Newton's method, Hessians, (starts, n, n).
Function = Callable[[Float[np.ndarray, "starts n"]], tuple[Any, ...]]


class Point(NamedTuple):
    """The unknowns of each start with the function and its gradient there."""

    y: Float[np.ndarray, "starts n"]
    value: Float[np.ndarray, " starts"]
    gradient: Float[np.ndarray, "starts n"]

    def where(self, which: np.ndarray, other: "Point") -> "Point":
        """Returns this point in the starts ``which``, and the other elsewhere."""
        rows = (np.where(which if a.ndim == 1 else which[:, None], a, b) for a, b in zip(self, other, strict=True))
        return Point(*rows)


def bfgs(function: Function, y: Float[np.ndarray, "starts n"], evaluations: int, stationary: float) -> Point:
    """Finds the point that BFGS reaches from each start within ``evaluations``, by steps of the weak Wolfe conditions.

    It ends where no entry of the gradient is larger than ``stationary``. A trial at which the function is not finite
    counts as too long a step. The bisection of Lewis & Overton (Nonsmooth optimization via quasi-Newton methods, Math.
    Program. 141 (2013) 135, algorithm 2.6) does not need smoothness, which the least of many distances lacks.
    """
    starts, n = y.shape
    point = Point(y, *function(y)[:2])
    inverse = np.broadcast_to(np.eye(n), (starts, n, n)).copy()
    # `fresh` marks inverses that are the identity: they have no scale of the function yet.
    fresh = np.ones(starts, dtype=bool)
    direction = _towards(point, inverse)
    length = _first(direction)
    low, high = np.zeros(starts), np.full(starts, np.inf)
    for _ in range(evaluations):
        converged = np.max(np.abs(point.gradient), axis=1) <= stationary
        if np.all(converged | ~np.isfinite(point.value)):
            break
        # Converged starts stay where they are, but are evaluated with the others: all are rows of one program.
        trial = point.y + np.where(converged, 0.0, length)[:, None] * direction
        there = Point(trial, *function(trial)[:2])
        slope = np.sum(point.gradient * direction, axis=1)
        finite = np.isfinite(there.value) & np.all(np.isfinite(there.gradient), axis=1)
        # A trial that does not decrease the function enough was too long; one that does, but still falls steeply, too
        # short. Bisection continues between the two.
        enough = finite & (there.value <= point.value + DECREASE * length * slope)
        flat = enough & (np.sum(there.gradient * direction, axis=1) >= CURVATURE * slope)
        # Where bisection has reached rounding, any step that decreases the function is taken.
        stuck = (high - low < 1e-10 * np.maximum(high, 1e-10)) | (length > 1e6)
        moves = ~converged & (flat | (enough & stuck))
        inverse, fresh = _update_inverses(inverse, fresh, point, there, moves)
        high = np.where(enough, high, length)
        low = np.where(enough & ~flat, length, low)
        length = np.where(np.isfinite(high), (low + high) / 2, 2 * length)
        point = there.where(moves, point)
        # A direction without descent is replaced by steepest descent.
        reset = ~moves & stuck & ~fresh
        inverse[reset], fresh[reset] = np.eye(n), True
        begin = moves | reset
        direction = np.where(begin[:, None], _towards(point, inverse), direction)
        # A step of a quasi-Newton direction has the right scale, so that length 1 is tried first; steepest descent
        # has none.
        length = np.where(moves & ~fresh, 1.0, np.where(begin, _first(direction), length))
        low, high = np.where(begin, 0.0, low), np.where(begin, np.inf, high)
    return point


def _towards(point: Point, inverse: np.ndarray) -> np.ndarray:
    # A direction of 0 keeps a start whose gradient is not finite in its place.
    return -np.einsum("sij,sj->si", inverse, np.where(np.isfinite(point.gradient), point.gradient, 0.0))


def _first(direction: np.ndarray) -> np.ndarray:
    """Returns lengths of first steps that move y by no more than 0.1, a tenth of its scale."""
    return np.minimum(LONGEST_NEWTON_STEP, 0.1 / np.maximum(np.linalg.norm(direction, axis=1), 1e-300))


def _update_inverses(
    inverse: np.ndarray, fresh: np.ndarray, point: Point, there: Point, moves: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Updates inverse Hessians after the steps ``moves`` (Nocedal & Wright, eq. 6.17), the first scaled by eq. 6.20."""
    s, y = there.y - point.y, there.gradient - point.gradient
    product = np.sum(s * y, axis=1)
    sizes = np.linalg.norm(s, axis=1) * np.linalg.norm(y, axis=1)
    # BFGS keeps an inverse Hessian positive definite only where s · y > 0. The first Wolfe condition alone, which a
    # step in the limit of bisection fulfils, does not guarantee that.
    good = moves & (product > 1e-12 * np.where(np.isfinite(sizes), sizes, np.inf))
    for k in np.flatnonzero(good):
        H = inverse[k]
        if fresh[k]:
            # The identity knows no scale; this one is the curvature along the step just taken.
            H = np.eye(len(H)) * product[k] / (y[k] @ y[k])
        V = np.eye(len(H)) - np.outer(s[k], y[k]) / product[k]
        inverse[k] = V @ H @ V.T + np.outer(s[k], s[k]) / product[k]
    return inverse, fresh & ~good


FIRST_DAMPING, LESS_DAMPING, MORE_DAMPING = 1e-3, 0.2, 4.0
ENOUGH, GOOD = 1e-4, 0.5
# A step with a predicted decrease below this fraction of the function is the last: the rest is within the errors of
# solves.
LAST = 1e-10


def newton(function: Function, y: Float[np.ndarray, "starts n"], evaluations: int, stationary: float) -> Point:
    """Finds the point that Newton's method reaches from each start within ``evaluations``.

    It is damped after Levenberg and Marquardt. For a Hessian that is not positive definite, the absolute values of the
    eigenvalues are used, so that every step is a descent (Nocedal & Wright, Numerical Optimization, section 3.4).
    ``function`` returns values, gradients, and Hessians or approximations; otherwise as for :func:`bfgs`.
    """
    point, H = _evaluate(function, y)
    damping, done = np.full(len(y), FIRST_DAMPING), np.zeros(len(y), dtype=bool)
    for _ in range(evaluations):
        # A start that was not finite at first can never improve: it has no model to step by.
        done |= (np.max(np.abs(point.gradient), axis=1) <= stationary) | ~np.isfinite(point.value)
        if np.all(done):
            break
        step, promised = _step(point, H, damping)
        last = promised <= LAST * np.abs(point.value)
        there, H_there = _evaluate(function, point.y + np.where(done[:, None], 0.0, step))
        # NaN at a trial that cannot be simulated: it is no gain, so the step is rejected and damped more.
        gain = (point.value - there.value) / np.where(promised > 0, promised, 1.0)
        moves = ~done & (gain >= ENOUGH) & np.all(np.isfinite(there.gradient), axis=1)
        # Radii as in trust-region methods: where the model predicted well, damping falls towards Newton's own step.
        damping = np.where(moves, np.where(gain >= GOOD, LESS_DAMPING, 1.0), MORE_DAMPING) * damping
        point, H = there.where(moves, point), np.where(moves[:, None, None], H_there, H)
        done |= last
    return point


def _evaluate(function: Function, y: np.ndarray) -> tuple[Point, np.ndarray]:
    value, gradient, H = function(y)
    return Point(y, value, gradient), H


def _step(point: Point, H: np.ndarray, damping: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Computes the step, with each eigenvalue raised by this fraction of the largest, and its predicted decrease."""
    finite = np.isfinite(point.value) & np.all(np.isfinite(H), axis=(1, 2))
    # For NaN eigh may fail, and with it all starts; a row without a finite Hessian takes the identity.
    values, vectors = np.linalg.eigh(np.where(finite[:, None, None], H, np.eye(H.shape[1])))
    size = np.abs(values)
    along = np.einsum("sij,si->sj", vectors, np.where(np.isfinite(point.gradient), point.gradient, 0.0))
    moved = along / np.maximum(size + damping[:, None] * np.max(size, axis=1, keepdims=True), 1e-300)
    return -np.einsum("sij,sj->si", vectors, moved), np.sum(moved * (along - size * moved / 2), axis=1)


class Merit(NamedTuple):
    """The merit of a design: its objective, largest violation, and gradient of the Lagrangian.

    - ``objective``, ``violation``, ``gradient``: these three numbers.
    - ``place``: the index of the largest violation; −1 where there are no constraints.
    """

    objective: float = np.inf
    violation: float = np.inf
    gradient: float = np.inf
    place: float = -1.0

    def better_than(self, other: "Merit", tolerance: float) -> bool:
        """Returns whether this merit is better than another: feasible designs by their objective, and others by their
        violation.
        """
        if not np.isfinite(self.objective) or np.isnan(self.violation):
            return False
        # Within the tolerance no design is more feasible than another; their objectives decide.
        violation, other_violation = max(self.violation, tolerance), max(other.violation, tolerance)
        return (violation, self.objective) < (other_violation, other.objective)


@dataclasses.dataclass
class Progress:
    """The state of an optimisation between two of its steps.

    - ``phase``: ``adam``, ``polish`` or ``done``; ``step`` counts within it.
    - ``y``: the unknowns of the designs that are optimised side by side.
    - ``arrays``: the other arrays of the phase: moments of Adam, or multipliers.
    - ``best``, ``merit``: the best design so far.
    - ``history``: for each report, the phase (0 or 1), the step, and the merit of the best of ``y`` then.
    - ``elapsed``: the time taken, in seconds, including interrupted runs of the search.
    """

    phase: str
    step: int
    y: Float[np.ndarray, "starts n"]
    arrays: list[np.ndarray]
    best: Float[np.ndarray, " n"]
    merit: Merit = dataclasses.field(default_factory=Merit)
    history: list[tuple[float, ...]] = dataclasses.field(default_factory=list)
    elapsed: float = 0.0

    def offer(self, y: Float[np.ndarray, "starts n"], merits: list[Merit], tolerance: float) -> Merit:
        """Keeps the best of the offered designs if it is better than the best so far."""
        leader = Merit()
        for unknowns, merit in zip(y, merits, strict=True):
            if merit.better_than(leader, tolerance):
                leader = merit
            if merit.better_than(self.merit, tolerance):
                self.best, self.merit = np.array(unknowns), merit
        return leader


def save_progress(progress: Progress, path: Path, identity: str) -> None:
    """Writes the progress of the problem ``identity``, atomically."""
    arrays: dict[str, Any] = {f"array_{k}": array for k, array in enumerate(progress.arrays)}
    # A search that is killed while it writes leaves the previous file whole.
    with replacing(path) as beside, beside.open("wb") as file:
        np.savez(
            file,
            identity=identity,
            phase=progress.phase,
            step=progress.step,
            z=progress.y,
            best=progress.best,
            worth=np.asarray(progress.merit),
            elapsed=progress.elapsed,
            # Six columns: the phase, the step, and the four numbers of a merit. Without rows the shape must be given.
            history=np.asarray(progress.history, dtype=float).reshape(-1, 6),
            **arrays,
        )


def load_progress(path: Path, identity: str) -> Progress:
    """Reads the progress that was written.

    **Raises:** :class:`DesignError` where it belongs to another problem, or is not such a file.
    """
    try:
        if not zipfile.is_zipfile(path):
            raise zipfile.BadZipFile("it is no archive of arrays")
        # Opened here, because NumPy leaves a file that is cut open.
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            entries = dict(file)
        if str(entries["identity"]) == identity:
            return _progress_of(entries)
    except (OSError, ValueError, EOFError, LookupError, zipfile.BadZipFile) as error:
        raise DesignError(
            f'File "{path}" must be the progress of a design, but it cannot be read ({error}); choose another folder, '
            "or remove it."
        ) from None
    raise DesignError(f'File "{path}" is the progress of another problem; choose another folder, or remove it.')


def _progress_of(entries: Mapping[str, np.ndarray]) -> Progress:
    """Returns the progress that :func:`save_progress` wrote."""
    count = sum(name.startswith("array_") for name in entries)
    return Progress(
        phase=str(entries["phase"]),
        step=int(entries["step"]),
        y=entries["z"],
        arrays=[entries[f"array_{k}"] for k in range(count)],
        best=entries["best"],
        merit=Merit(*(float(x) for x in entries["worth"])),
        history=[tuple(float(x) for x in row) for row in entries["history"]],
        # Earlier files have no time.
        elapsed=float(entries.get("elapsed", 0.0)),
    )


Report = Callable[[Progress], None]
DERIVATIVES = {"bfgs": by_reverse_mode, "gauss-newton": by_gauss_newton}
# How much closer to a stationary point Newton's method gets in each round, for a step or two more.
CLOSER = 1e-3
REPORT_EVERY = 10
REDUCED = 0.25
GROWTH = 4.0


class Optimiser:
    """Minimises a ``program`` with these ``settings``, step by step; each step advances a :class:`Progress`."""

    def __init__(self, program: AbstractProgram, settings: Settings):
        self.program, self.settings = program, settings

    def begin(self) -> Progress:
        """Returns the progress at the starts.

        **Raises:** :class:`DesignError` when no start can be simulated.
        """
        y = self.program.starts(self.settings)
        progress = Progress("adam", 0, y, list(Adam.none(y.shape)), y[0])
        leader = self._offer(progress, y, self.evaluate(y, self.first_multipliers(len(y))))
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
        """Takes a few steps of Adam, or a round of the polish."""
        return self._descend(progress) if progress.phase == "adam" else self._polish(progress)

    def tighten(self, progress: Progress, excess: Float[np.ndarray, " places"]) -> Progress:
        """Restarts the polish with the margin of each point increased by ``excess``."""
        # The first of the polished makes room for the best design, which may have come from any start.
        value, penalty, margin, _ = progress.arrays
        progress.phase, progress.step = "polish", 0
        # The best merit was measured with the smaller margin. A design that keeps to the larger one may have a worse
        # objective, so that it would never replace it.
        progress.y[0], progress.merit = progress.best, Merit()
        progress.arrays = [value, penalty, margin + excess[None], np.full(len(penalty), np.inf)]
        return progress

    def evaluate(self, y: Float[np.ndarray, "starts n"], multipliers: Multipliers) -> Lagrangians:
        """Computes the augmented Lagrangian and its derivatives at any number of points, ``lanes`` at a time."""
        function = DERIVATIVES[self.settings.method](self.program)
        return in_batches(lambda rows: function(*rows), (y, multipliers), self.lanes)

    @property
    def lanes(self) -> int:
        """The number of designs computed side by side."""
        # The same number in both phases, so that both call one compiled program.
        return min(self.settings.starts, self.settings.polished)

    def first_multipliers(self, count: int) -> Multipliers:
        """Returns no multipliers, and the first penalty, for each of ``count`` designs."""
        # With multipliers 0 the augmented Lagrangian is the objective with a quadratic penalty, which Adam minimises.
        nothing = np.zeros((count, self.program.terms.layout.size))
        return Multipliers(nothing, np.full(count, self.settings.penalty), nothing)

    def _descend(self, progress: Progress) -> Progress:
        y, before = progress.y, progress.y
        moments, multipliers, leader = Adam(*progress.arrays), self.first_multipliers(len(y)), Merit()
        count = min(REPORT_EVERY, self.settings.steps - progress.step)
        for _ in range(count):
            lagrangians = self.evaluate(y, multipliers)
            leader = self._offer(progress, y, lagrangians)
            good = (
                np.all(np.isfinite(lagrangians.gradient), axis=1, keepdims=True)
                & np.isfinite(lagrangians.value)[:, None]
            )
            # A gradient of 0 in Adam's means, in the place of NaN, which would stay in them for ever.
            moments = moments.after(np.where(good, lagrangians.gradient, 0.0))
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
        """Chooses the most promising points for the polish: among the starts' current points and the best, which a
        start may have passed.
        """
        # `unique`, because the best design may also be the current point of a start.
        y = np.unique([*progress.y, progress.best], axis=0)
        promising = np.argsort(self.evaluate(y, self.first_multipliers(len(y))).value, kind="stable")[: self.lanes]
        progress.y, progress.phase, progress.step = y[promising], "polish", 0
        multipliers = map(np.asarray, self.first_multipliers(len(promising)))
        # No violation is known before the first round, which therefore raises no penalty.
        progress.arrays = [*multipliers, np.full(len(promising), np.inf)]

    def _polish(self, progress: Progress) -> Progress:
        settings = self.settings
        multipliers, before = Multipliers(*progress.arrays[:3]), progress.arrays[3]
        y = self._minimise(progress.y, multipliers).y
        lagrangians = self.evaluate(y, multipliers)
        leader = self._offer(progress, y, lagrangians)
        # A penalty grows only where multipliers alone did not bring the violation down.
        slow = np.isfinite(before) & ~(lagrangians.violation <= np.maximum(REDUCED * before, settings.tolerance))
        penalty = np.where(slow, GROWTH * multipliers.penalty, multipliers.penalty)
        # A design that cannot be simulated has no new multipliers; it keeps the old ones.
        value = np.where(np.isfinite(lagrangians.multipliers), lagrangians.multipliers, multipliers.value)
        progress.y, progress.step = y, progress.step + 1
        progress.arrays = [value, penalty, np.asarray(multipliers.margin), lagrangians.violation]
        progress.history.append((1.0, float(progress.step), *leader))
        if progress.step >= settings.rounds or self._is_solved(lagrangians, progress):
            progress.phase = "done"
        return progress

    def _minimise(self, y: Float[np.ndarray, "starts n"], multipliers: Multipliers) -> Point:
        """Finds where the augmented Lagrangian is least."""
        settings = self.settings

        def function(y: Float[np.ndarray, "starts n"]):
            lagrangians = self.evaluate(y, multipliers)
            return lagrangians.value, lagrangians.gradient, lagrangians.hessian

        if settings.method == "gauss-newton":
            return newton(function, y, settings.evaluations, CLOSER * settings.stationary)
        return bfgs(function, y, settings.evaluations, settings.stationary)

    def _is_solved(self, lagrangians: Lagrangians, progress: Progress) -> bool:
        """Returns whether the best design is stationary, and no other start may lead to a better one."""
        merits, settings = self._merits(lagrangians), self.settings
        done = [m.violation <= settings.tolerance and m.gradient <= 10 * settings.stationary for m in merits]
        # An objective may be negative, such as one that a largest speed enters.
        best_objective = progress.merit.objective
        worse = best_objective + HOPELESS * abs(best_objective)
        hopeless = [not np.isfinite(m.objective) or m.objective > worse for m in merits]
        # A start may be done without being the best design, which must be feasible itself.
        best = progress.merit.violation <= settings.tolerance
        return any(done) and best and all(a or b for a, b in zip(done, hopeless, strict=True))

    def _offer(self, progress: Progress, y: np.ndarray, lagrangians: Lagrangians) -> Merit:
        return progress.offer(y, self._merits(lagrangians), self.settings.tolerance)

    def _merits(self, lagrangians: Lagrangians) -> list[Merit]:
        objective = lagrangians.at.terms @ np.asarray(self.program.terms.weights)
        gradient = np.max(np.abs(lagrangians.gradient), axis=1, initial=0.0)
        rows = zip(objective, lagrangians.violation, gradient, lagrangians.worst, strict=True)
        return [Merit(*map(float, row)) for row in rows]
