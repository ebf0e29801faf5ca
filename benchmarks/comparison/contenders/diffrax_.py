"""diffrax's own solvers and jaxball's, all by ``diffrax.diffeqsolve``, compiled as jaxball compiles its runs."""

import functools
import time
from collections.abc import Callable
from typing import NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxball.paper.reproduce.experiments import Counter, Field, counting
from jaxball.programs.users_functions import jit
from jaxball.simulation import solvers
from jaxball.simulation.solvers.multistep import controller_class

from ..problem import Form, Problem
from ..translate import jax_field, jax_parameters
from . import MAX_STEPS_OF_BENCH, Outcome, Program, Run, Work

METHODS: dict[str, diffrax.AbstractAdaptiveSolver] = {
    "Tsit5": diffrax.Tsit5(),
    "Dopri5": diffrax.Dopri5(),
    "Dopri8": diffrax.Dopri8(),
    "Kvaerno5": diffrax.Kvaerno5(),
    "Adams": solvers.Adams(),
    "Gauss": solvers.Gauss(stages=8, error=solvers.StepError()),
    "NDF": solvers.NDF(),
    "RadauIIA 3": solvers.RadauIIA(stages=3),
    "RadauIIA 5": solvers.RadauIIA(stages=5),
    "RadauIIA 7": solvers.RadauIIA(stages=7),
    "RadauIIA 7 fixed-point": solvers.RadauIIA(stages=7, root_finder=solvers.FixedPoint(), error=solvers.StepError()),
    "Trapezoidal": solvers.Trapezoidal(),
    "TRBDF2": solvers.TRBDF2(),
}
LOOSE = 1e-3
COUNTABLE = 10_000  # steps; each evaluation calls Python, and more would take minutes


class Ended(NamedTuple):
    """The results of a compiled solve.

    The final state, and the numbers of accepted and rejected steps, are one array: each that a program returns to
    Python takes microseconds.
    """

    numbers: Float[Array, " state_plus_two"]
    result: diffrax.RESULTS


Solve = Callable[[Array, Array], Ended]  # from the initial state and the tolerance


def program(method: str, problem: Problem) -> Program:
    """The problem in one of :data:`METHODS`, in jaxball's own form where the problem has one."""
    statement = _statement(problem)
    counter = Counter()

    def solve_with(field: Field, compiled: Callable[[Solve], Solve]) -> Solve:
        term = statement.term(jax.jit(field))
        return compiled(lambda initial, tolerance: _solve(METHODS[method], problem, term, initial, tolerance))

    solve, counted = solve_with(statement.field, jit), solve_with(counting(statement.field, counter), jax.jit)
    run = functools.partial(_Run, statement, solve, counted, counter)
    first, again = (_seconds(run(LOOSE)) for _ in range(2))
    return Program(max(first - again, 0.0), run)


class _Statement(NamedTuple):
    """A problem for diffrax: a field, its term, the initial state, and the conversion of the final state."""

    field: Field
    term: Callable[[Field], diffrax.AbstractTerm]
    initial: tuple[float, ...]
    final: Callable[[Float[np.ndarray, " state"]], Float[np.ndarray, " n"]]


def _statement(problem: Problem) -> _Statement:
    if problem.form is not None:
        form = problem.form()
        return _Statement(form.field, functools.partial(_term, form), form.initial, form.final)
    parameters = jax_parameters(problem)
    if problem.constraint is None:
        g = jax_field(problem.rates)
        return _Statement(lambda t, x, args: g(t, x, parameters(t)), diffrax.ODETerm, problem.initial, np.asarray)
    return _Statement(_dae_field(problem), lambda g: _mass_term(problem, g), problem.initial, np.asarray)


def _term(form: Form, field: Field) -> diffrax.AbstractTerm:
    if form.mass is None or form.choose is None:
        return diffrax.ODETerm(field)
    return solvers.SwitchingMassMatrixTerm(lambda t, x, args, component: field(t, x, component), form.mass, form.choose)


def _dae_field(problem: Problem) -> Field:
    """g(t, x, args) whose ``args`` is the index of the algebraic component."""
    rates, parameters, constraint = jax_field(problem.rates), jax_parameters(problem), problem.constraint
    assert constraint is not None

    def g(t, x, algebraic):
        return jnp.where(jnp.arange(x.size) == algebraic, constraint(x), rates(t, x, parameters(t)))

    return g


def _mass_term(problem: Problem, g: Field) -> diffrax.AbstractTerm:
    """One mass matrix for all times if the algebraic component is always the same one."""
    places = [piece.algebraic or 0 for piece in problem.pieces]
    if len(set(places)) == 1:
        place = places[0]
        mass = np.asarray(problem.mass(problem.pieces[0]))
        return solvers.MassMatrixTerm(lambda t, x, args: g(t, x, place), mass)
    indices = np.arange(len(problem.initial))

    def choose(t, x, args):
        chosen = jnp.asarray(places[0])
        for piece, later in zip(problem.pieces[1:], places[1:], strict=True):
            chosen = jnp.where(t >= piece.start, later, chosen)
        return chosen

    return solvers.SwitchingMassMatrixTerm(
        vector_field=lambda t, x, args, place: g(t, x, place),
        mass=lambda place: jnp.where(indices == place, 0.0, 1.0),
        choose=choose,
    )


def _solve(solver, problem: Problem, term, initial: Float[Array, " state"], tolerance: Float[Array, ""]) -> Ended:
    controller = controller_class(solver)(rtol=tolerance, atol=tolerance * problem.atol_over_rtol)
    if problem.kinks:
        controller = solvers.StepToKinks(controller, problem.kinks)
    solution = diffrax.diffeqsolve(
        term,
        solver,
        problem.start,
        problem.end,
        None,
        initial,
        stepsize_controller=controller,
        max_steps=MAX_STEPS_OF_BENCH,
        throw=False,
    )
    assert solution.ys is not None
    stats = solution.stats
    counts = jnp.stack([stats["num_accepted_steps"], stats["num_rejected_steps"]])
    return Ended(jnp.concatenate([solution.ys[-1], counts.astype(initial.dtype)]), solution.result)


class _Run(Run):
    def __init__(self, statement: _Statement, solve: Solve, counted: Solve, counter: Counter, tolerance: float):
        self._statement, self._solve, self._counted, self._counter = statement, solve, counted, counter
        self._arguments = jnp.asarray(statement.initial), jnp.asarray(tolerance)

    def solve(self) -> np.ndarray:
        return np.asarray(self._solve(*self._arguments).numbers)[:-2]

    def outcome(self) -> Outcome:
        """Evaluations are counted by a separate program, whose other results are not used."""
        ended = self._solve(*self._arguments)
        succeeded = bool(ended.result == diffrax.RESULTS.successful)
        failure = "" if succeeded else _sentence(ended.result)
        *x, steps, rejected = np.asarray(ended.numbers).tolist()
        steps, rejected = int(steps), int(rejected)
        evaluations = self._evaluations() if succeeded and steps + rejected <= COUNTABLE else None
        work = Work(steps=steps, rejected=rejected, evaluations=evaluations)
        return Outcome(self._statement.final(np.asarray(x)), failure, work)

    def _evaluations(self) -> int:
        before = self._counter.read()
        jax.block_until_ready(self._counted(*self._arguments))
        return self._counter.read() - before


def _sentence(result: diffrax.RESULTS) -> str:
    """The first sentence of diffrax's message, to follow a "because"."""
    first, _, _ = " ".join(diffrax.RESULTS[result].split()).partition(". ")
    return first[:1].lower() + first[1:].rstrip(".")


def _seconds(run: Run) -> float:
    start = time.perf_counter()
    run.solve()
    return time.perf_counter() - start
