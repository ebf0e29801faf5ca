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
from .objectives import AbstractObjective
from .perturbations import Perturbations, perturbed_system
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
    """

    space: DesignSpace
    objectives: Mapping[str, AbstractObjective]
    constraints: Mapping[str, AbstractConstraint]
    perturbations: Perturbations | None = None

    @functools.cached_property
    def weights(self) -> Float[np.ndarray, " objectives"]:
        """The weights of the objectives."""
        return np.asarray([float(objective.weight) for objective in self.objectives.values()])

    @functools.cached_property
    def sizes(self) -> tuple[int, ...]:
        """At how many places each constraint is evaluated, for one ball."""
        z = jax.ShapeDtypeStruct((self.space.size,), jnp.zeros(()).dtype)
        return tuple(shape.size for shape in jax.eval_shape(lambda z: self._of(self.run(z))[1], z))

    @functools.cached_property
    def shares(self) -> Float[np.ndarray, " places"]:
        """1 / the number of places of its constraint, for each place."""
        return self.at_places([1 / (size * self.balls) for size in self.sizes])

    @property
    def balls(self) -> int:
        """How many balls are looked at."""
        return 1 if self.perturbations is None else self.perturbations.count

    def at_places(self, values: Sequence[float]) -> Float[np.ndarray, " places"]:
        """A value for each constraint, at all its places."""
        return np.tile(np.repeat(np.asarray(values, dtype=float), self.sizes), self.balls)

    def solve(self, adjoint: diffrax.AbstractAdjoint | None = None) -> Solve:
        """How the scenario is solved."""
        scenario = self.space.scenario
        solver = SOLVERS[scenario.solver]()
        return Solve(solver, scenario.rtol, scenario.atol, scenario.max_steps, adjoint)

    def run(self, z: Float[Array, " n"], adjoint: diffrax.AbstractAdjoint | None = None) -> Run:
        """The run of a design."""
        return run_of(self.space.candidate(z), self.solve(adjoint), RAIL_SAMPLES)

    def evaluate(self, z: Float[Array, " n"], adjoint: diffrax.AbstractAdjoint | None = None) -> Evaluation:
        """All objectives and constraints of a design; JAX can trace it, differentiate it and vectorise it."""
        solve = self.solve(adjoint)
        return merged(self.of_each(self.space.candidate(z), lambda one: self.evaluate_run(run_of(one, solve))))

    def of_each(self, candidate: Candidate, function: Callable[[Candidate], Any]) -> Any:
        """What ``function`` finds of each ball, on a leading axis."""
        if self.perturbations is None:
            return jax.tree.map(lambda x: x[None], function(candidate))
        errors = self.perturbations.errors(candidate.system)
        system = candidate.system
        return jax.vmap(lambda one: function(candidate._replace(system=perturbed_system(system, one))))(errors)

    def evaluate_run(self, run: Run) -> Evaluation:
        """All objectives and constraints of a run."""
        terms, values = self._of(run)
        none = jnp.zeros((0,), dtype=run.times.dtype)
        return Evaluation(
            jnp.stack(terms) if terms else none,
            jnp.concatenate([jnp.ravel(value) for value in values]) if values else none,
            run.status,
        )

    def by_constraint(self, violations: Float[np.ndarray, " places"]) -> dict[str, Float[np.ndarray, " k"]]:
        """The violations of each constraint, by its name; of one ball, or of many."""
        if not self.sizes:
            return {}
        rows = np.reshape(np.asarray(violations), (-1, sum(self.sizes)))
        parts = np.split(rows, np.cumsum(self.sizes)[:-1], axis=1)
        return {name: np.ravel(part) for name, part in zip(self.constraints, parts, strict=True)}

    def _of(self, run: Run) -> tuple[list[Any], list[Any]]:
        return [one(run) for one in self.objectives.values()], [one(run) for one in self.constraints.values()]


def merged(each: Evaluation) -> Evaluation:
    """The evaluations of balls, on their leading axis, as one: means of the objectives, and all violations."""
    return Evaluation(jnp.mean(each.terms, axis=0), jnp.ravel(each.violations), jnp.max(each.status))


def worst(values: Sequence[float] | np.ndarray) -> float:
    """The largest violation; −∞ where there is none, and NaN where one is NaN."""
    values = np.asarray(values)
    return float(np.max(values)) if values.size else -np.inf
