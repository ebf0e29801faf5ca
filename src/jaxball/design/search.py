"""A problem solved: the gradient checked, a design looked for, kept, verified, and tightened where need be."""

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import tomli_w
from jaxtyping import Float

from ..interface.output import replacing
from .check import GradientCheck, check_gradient, require_good
from .optimise import Optimiser
from .problem import Evaluation, Problem
from .settings import Settings
from .shooting import Shooting
from .state import Progress, Worth, load_progress, save_progress
from .verify import Verified, as_built, perturbed, verify

PROGRESS, SCENARIO = "progress.npz", "design.toml"
TIGHTENINGS = 3
# A constraint that is violated between the samples is tightened by so much more than that.
MORE = 1.2


@dataclasses.dataclass(frozen=True)
class Design:
    """A finished design.

    - ``problem``, ``settings``: what was solved, and how.
    - ``numbers``: the values of the variables.
    - ``check``: that of the gradient at the start; None where the search was gone on with.
    - ``progress``: how it was found. ``worth`` and ``feasible`` say what it is.
    - ``before``, ``verified``, ``perturbed``: the given design; this one by other means; and as it may be built.
    """

    problem: Problem
    settings: Settings
    numbers: Float[np.ndarray, " n"]
    check: GradientCheck | None
    progress: Progress
    before: Evaluation
    verified: Verified
    perturbed: Evaluation

    def __repr__(self) -> str:
        numbers = zip(self.problem.space.names, self.numbers, strict=True)
        return "\n".join(
            [
                f"Design, {'feasible' if self.feasible else 'not feasible'}: objective {self.worth.objective:.6g}, "
                f"violation {self.verified.violation:.2g} by {self.verified.solver} between the samples too",
                *(f"  {name} = {number:.8g}" for name, number in numbers),
            ]
        )

    @property
    def worth(self) -> Worth:
        """Its objective, largest violation and gradient, as the search saw them."""
        return self.progress.worth

    @property
    def feasible(self) -> bool:
        """Whether all constraints hold to the tolerance between the samples too, by the other solver."""
        return self.verified.violation <= self.settings.tolerance

    @property
    def document(self) -> dict:
        """Its scenario, as a TOML document."""
        return self.problem.space.document_of(self.numbers)


def design(
    problem: Problem,
    settings: Settings | None = None,
    folder: Path | None = None,
    *,
    identity: str = "",
    say: Callable[[str], None] = lambda line: None,
) -> Design:
    """The best design that is found.

    **Arguments:**

    - ``problem``: what is wanted.
    - ``settings``: how it is searched; the defaults if not given.
    - ``folder``: where the progress and the best design so far are kept, each time they change; a search that was
      stopped is gone on with from there. Nothing is kept if not given.
    - ``identity``: what the search depends on, so that it is not gone on with for another problem.
    - ``say``: takes a line of progress.

    **Raises:** :class:`DesignError` where the gradient is wrong, no start can be simulated, or ``folder`` has the
    progress of another problem.
    """
    began = time.perf_counter()
    settings = Settings() if settings is None else settings
    program = Shooting(problem, settings.intervals)
    optimiser = Optimiser(program, settings)
    check, progress = None, None
    if folder is not None and (folder / PROGRESS).exists():
        progress = load_progress(folder / PROGRESS, identity)
        say(f"going on from {progress.phase} {progress.step}, objective {progress.worth.objective:.6g}")
    else:
        check = check_gradient(optimiser, program.joined(problem.space.start[None])[0])
        say(f"gradient check\n{check}")
        require_good(check)
        progress = optimiser.begin()
    began -= progress.elapsed

    def report(progress: Progress) -> None:
        progress.elapsed = time.perf_counter() - began
        phase, step, *leader = progress.history[-1]
        worth = Worth(*leader)
        say(line(("adam", "polish")[int(phase)], int(step), worth, program.places.name(int(worth.place))))
        if folder is not None:
            keep(program, progress, folder, identity)

    for _ in range(TIGHTENINGS):
        progress = optimiser.run(progress, report)
        verified = verify(problem, program.design(progress.best))
        if not np.isfinite(verified.violation) or verified.violation <= settings.tolerance:
            break
        excess = {name: MORE * max(0.0, fine) for name, (_, fine) in verified.violations.items()}
        say(f"between the samples constraints are violated by {verified.violation:.2e}: tightened")
        progress = optimiser.tighten(progress, program.places.spread(excess))
    else:
        progress = optimiser.run(progress, report)
        verified = verify(problem, program.design(progress.best))
    before = verify(problem, problem.space.start).designed
    z = program.design(progress.best)
    numbers = np.asarray(problem.space.numbers(jnp.asarray(z)))
    shaken = perturbed(problem, z, as_built(problem))
    progress.elapsed = time.perf_counter() - began
    if folder is not None:
        save_progress(progress, folder / PROGRESS, identity)
    return Design(problem, settings, numbers, check, progress, before, verified, shaken)


def line(phase: str, step: int, worth: Worth, constraint: str) -> str:
    """A line of progress; ``constraint`` is the one that is violated most, if one is."""
    violated = f"{max(worth.violation, 0.0):8.2e} {constraint if worth.violation > 0 else ''}"
    return (
        f"{phase:6} {step:4}  objective {worth.objective:12.6g}  gradient {worth.gradient:8.1e}  violation {violated}"
    ).rstrip()


def keep(program: Shooting, progress: Progress, folder: Path, identity: str) -> None:
    """Writes the progress and the best design so far."""
    folder.mkdir(parents=True, exist_ok=True)
    save_progress(progress, folder / PROGRESS, identity)
    space = program.problem.space
    numbers = np.asarray(space.numbers(jnp.asarray(program.design(progress.best))))
    with replacing(folder / SCENARIO) as beside:
        beside.write_text(tomli_w.dumps(space.document_of(numbers)), encoding="utf-8")
