"""A design evaluated again by other means, and its gradient checked against differences and forward mode."""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .... import programs
from ....files.scenario.solvers import SOLVERS
from ....interface.printing import repr_html
from ....programs.program import compile_quickly
from ..constraints import NormalForce
from ..objectives import FollowCurve, FollowTrajectory, ReachPlace
from ..problem.problem import Evaluation, Known, Perturbations, Problem, TracedProblem, merge, reveal, worst
from ..problem.run import RAIL_SAMPLES, Solve, run_of
from ..problem.space import Candidate, DesignError
from .optimise import Optimiser
from .program import AbstractTerms, Multipliers, augmented_lagrangian

FINER = 10  # samples within each step between save times, to find violations there
RECHECK_RATIO, TIGHTEST = 1e-2, 1e-13
TARGETS = (FollowCurve, FollowTrajectory, ReachPlace)
EXPLICIT = ("dopri5", "dopri8", "tsit5")
AS_BUILT = Perturbations(16, 0.01, 0.01)
# The number of balls, other than those it was designed for, on which a robust design is evaluated.
FRESH = 1000


class Verified(NamedTuple):
    """A design evaluated in two ways.

    - ``designed``: as in the search; ``finer``: by the other solver, between the samples as well.
    - ``solver``, ``rtol``: of the latter.
    - ``violations``: the largest of each constraint, at the samples, and between them as well.
    - ``apart``: the largest distance between the two paths at the save times, in radii.
    - ``margin``: the least normal force, over M g, between the samples as well.
    - ``missed``: how far each objective with a target misses it, in radii.
    """

    designed: Evaluation
    finer: Evaluation
    violations: dict[str, tuple[float, float]]
    solver: str
    rtol: float
    apart: float
    margin: float
    missed: dict[str, float]

    @property
    def violation(self) -> float:
        """The largest violation between the samples."""
        return worst([finer for _, finer in self.violations.values()])


@compile_quickly()
def verify(problem: Problem, y: Float[np.ndarray, " n"]) -> Verified:
    other, solver = _other_solve(problem)
    designed, finer, most = jax.tree.map(np.asarray, _compare(problem.pytree, other, problem.unknowns(y)))
    return Verified(
        designed=designed,
        finer=finer,
        violations={name: (float(coarse), float(fine)) for name, (coarse, fine) in most["violations"].items()},
        solver=solver,
        rtol=other.rtol,
        apart=float(most["apart"]),
        margin=-float(most["lift"]),
        missed={name: float(by) for name, by in most["missed"].items()},
    )


def _other_solve(problem: Problem) -> tuple[Solve, str]:
    """Returns a solver of another family at a tighter tolerance, and its name."""
    scenario = problem.space.scenario
    # A solver of another family makes other errors: agreement is evidence.
    solver = "gauss16" if scenario.solver in EXPLICIT else "dopri8"
    # Below `TIGHTEST` rounding prevents a solve from reaching its tolerance.
    rtol, atol = (max(RECHECK_RATIO * x, TIGHTEST) for x in (scenario.rtol, scenario.atol))
    # A tighter tolerance takes more steps.
    return Solve(SOLVERS[solver](), rtol, atol, 16 * scenario.max_steps, max_step=scenario.max_step), solver


@programs.filter_jit
def _compare(
    problem: TracedProblem, other: Solve, y: Float[Array, " n"]
) -> tuple[Evaluation, Evaluation, dict[str, Any]]:
    """Computes what :meth:`Problem.verify` finds; ``other`` is the second way to solve."""

    def of_ball(candidate: Candidate):
        run = run_of(candidate, problem.solve())
        # Rails get ten times the points as well, because constraints on them hold at points only.
        fine = run_of(candidate._replace(times=_finer(candidate.times)), other, FINER * RAIL_SAMPLES)
        # Every tenth of the finer times is one of the search's.
        apart = jnp.max(jnp.sqrt(jnp.sum((run.z - fine.z[::FINER]) ** 2, axis=-1))) / run.length
        missed = {
            name: objective.farthest(fine)
            for name, objective in problem.objectives.items()
            if isinstance(objective, TARGETS)
        }
        # With `least` 0 a violation is minus the normal force over the weight.
        lift = jnp.max(NormalForce(0.0)(fine))
        (first, coarse), (second, finer) = (problem.evaluate_each(solved) for solved in (run, fine))
        violations = {name: (_worst(coarse[name]), _worst(finer[name])) for name in problem.constraints}
        most = {"apart": apart, "violations": violations, "lift": lift, "missed": missed}
        return first, second, most

    first, second, most = problem.of_each(problem.space.candidate(y), of_ball)
    return merge(first), merge(second), jax.tree.map(lambda x: jnp.max(x, axis=0), most)


def _worst(violations: Float[Array, " places"]) -> Float[Array, ""]:
    return jnp.max(violations, initial=-jnp.inf)


def _finer(times: Float[jax.Array, " t"]) -> Float[jax.Array, " fine"]:
    """Returns the save times with nine more between each two."""
    share = jnp.asarray(np.arange(FINER) / FINER, dtype=times.dtype)
    between = times[:-1, None] + jnp.diff(times)[:, None] * share[None]
    return jnp.concatenate([jnp.ravel(between), times[-1:]])


@compile_quickly()
def perturbed(problem: Problem, y: Float[np.ndarray, " n"], perturbations: Perturbations | None = None) -> Evaluation:
    problem = dataclasses.replace(problem, perturbations=perturbations or AS_BUILT)
    return jax.tree.map(np.asarray, _each(problem.pytree, problem.unknowns(y)))


@programs.filter_jit
def _each(problem: TracedProblem, y: Float[Array, " n"]) -> Evaluation:
    """Evaluates all balls of a robust problem."""
    solve = problem.solve()
    return problem.of_each(problem.space.candidate(y), lambda ball: problem.evaluate_run(run_of(ball, solve)))


def as_built(problem: Problem) -> Perturbations:
    """Returns the balls on which a finished design is evaluated: for a robust problem, new random ones."""
    usual = problem.perturbations
    # Balls for which a robust design was optimised would say nothing about others.
    return AS_BUILT if usual is None else dataclasses.replace(usual, count=FRESH, seed=usual.seed + 1)


STEPS = tuple(10.0 ** -np.arange(1.0, 6.5, 0.5))
STENCIL = (-2.0, -1.0, 1.0, 2.0)
FIVE_POINTS = np.asarray([1.0, -8.0, 8.0, -1.0]) / 12
MODES_AGREE, DIFFERENCES_AGREE = 1e-5, 1e-3  # relative to the gradient's length


class GradientCheck(NamedTuple):
    """The derivative along one direction by several methods, relative to the length of the gradient.

    - ``gradient``: by the gradient that the search uses: in reverse mode, or in forward mode for Gauss–Newton.
    - ``forward``: in forward mode, along that direction only; None where differences were good enough without it.
    - ``steps``, ``differences``: by the five-point formula with each step.
    """

    gradient: float
    forward: float | None
    steps: tuple[float, ...]
    differences: tuple[float, ...]

    @property
    def between_modes(self) -> float | None:
        """|forward − gradient|, if known."""
        return None if self.forward is None else abs(self.forward - self.gradient)

    @property
    def from_differences(self) -> float:
        """The least |difference − gradient| over the steps, between truncation and rounding errors."""
        errors = np.abs(np.asarray(self.differences) - self.gradient)
        return float(np.min(errors[np.isfinite(errors)], initial=np.inf))

    @property
    def ok(self) -> bool:
        """Whether the gradient can be trusted."""
        modes_agree = self.between_modes is None or self.between_modes < MODES_AGREE
        return modes_agree and self.from_differences < DIFFERENCES_AGREE

    _repr_html_ = repr_html

    def __repr__(self) -> str:
        rows = [
            f"  step {h:8.1e}  error {abs(d - self.gradient):8.1e}"
            for h, d in zip(self.steps, self.differences, strict=True)
        ]
        modes = [] if self.between_modes is None else [f"  gradient against forward mode {self.between_modes:.1e}"]
        return "\n".join([*modes, *rows])


def check_gradient(
    optimiser: Optimiser,
    y: Float[np.ndarray, " n"],
    seed: int = 0,
    enough: float = 0.0,
    say: Callable[[str], None] = lambda line: None,
) -> GradientCheck:
    """Checks the derivative, along a random direction at ``y``, of a sum of all objectives and constraints.

    The sum is the augmented Lagrangian with multipliers so large that every point of every constraint counts.

    **Arguments:**

    - ``optimiser``: whose sum and gradient are checked.
    - ``y``: the unknowns of its program, shape (n,).
    - ``seed``: of the direction.
    - ``enough``: differences that agree to this need no forward mode, which would have to be compiled.
    - ``say``: called with a line before forward mode is compiled.

    **Raises:** :class:`DesignError` where ``y`` cannot be simulated or the gradient is not finite.
    """
    direction = np.random.default_rng(seed).normal(size=y.shape)
    direction /= np.linalg.norm(direction)
    first = optimiser.evaluate(y[None], optimiser.first_multipliers(1)).at
    violations = first.violations[0]
    if not (np.all(np.isfinite(violations)) and np.all(np.isfinite(first.terms[0]))):
        raise DesignError("The design at which the gradient is checked must be simulated to its end, but it is not.")
    # With ρ = 1, λ + c is then at least 1, also for a constraint that holds by far: no max(0, ·) is at its kink, and
    # every point of every constraint contributes to the sum that is differentiated.
    counted = 2 * np.maximum(0.0, -violations) + 1
    multipliers = Multipliers(counted, np.asarray(1.0), np.zeros(counted.size))
    # The first point is that of the gradient. All are evaluated together, by the program of the search itself.
    shifts = np.asarray([0.0, *(h * k for h in STEPS for k in STENCIL)])
    points = y[None] + shifts[:, None] * direction[None]
    repeated = jax.tree.map(lambda x: np.broadcast_to(x, (len(points), *x.shape)), multipliers)
    lagrangians = optimiser.evaluate(points, repeated)
    gradient = lagrangians.gradient[0]
    if not np.all(np.isfinite(gradient)):
        entries = zip(optimiser.program.names, np.isfinite(gradient), strict=True)
        names = dict.fromkeys(name for name, finite in entries if not finite)
        raise DesignError(
            f"The gradient at the start must be finite, but it is not for {', '.join(names)}; start elsewhere, or "
            "raise `max_steps`, of which a gradient may need more than its run."
        )
    # A gradient of 0 has no length to compare with.
    size = float(np.linalg.norm(gradient)) or 1.0
    differences = lagrangians.value[1:].reshape(len(STEPS), 4) @ FIVE_POINTS / np.asarray(STEPS)
    check = GradientCheck(float(gradient @ direction) / size, None, STEPS, tuple(float(d) for d in differences / size))
    if check.from_differences < enough:
        return check
    say(f"compiling a derivative in forward mode, because differences agree to {check.from_differences:.1e} only")
    with compile_quickly():
        arguments = jax.tree.map(jnp.asarray, (y, direction, multipliers))
        forward = float(_slope(optimiser.program.pytree, *arguments))
    return check._replace(forward=forward / size)


def require_good(check: GradientCheck) -> None:
    """Raises a :class:`DesignError` where the ``check`` of a gradient says that it cannot be trusted."""
    if not check.ok:
        raise DesignError(
            f"The gradient must agree with differences to {DIFFERENCES_AGREE:g} and with forward mode to "
            f"{MODES_AGREE:g}, but it is off by {check.from_differences:.1e} and {check.between_modes or 0.0:.1e}; "
            f"tighten `solve.rtol` and `solve.atol`, or start elsewhere.\n{check}"
        )


@programs.filter_jit
def _slope(terms: AbstractTerms | Known, y, direction, multipliers: Multipliers) -> Float[Array, ""]:
    """Computes the derivative of the augmented Lagrangian along a direction, in forward mode."""
    opened = reveal(terms)

    def value(y: Float[Array, " n"]) -> Float[Array, ""]:
        return augmented_lagrangian(opened, opened.evaluate(y, diffrax.ForwardMode()), multipliers)

    return jax.jvp(value, (y,), (direction,))[1]
