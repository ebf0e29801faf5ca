"""Solves a problem: checks the gradient, searches for a design, saves, verifies, and tightens constraints if needed."""

import dataclasses
import secrets
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import tomli_w
from jaxtyping import Float

from ....interface.output import check_folder, write_text
from ....interface.printing import repr_html
from ....interface.wording import number_of
from ....programs.identity.fingerprints import fingerprint
from ....programs.identity.names import NoNameError
from ....programs.program import compile_quickly
from ..problem.problem import Evaluation, Problem
from .optimise import Merit, Optimiser, Progress, load_progress, save_progress
from .program import Settings, Shooting
from .verify import (
    MODES_AGREE,
    GradientCheck,
    Verified,
    as_built,
    check_gradient,
    require_good,
)

PROGRESS, SCENARIO = "progress.npz", "design.toml"
TIGHTENINGS = 3
# A constraint that is violated between the samples is tightened by this much more than its violation.
TIGHTENED_BY = 1.2
# Up to this number of evaluations, a program that was compiled quickly is done before another one is optimised.
FEW_EVALUATIONS = 1000
# A target missed by this many radii was not reached.
MISSED = 0.1


@dataclasses.dataclass(frozen=True)
class Design:
    """A finished design.

    - ``problem``, ``settings``: what was solved, and how.
    - ``numbers``: the values of the variables.
    - ``check``: that of the gradient at the start; None if the search was resumed.
    - ``progress``: how it was found. ``merit`` and ``feasible`` describe it.
    - ``before``, ``verified``, ``perturbed``: the given design; this one by other means; and with perturbations.
    """

    problem: Problem
    settings: Settings
    numbers: Float[np.ndarray, " n"]
    check: GradientCheck | None
    progress: Progress
    before: Evaluation
    verified: Verified
    perturbed: Evaluation

    _repr_html_ = repr_html

    def __repr__(self) -> str:
        space = self.problem.space
        numbers = zip(space.names, self.numbers, strict=True)
        return "\n".join(
            [
                f"Design, {'feasible' if self.feasible else 'not feasible'}: objective {self.merit.objective:.6g}, "
                f"violation {self.verified.violation:.2g} by {self.verified.solver} between the samples too",
                *(f"  {name} = {number:.8g}{space.unit_of[name]}" for name, number in numbers),
            ]
        )

    @property
    def merit(self) -> Merit:
        """Its objective, largest violation and gradient, as the search evaluated them."""
        return self.progress.merit

    @property
    def feasible(self) -> bool:
        """Whether all constraints hold to the tolerance, also between the samples, by the other solver."""
        return self.verified.violation <= self.settings.tolerance

    @property
    def document(self) -> dict:
        """Its scenario, as a TOML document."""
        return self.problem.space.document_of(self.numbers)


def optimise(
    problem: Problem,
    settings: Settings | None = None,
    folder: str | Path | None = None,
    *,
    say: Callable[[str], None] = lambda line: None,
) -> Design:
    settings = Settings() if settings is None else settings
    if folder is not None:
        folder = Path(folder)
        check_folder(folder)
    with compile_quickly(settings.evaluations_at_most <= FEW_EVALUATIONS):
        return _run_search(problem, settings, folder, say)


def identify_search(problem: Problem, settings: Settings) -> str:
    """Returns what a search depends on, in a few letters, so that it is not resumed for another problem.

    Where a function of a user cannot be identified they are others each time, so that no search is resumed.
    """
    try:
        return fingerprint(problem.pytree, problem.space.start, settings).digest
    except NoNameError:
        return secrets.token_hex()


def _run_search(problem: Problem, settings: Settings, folder: Path | None, say: Callable[[str], None]) -> Design:
    began, identity = time.perf_counter(), identify_search(problem, settings)
    program = Shooting(problem, settings.intervals)
    optimiser = Optimiser(program, settings)
    check, progress = None, None
    if folder is not None and (folder / PROGRESS).exists():
        # A resumed search needs no check of its gradient: the one at its start has passed.
        progress = load_progress(folder / PROGRESS, identity)
        where = "the end of the search" if progress.phase == "done" else f"{progress.phase} {progress.step}"
        say(f"resumed from {where}, objective {progress.merit.objective:.6g}")
    else:
        say("compiling the gradient, and checking it at the start")
        check = check_gradient(
            optimiser, program.append_joints(problem.space.start[None])[0], enough=MODES_AGREE, say=say
        )
        say(f"gradient check\n{check}")
        require_good(check)
        say(f"improving {number_of(settings.starts, 'start')} by Adam, {settings.steps} steps each")
        progress = optimiser.begin()
    # The time of earlier runs counts too: `elapsed` is that of the whole search.
    began -= progress.elapsed

    def report(progress: Progress) -> None:
        progress.elapsed = time.perf_counter() - began
        phase, step, *leader = progress.history[-1]
        merit = Merit(*leader)
        say(line(("adam", "polish")[int(phase)], int(step), merit, program.terms.layout.name(int(merit.place))))
        if folder is not None:
            save(program, progress, folder, identity)
        if progress.phase == "polish" and progress.step == 0:
            most = f"at most {settings.rounds} rounds of {settings.evaluations} evaluations each"
            say(f"polishing {number_of(len(progress.y), 'design')} by {settings.method}, {most}")

    tightenings = 0
    while True:
        progress = optimiser.run(progress, report)
        y = program.design(progress.best)
        say("verifying by another solver, between the samples too")
        verified = problem.verify(y)
        # Where the other solver fails, there is no violation to tighten by.
        hopeless = not np.isfinite(verified.violation) or tightenings == TIGHTENINGS
        if hopeless or verified.violation <= settings.tolerance:
            break
        tightenings += 1
        # Only constraints that are violated get a larger margin; the others keep theirs.
        excess = {name: TIGHTENED_BY * max(0.0, fine) for name, (_, fine) in verified.violations.items()}
        say(f"between the samples constraints are violated by {verified.violation:.2e}: tightened")
        progress = optimiser.tighten(progress, program.terms.layout.spread(excess))
    say("evaluating the start, and perturbed balls")
    before = problem.verify(problem.space.start).designed
    numbers = problem.space.values(y)
    built = problem.perturbed(y, as_built(problem))
    progress.elapsed = time.perf_counter() - began
    # Once more, with the time of the verification; the design itself was saved after the last step.
    if folder is not None:
        save_progress(progress, folder / PROGRESS, identity)
    return Design(problem, settings, numbers, check, progress, before, verified, built)


def line(phase: str, step: int, merit: Merit, constraint: str) -> str:
    """Formats a line of progress; ``constraint`` is the one that is violated most, if one is."""
    violated = f"{max(merit.violation, 0.0):8.2e} {constraint if merit.violation > 0 else ''}"
    return (
        f"{phase:6} {step:4}  objective {merit.objective:12.6g}  gradient {merit.gradient:8.1e}  violation {violated}"
    ).rstrip()


def save(program: Shooting, progress: Progress, folder: Path, identity: str) -> None:
    """Writes the progress and the best design so far."""
    folder.mkdir(parents=True, exist_ok=True)
    # The progress first: after a kill between the two, a resumed search still has it, and writes the scenario again.
    save_progress(progress, folder / PROGRESS, identity)
    space = program.problem.space
    numbers = space.values(program.design(progress.best))
    write_text(folder / SCENARIO, tomli_w.dumps(space.document_of(numbers)))


def warnings(design: Design) -> list[str]:
    """Writes a sentence for each shortcoming of a design; none if all is well."""
    verified, tolerance = design.verified, design.settings.tolerance
    sentences = []
    if int(verified.finer.status) != 0:
        sentences.append(
            f"The best design could not be simulated to its end by {verified.solver}; allow more steps, or shorten the "
            "run."
        )
    violated = [f"`{name}` by {fine:.2g}" for name, (_, fine) in verified.violations.items() if not fine <= tolerance]
    if violated:
        sentences.append(
            f"The constraints could not all be fulfilled: the best design violates {', '.join(violated)}; check "
            "whether they contradict each other or the bounds, or search longer."
        )
    if verified.margin <= 0:
        sentences.append(
            f"The ball would leave the plane: its least normal force is {verified.margin:.2g} of its weight, and after "
            "that the equations of rolling do not hold; add the constraint `normal-force`."
        )
    sentences += [
        f"The target of `{name}` is missed by {by:.2g} radii, and nothing closer was found; give it more weight, more "
        "time or more variables, or another starting point."
        for name, by in verified.missed.items()
        if by > MISSED
    ]
    if not np.isfinite(design.merit.gradient):
        sentences.append(
            "The gradient at the best design is not finite, and the search could not continue from there; start "
            "elsewhere, or raise `max_steps`, of which a gradient may need more than its run."
        )
    return sentences
