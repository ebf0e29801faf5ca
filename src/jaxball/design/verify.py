"""A finished design looked at again: by another solver, at a tighter tolerance, ten times as often, and perturbed."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..body import Disk
from ..scenario.solve import SOLVERS
from .problem import Evaluation, Problem, worst
from .run import RAIL_SAMPLES, Run, Solve, run_of

FINER = 10
TIGHTER, TIGHTEST = 1e-2, 1e-13
EXPLICIT = ("dopri5", "dopri8", "tsit5")


class Verified(NamedTuple):
    """What a design is worth by two means.

    - ``designed``: as the search saw it; ``finer``: by the other solver, between the samples as well.
    - ``solver``, ``rtol``: of the latter.
    - ``apart``: the largest distance between the two paths at the save times, in radii.
    """

    designed: Evaluation
    finer: Evaluation
    violations: dict[str, tuple[float, float]]
    solver: str
    rtol: float
    apart: float

    @property
    def violation(self) -> float:
        """The largest violation between the samples."""
        return worst([finer for _, finer in self.violations.values()])


def verify(problem: Problem, z: Float[np.ndarray, " n"]) -> Verified:
    """The design ``z`` evaluated with a solver of another family and on samples ten times as fine."""
    scenario = problem.space.scenario
    solver = "gauss16" if scenario.solver in EXPLICIT else "dopri8"
    rtol, atol = (max(TIGHTER * x, TIGHTEST) for x in (scenario.rtol, scenario.atol))
    other = Solve(SOLVERS[solver](), rtol, atol, 16 * scenario.max_steps)

    @jax.jit
    def both(z):
        candidate = problem.space.candidate(z)
        run = run_of(candidate, problem.solve())
        fine = run_of(candidate._replace(times=_finer(candidate.times)), other, FINER * RAIL_SAMPLES)
        apart = jnp.max(jnp.sqrt(jnp.sum((run.z - fine.z[::FINER]) ** 2, axis=-1))) / run.length
        first, second = problem.evaluate_run(run), problem.evaluate_run(fine)
        return first, second, apart, _worst(problem, run), _worst(problem, fine)

    designed, finer, apart, *worsts = jax.tree.map(np.asarray, both(jnp.asarray(z)))
    violations = {name: (float(worsts[0][name]), float(worsts[1][name])) for name in problem.constraints}
    return Verified(designed, finer, violations, solver, rtol, float(apart))


def _worst(problem: Problem, run: Run) -> dict[str, Float[jax.Array, ""]]:
    return {name: jnp.max(constraint(run), initial=-jnp.inf) for name, constraint in problem.constraints.items()}


def _finer(times: Float[jax.Array, " t"]) -> Float[jax.Array, " fine"]:
    """The save times with nine more between each two."""
    share = jnp.asarray(np.arange(FINER) / FINER, dtype=times.dtype)
    between = times[:-1, None] + jnp.diff(times)[:, None] * share[None]
    return jnp.concatenate([jnp.ravel(between), times[-1:]])


def perturbed(
    problem: Problem, z: Float[np.ndarray, " n"], count: int = 16, share: float = 0.01, seed: int = 0
) -> Evaluation:
    """The design as it may be built, ``count`` times: masses off by normal errors of ``share``, the shell's centre of
    mass by as much of the radius."""
    random = np.random.default_rng(seed)
    candidate = problem.space.candidate(jnp.asarray(z))
    system = candidate.system
    masses = [random.normal(size=(count, *group.mass.shape)) for group in system.groups]
    shell, offset = random.normal(size=count), random.normal(size=(count, 3))
    flat = isinstance(system, Disk)

    @jax.jit
    @jax.vmap
    def one(masses, shell, offset):
        shifts = offset.at[1].set(0.0) if flat else offset
        shell = (system.mass * (1 + share * shell), system.offset + share * system.radius * shifts)
        moved = eqx.tree_at(lambda s: (s.mass, s.offset), system, shell)
        if masses:
            others = [group.mass * (1 + share * x) for group, x in zip(system.groups, masses, strict=True)]
            moved = eqx.tree_at(lambda s: [group.mass for group in s.groups], moved, others)
        return problem.evaluate_run(run_of(candidate._replace(system=moved), problem.solve()))

    found = one([jnp.asarray(x) for x in masses], jnp.asarray(shell), jnp.asarray(offset))
    return jax.tree.map(np.asarray, found)
