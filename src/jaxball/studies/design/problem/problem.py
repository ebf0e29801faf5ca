"""A design problem: variables, objectives and constraints, also for slightly perturbed balls."""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .... import programs
from ....interface.arguments import require_count
from ....interface.names import leave_to
from ....numerics.arrays import Numbers, to_array
from ....physics.body import System
from ....physics.state import BallState, DiskState
from ....programs.batches import of_rows
from ....programs.identity.names import home_of
from .requirements import (
    AbstractConstraint,
    AbstractObjective,
    OfFunction,
    evaluate_objectives,
    require_possible,
    require_reachable,
)
from .run import RAIL_SAMPLES, Run, Solve, run_of
from .space import Candidate, DesignError, DesignSpace, Parametrisation

if TYPE_CHECKING:
    from ..search.design import Design
    from ..search.program import Settings
    from ..search.verify import Verified


class Errors(NamedTuple):
    """Relative errors of the shell's mass and of the point masses, group by group, and of the offset in radii."""

    shell: Float[Array, "*balls"]
    offset: Float[Array, "*balls 3"]
    masses: tuple[Float[Array, "*balls n"], ...]


@dataclasses.dataclass(frozen=True)
class Perturbations:
    """A set of perturbations of a given ball, uniformly distributed.

    - ``count``: the number of perturbed balls.
    - ``masses``: the largest relative error of each mass, including the shell's.
    - ``offset``: the largest error of each coordinate of the shell's centre of mass, in radii; for a disk, of those in
      its plane.
    - ``seed``: the seed of the random numbers.

    **Raises:** :class:`DesignError` for a count below 1, and for errors that are negative or so large that a mass may
    vanish.
    """

    count: int = 64
    masses: float = 0.02
    offset: float = 0.01
    seed: int = 0

    def __post_init__(self):
        if self.count < 1:
            raise DesignError(f"Argument `count` must be 1 or more, but it is {self.count}.")
        for name in ("masses", "offset"):
            if not 0 <= getattr(self, name) < 1:
                raise DesignError(f"Argument `{name}` must be at least 0 and below 1, but it is {getattr(self, name)}.")

    def errors(self, system: System) -> Errors:
        """Draws the errors of all balls, on a leading axis."""
        random, count = np.random.default_rng(self.seed), self.count
        groups = [random.uniform(-1, 1, (count, *group.mass.shape)) for group in system.groups]
        shell, offset = random.uniform(-1, 1, count), random.uniform(-1, 1, (count, 3))
        if system.planar:
            # The centre of mass stays in the plane of a disk; out of it, the disk would not roll along e1.
            offset[:, 1] = 0.0
        return Errors(
            jnp.asarray(self.masses * shell),
            jnp.asarray(self.offset * offset),
            tuple(jnp.asarray(self.masses * group) for group in groups),
        )


def perturb_system(system: System, errors: Errors) -> System:
    """Perturbs one system by its errors; traceable."""
    shell = (system.mass * (1 + errors.shell), system.offset + system.radius * errors.offset)
    masses = [group.mass * (1 + error) for group, error in zip(system.groups, errors.masses, strict=True)]
    system = eqx.tree_at(lambda s: (s.mass, s.offset), system, shell)
    return eqx.tree_at(lambda s: [group.mass for group in s.groups], system, masses) if masses else system


class Evaluation(NamedTuple):
    """The terms and constraints of a design.

    - ``terms``: the objectives, each without its weight.
    - ``violations``: the signed violations of all constraints at all their points and times, one after the other, and
      for all balls of a robust problem.
    - ``status``: a :class:`~jaxball.Status`; where the solve failed, the numbers are NaN.
    """

    terms: Float[Array, "*batch objectives"]
    violations: Float[Array, "*batch places"]
    status: Int[Array, "*batch"]


@dataclasses.dataclass(frozen=True)
class ConstraintLayout:
    """The layout of the violations of all constraints, at all their points and times, in one vector.

    One constraint comes after the other, and one ball after the other.

    - ``sizes``: at how many points each constraint is evaluated, for one ball.
    - ``balls``: how many balls there are.
    """

    sizes: Mapping[str, int]
    balls: int = 1

    @property
    def size(self) -> int:
        """The length of the vector."""
        return self._of_ball * self.balls

    @property
    def shares(self) -> Float[np.ndarray, " places"]:
        """1 / the number of points of its constraint, for each point."""
        # Without points a constraint has no share, and must not divide by 0.
        return self.spread({name: 1 / (size * self.balls) for name, size in self.sizes.items() if size})

    def spread(self, values: Mapping[str, float]) -> Float[np.ndarray, " places"]:
        """Returns a value for each constraint, 0 where none is given, at all its points."""
        each = np.asarray([values.get(name, 0.0) for name in self.sizes], dtype=float)
        return np.tile(np.repeat(each, self._lengths), self.balls)

    def by_constraint(self, violations: Float[np.ndarray, " places"]) -> dict[str, Float[np.ndarray, " k"]]:
        """Returns the violations of each constraint, by name; for one ball, or for any number."""
        rows = np.reshape(violations, (len(violations) // max(self._of_ball, 1), self._of_ball))
        # The last split is at the end of a row, and leaves an empty part.
        parts = np.split(rows, np.cumsum(self._lengths), axis=1)
        return {name: np.ravel(part) for name, part in zip(self.sizes, parts, strict=False)}

    def name(self, place: int) -> str:
        """Names the constraint at an index; none at −1."""
        # The vector repeats the layout of one ball for each ball.
        return str(np.repeat(list(self.sizes), self._lengths)[place % self._of_ball]) if place >= 0 else ""

    @property
    def _lengths(self) -> np.ndarray:
        return np.asarray(list(self.sizes.values()), dtype=int)

    @property
    def _of_ball(self) -> int:
        return sum(self.sizes.values())


class Known:
    """A value whose numbers programs know while they are traced: to a PyTree it has none."""

    def __init__(self, value: Any):
        self.value = value

    def __eq__(self, other: object) -> bool:
        # By identity: comparing users' objects could mean anything. The program that knows the value keeps it alive,
        # so that no other can take its address.
        return isinstance(other, Known) and self.value is other.value

    def __hash__(self) -> int:
        return hash((Known, id(self.value)))


def reveal(value: Any) -> Any:
    """Returns the value itself, known or traced."""
    return value.value if isinstance(value, Known) else value


class TracedProblem(eqx.Module):
    """A :class:`Problem` as a PyTree of its numbers; those that differ in numbers alone share compiled programs.

    Requirements of users' classes are :class:`Known`: such classes may need to know their numbers.

    - ``space``: the scenario as a function of the variables.
    - ``requirements``: the objectives, and then the constraints, each with its name in ``names``.
    - ``errors``: of the balls of a robust problem, or None.
    - ``method``: how the scenario is solved.
    - ``sizes``: at how many points each constraint is evaluated, for one ball.
    - ``balls``: how many balls there are.
    """

    space: Parametrisation
    requirements: tuple[Any, ...]
    errors: Errors | None
    names: tuple[str, ...] = eqx.field(static=True)
    method: Solve = eqx.field(static=True)
    sizes: tuple[int, ...] = eqx.field(static=True)
    balls: int = eqx.field(static=True)

    @property
    def objectives(self) -> dict[str, AbstractObjective]:
        """The objectives, by name."""
        return self._take_by_name(slice(None, self._first_constraint))

    @property
    def constraints(self) -> dict[str, AbstractConstraint]:
        """The constraints, by name."""
        return self._take_by_name(slice(self._first_constraint, None))

    @property
    def weights(self) -> Float[Array, " objectives"]:
        """The weights of the objectives."""
        return jnp.asarray([objective.weight for objective in self.objectives.values()])

    @property
    def layout(self) -> ConstraintLayout:
        """Where the constraints are evaluated."""
        return ConstraintLayout(dict(zip(self.constraints, self.sizes, strict=True)), self.balls)

    def solve(self, adjoint: diffrax.AbstractAdjoint | None = None) -> Solve:
        """Describes how the scenario is solved, and how that is differentiated."""
        return self.method._replace(adjoint=adjoint)

    def run(self, y: Float[Array, " n"], adjoint: diffrax.AbstractAdjoint | None = None) -> Run:
        """Simulates the run of a design, by its unknowns."""
        return run_of(self.space.candidate(y), self.solve(adjoint), RAIL_SAMPLES)

    def of_each(self, candidate: Candidate, function: Callable[..., Any], *others: Float[Array, "balls ..."]) -> Any:
        """Evaluates ``function`` for each ball and the corresponding other arguments, on a leading axis."""
        # A leading axis also for one ball, so that everything after this is the same for both kinds of problems.
        if self.errors is None:
            return jax.tree.map(lambda x: x[None], function(candidate, *(x[0] for x in others)))
        system = candidate.system

        def one(errors: Errors, *others: Float[Array, "..."]) -> Any:
            return function(candidate._replace(system=perturb_system(system, errors)), *others)

        return of_rows(one, self.errors, *others)

    def evaluate_run(self, run: Run) -> Evaluation:
        """Evaluates all objectives and constraints of a run."""
        return self.evaluate_each(run)[0]

    def evaluate_each(self, run: Run) -> tuple[Evaluation, dict[str, Float[Array, " places"]]]:
        """Evaluates all objectives and constraints of a run, and returns the violations of each constraint too."""
        terms = evaluate_objectives(self.objectives.values(), run)
        violations = {name: jnp.ravel(requirement(run)) for name, requirement in self.constraints.items()}
        none = jnp.zeros((0,), dtype=run.times.dtype)
        evaluation = Evaluation(
            jnp.stack(terms) if terms else none,
            jnp.concatenate(list(violations.values())) if violations else none,
            run.status,
        )
        return evaluation, violations

    @property
    def _first_constraint(self) -> int:
        return len(self.requirements) - len(self.sizes)

    def _take_by_name(self, which: slice) -> dict[str, Any]:
        return dict(zip(self.names[which], map(reveal, self.requirements[which]), strict=True))


@dataclasses.dataclass(frozen=True, eq=False)
class Problem:
    """Minimise Σ weight · objective over the designs of ``space`` that fulfil all ``constraints``.

    Objectives and constraints are evaluated only at the scenario's save times; between them, means over a run are those
    of polynomials through six values.

    With ``perturbations`` the problem is robust: its objectives are means over the perturbed balls, and its constraints
    must hold for each of them.

    **Arguments:**

    - ``objectives``, ``constraints``: by name.
    - ``perturbations``: perturbed balls for which the design must work as well; none if not given.

    **Raises:** :class:`DesignError` for an objective or a constraint that a disk cannot meet.
    """

    space: DesignSpace
    objectives: Mapping[str, AbstractObjective]
    constraints: Mapping[str, AbstractConstraint]
    perturbations: Perturbations | None = None

    def __post_init__(self):
        requirements = {**self.objectives, **self.constraints}
        require_reachable(self.space.system, requirements)
        # A radius that the search may change is not known here.
        if "body.radius" not in self.space.names:
            require_possible(float(self.space.system.radius), requirements)

    @functools.cached_property
    def weights(self) -> Float[np.ndarray, " objectives"]:
        """The weights of the objectives."""
        return np.asarray([float(objective.weight) for objective in self.objectives.values()])

    @functools.cached_property
    def layout(self) -> ConstraintLayout:
        """Where the constraints are evaluated."""
        # A tuple, because JAX would return a dictionary in the order of its keys, and violations are in that of ours.
        constraints, times = tuple(self.constraints.values()), to_array(self.space.scenario.times)
        sizes = _sizes(constraints, self.space.system, self.space.placed, times, self.space.scenario.may_slip)
        return ConstraintLayout(dict(zip(self.constraints, map(int, sizes), strict=True)), self.balls)

    @functools.cached_property
    def errors(self) -> Errors | None:
        """Those of the balls of a robust problem."""
        if self.perturbations is None:
            return None
        # Errors are cached: made within a trace they would be tracers, useless after it.
        with jax.ensure_compile_time_eval():
            return self.perturbations.errors(self.space.system)

    @property
    def balls(self) -> int:
        """How many balls there are: one, or those of a robust problem."""
        return 1 if self.perturbations is None else self.perturbations.count

    @functools.cached_property
    def pytree(self) -> TracedProblem:
        """The problem as compiled programs take it."""
        requirements = {**self.objectives}, {**self.constraints}
        return TracedProblem(
            space=self.space.parametrisation,
            requirements=tuple(
                requirement if _is_own(requirement) else Known(requirement)
                for part in requirements
                for requirement in part.values()
            ),
            errors=self.errors,
            names=tuple(name for part in requirements for name in part),
            method=Solve.of(self.space.scenario),
            sizes=tuple(self.layout.sizes.values()),
            balls=self.balls,
        )

    def run(self, y: Float[Array, " n"], adjoint: diffrax.AbstractAdjoint | None = None) -> Run:
        """Simulates the run of a design, by its unknowns."""
        return self.pytree.run(self.unknowns(y), adjoint)

    def evaluate_run(self, run: Run) -> Evaluation:
        """Evaluates all objectives and constraints of a run."""
        return self.pytree.evaluate_run(run)

    def unknowns(self, y: Numbers) -> Float[Array, " n"]:
        """Converts the unknowns of a design to an array.

        **Raises:** ``ValueError`` unless there is one for each variable.
        """
        unknowns = to_array(y, "y")
        require_count("Argument `y`", unknowns.shape, self.space.size, "variable")
        return unknowns

    # What can be done with a problem is found there. These need modules built upon this one.

    @leave_to("..search.design")
    def optimise(
        self,
        settings: "Settings | None" = None,
        folder: str | Path | None = None,
        *,
        say: Callable[[str], None] = lambda line: None,
    ) -> "Design":
        """Returns the best design that a search finds.

        **Arguments:**

        - ``settings``: those of the search; the defaults if not given.
        - ``folder``: where the progress and the best design so far are saved, each time they change; a search that was
          stopped is resumed from there. Nothing is saved if not given.
        - ``say``: called with each line of progress, and with one at the beginning of each stage, which says what is
          waited for.

        **Raises:** :class:`DesignError` where the gradient is wrong, no start can be simulated, or ``folder`` has the
        progress of another problem or of other settings; :class:`~jaxball.files.results.OutputError` where it is no
        folder.
        """
        raise NotImplementedError

    @leave_to("..search.verify")
    def verify(self, y: Float[np.ndarray, " n"]) -> "Verified":
        """Evaluates the design with the unknowns ``y``, shape (n,), by other means.

        They are a solver of another family and samples ten times as fine.
        """
        raise NotImplementedError

    @leave_to("..search.verify")
    def perturbed(self, y: Float[np.ndarray, " n"], perturbations: Perturbations | None = None) -> Evaluation:
        """Evaluates the design with manufacturing errors: each perturbed ball's objectives and violations, on a leading
        axis.

        **Arguments:**

        - ``y``: the unknowns of the design, shape (n,).
        - ``perturbations``: how the balls differ.
        """
        raise NotImplementedError


def _is_own(part: Any) -> bool:
    """Returns whether all classes of an objective or a constraint are jaxball's own, and it has no function
    of a user.
    """
    if not isinstance(part, eqx.Module):
        return True
    return (
        home_of(type(part)) is not None and not isinstance(part, OfFunction) and all(map(_is_own, vars(part).values()))
    )


@programs.filter_jit
def _sizes(
    constraints: tuple[AbstractConstraint, ...],
    system: System,
    state: BallState | DiskState,
    times: Float[Array, " T"],
    may_slip: bool,
) -> tuple[int, ...]:
    """Counts the points at which each constraint of a run is evaluated, without a simulation."""
    # Only shapes are wanted, so that the states need not be those of a run.
    states = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (times.size, *leaf.shape)), state)
    run = Run(system, times, states, jnp.zeros((), dtype=int), RAIL_SAMPLES, may_slip)
    shapes = eqx.filter_eval_shape(lambda run: tuple(constraint(run) for constraint in constraints), run)
    return tuple(shape.size for shape in shapes)


def merge(each: Evaluation) -> Evaluation:
    """Merges the evaluations of balls, on their leading axis: means of the objectives, and all violations."""
    return Evaluation(jnp.mean(each.terms, axis=0), jnp.ravel(each.violations), jnp.max(each.status))


def worst(values: Sequence[float] | np.ndarray) -> float:
    """Returns the largest violation; −∞ without constraints, and NaN where one is NaN."""
    values = np.asarray(values)
    return float(np.max(values)) if values.size else -np.inf
