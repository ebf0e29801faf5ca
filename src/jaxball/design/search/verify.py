"""A finished design evaluated again: by another solver, at a tighter tolerance, ten times as often, and perturbed."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ...scenario.solvers import SOLVERS
from ..constraints import NormalForce
from ..objectives import FollowCurve, FollowTrajectory, ReachPlace
from ..problem.problem import Evaluation, Perturbations, Problem, merged, worst
from ..problem.run import RAIL_SAMPLES, Run, Solve, run_of
from ..problem.space import Candidate

FINER = 10
TIGHTER, TIGHTEST = 1e-2, 1e-13
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


def verify(problem: Problem, y: Float[np.ndarray, " n"]) -> Verified:
    """A design evaluated with a solver of another family and on samples ten times as fine.

    **Arguments:**

    - ``problem``: the problem with its objectives and constraints.
    - ``y``: the unknowns of the design, shape (n,).
    """
    other, solver = _other_solve(problem)
    designed, finer, most = jax.tree.map(np.asarray, _compared(problem)(jnp.asarray(y)))
    violations = {name: (float(most.coarse[name]), float(most.fine[name])) for name in problem.constraints}
    missed = {name: float(by) for name, by in most.missed.items()}
    return Verified(
        designed=designed,
        finer=finer,
        violations=violations,
        solver=solver,
        rtol=other.rtol,
        apart=float(most.apart),
        margin=-float(most.lift),
        missed=missed,
    )


class _Largest(NamedTuple):
    """The largest values over all balls: distances, violations, and minus the normal force."""

    apart: Float[jax.Array, "*balls"]
    coarse: dict[str, Float[jax.Array, "*balls"]]
    fine: dict[str, Float[jax.Array, "*balls"]]
    lift: Float[jax.Array, "*balls"]
    missed: dict[str, Float[jax.Array, "*balls"]]


def _other_solve(problem: Problem) -> tuple[Solve, str]:
    """A solver of another family at a tighter tolerance, and its name."""
    scenario = problem.space.scenario
    solver = "gauss16" if scenario.solver in EXPLICIT else "dopri8"
    rtol, atol = (max(TIGHTER * x, TIGHTEST) for x in (scenario.rtol, scenario.atol))
    return Solve(SOLVERS[solver](), rtol, atol, 16 * scenario.max_steps), solver


@functools.lru_cache(maxsize=8)
def _compared(problem: Problem) -> Callable[..., Any]:
    """What :func:`verify` computes, compiled once for a problem, which may be verified several times."""
    other, _ = _other_solve(problem)

    def of_ball(candidate: Candidate):
        run = run_of(candidate, problem.solve())
        fine = run_of(candidate._replace(times=_finer(candidate.times)), other, FINER * RAIL_SAMPLES)
        apart = jnp.max(jnp.sqrt(jnp.sum((run.z - fine.z[::FINER]) ** 2, axis=-1))) / run.length
        missed = {name: one.farthest(fine) for name, one in problem.objectives.items() if isinstance(one, TARGETS)}
        lift = jnp.max(NormalForce(0.0)(fine))
        most = _Largest(apart, _worst(problem, run), _worst(problem, fine), lift, missed)
        return problem.evaluate_run(run), problem.evaluate_run(fine), most

    @jax.jit
    def both(y):
        first, second, most = problem.of_each(problem.space.candidate(y), of_ball)
        return merged(first), merged(second), jax.tree.map(lambda x: jnp.max(x, axis=0), most)

    return both


def _worst(problem: Problem, run: Run) -> dict[str, Float[jax.Array, ""]]:
    return {name: jnp.max(constraint(run), initial=-jnp.inf) for name, constraint in problem.constraints.items()}


def _finer(times: Float[jax.Array, " t"]) -> Float[jax.Array, " fine"]:
    """The save times with nine more between each two."""
    share = jnp.asarray(np.arange(FINER) / FINER, dtype=times.dtype)
    between = times[:-1, None] + jnp.diff(times)[:, None] * share[None]
    return jnp.concatenate([jnp.ravel(between), times[-1:]])


def perturbed(problem: Problem, y: Float[np.ndarray, " n"], perturbations: Perturbations = AS_BUILT) -> Evaluation:
    """The design with manufacturing errors: each perturbed ball's objectives and violations, on a leading axis.

    **Arguments:**

    - ``problem``: the problem with its objectives and constraints.
    - ``y``: the unknowns of the design, shape (n,).
    - ``perturbations``: how the balls differ.
    """
    robust = dataclasses.replace(problem, perturbations=perturbations)

    @jax.jit
    def each(y):
        return robust.of_each(
            problem.space.candidate(y), lambda one: problem.evaluate_run(run_of(one, problem.solve()))
        )

    return jax.tree.map(np.asarray, each(jnp.asarray(y)))


def as_built(problem: Problem) -> Perturbations:
    """The balls on which a finished design is evaluated: for a robust problem, new random ones."""
    given = problem.perturbations
    return AS_BUILT if given is None else dataclasses.replace(given, count=FRESH, seed=given.seed + 1)
