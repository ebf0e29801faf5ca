"""A design problem: what may change, what is wanted, and what must hold."""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..scenario.solve import SOLVERS
from .constraints import AbstractConstraint
from .line import require_reach
from .objectives import AbstractObjective
from .perturbations import Errors, Perturbations, perturbed_system
from .places import Places
from .run import RAIL_SAMPLES, Run, Solve, run_of
from .space import Candidate, DesignSpace


class Evaluation(NamedTuple):
    """What a design is worth.

    - ``terms``: the objectives, each without its weight.
    - ``violations``: the signed violations of all constraints at all their places and times, one after the other, and
      of all balls of a robust problem.
    - ``status``: a :class:`~jaxball.Status`; where the solve failed, the numbers are NaN.
    """

    terms: Float[Array, "*batch objectives"]
    violations: Float[Array, "*batch places"]
    status: Int[Array, "*batch"]


@dataclasses.dataclass(frozen=True, eq=False)
class Problem:
    """Minimise Σ weight · objective over the designs of ``space`` that fulfil all ``constraints``.

    Between its save times, nothing is known of a run: the scenario's save times are the samples at which objectives
    and constraints are evaluated.

    With ``perturbations`` the problem is robust: its objectives are means over the perturbed balls, and its constraints
    must hold for each of them.

    **Arguments:**

    - ``objectives``, ``constraints``: by name.

    **Raises:** :class:`DesignError` for a disk that cannot meet an objective or a constraint.
    """

    space: DesignSpace
    objectives: Mapping[str, AbstractObjective]
    constraints: Mapping[str, AbstractConstraint]
    perturbations: Perturbations | None = None

    def __post_init__(self):
        require_reach(self.space.scenario.system, {**self.objectives, **self.constraints})

    @functools.cached_property
    def weights(self) -> Float[np.ndarray, " objectives"]:
        """The weights of the objectives."""
        return np.asarray([float(objective.weight) for objective in self.objectives.values()])

    @functools.cached_property
    def places(self) -> Places:
        """Where the constraints are evaluated."""
        z = jax.ShapeDtypeStruct((self.space.size,), jnp.zeros(()).dtype)
        shapes = jax.eval_shape(lambda z: self._of(self.run(z))[1], z)
        return Places({name: shape.size for name, shape in zip(self.constraints, shapes, strict=True)}, self.balls)

    @property
    def balls(self) -> int:
        """How many balls are looked at."""
        return 1 if self.perturbations is None else self.perturbations.count

    def solve(self, adjoint: diffrax.AbstractAdjoint | None = None) -> Solve:
        """How the scenario is solved."""
        scenario = self.space.scenario
        solver = SOLVERS[scenario.solver]()
        return Solve(solver, scenario.rtol, scenario.atol, scenario.max_steps, adjoint)

    def run(self, z: Float[Array, " n"], adjoint: diffrax.AbstractAdjoint | None = None) -> Run:
        """The run of a design."""
        return run_of(self.space.candidate(z), self.solve(adjoint), RAIL_SAMPLES)

    def of_each(self, candidate: Candidate, function: Callable[..., Any], *others: Float[Array, "balls ..."]) -> Any:
        """What ``function`` finds of each ball, and of its part of the others, on a leading axis."""
        if self.perturbations is None:
            return jax.tree.map(lambda x: x[None], function(candidate, *(x[0] for x in others)))
        system = candidate.system

        def one(errors: Errors, *others: Float[Array, "..."]) -> Any:
            return function(candidate._replace(system=perturbed_system(system, errors)), *others)

        return jax.vmap(one)(self.perturbations.errors(system), *others)

    def evaluate_run(self, run: Run) -> Evaluation:
        """All objectives and constraints of a run."""
        terms, values = self._of(run)
        none = jnp.zeros((0,), dtype=run.times.dtype)
        return Evaluation(
            jnp.stack(terms) if terms else none,
            jnp.concatenate([jnp.ravel(value) for value in values]) if values else none,
            run.status,
        )

    def _of(self, run: Run) -> tuple[list[Any], list[Any]]:
        return [one(run) for one in self.objectives.values()], [one(run) for one in self.constraints.values()]


def merged(each: Evaluation) -> Evaluation:
    """The evaluations of balls, on their leading axis, as one: means of the objectives, and all violations."""
    return Evaluation(jnp.mean(each.terms, axis=0), jnp.ravel(each.violations), jnp.max(each.status))


def worst(values: Sequence[float] | np.ndarray) -> float:
    """The largest violation; −∞ where there is none, and NaN where one is NaN."""
    values = np.asarray(values)
    return float(np.max(values)) if values.size else -np.inf
