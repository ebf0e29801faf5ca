"""A problem as its numbers and its form: problems that differ in numbers alone share compiled programs."""

import copy
import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ... import programs
from ...numerics.arrays import to_array
from ...programs.identity.names import home_of
from .problem import Errors, Problem
from .requirements import OfFunction
from .space import Bounds


class Content(NamedTuple):
    """The numbers of a problem.

    - ``values``: those of the document, that the variables do not set.
    - ``factors``, ``bounds``: of the variables.
    - ``times``: the save times of the scenario.
    - ``objectives``, ``constraints``: the arrays of each.
    - ``errors``: of the balls of a robust problem.
    """

    values: Float[Array, " others"]
    factors: Float[Array, " paths"]
    bounds: Bounds
    times: Float[Array, " T"]
    objectives: Any
    constraints: Any
    errors: Errors | None


class Form:
    """Everything about a problem except for its numbers: what makes the problem of them.

    Equal ones make problems of which the same programs are compiled.
    """

    follows = ("_example",)  # of which all but the numbers is in the key

    def __init__(self, example: Problem, key: Any):
        self._example, self._key = example, key

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Form) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    def __call__(self, content: Content) -> Problem:
        """The problem with these numbers, which may be traced."""
        problem, space = copy.copy(self._example), copy.copy(self._example.space)
        space.values_of_others, space.factors = content.values, content.factors
        space.bounds, space.times = Bounds(*content.bounds), content.times
        made = {
            "space": space,
            "objectives": eqx.combine(content.objectives, _rest(problem.objectives)),
            "constraints": eqx.combine(content.constraints, _rest(problem.constraints)),
            "errors": content.errors,
        }
        vars(problem).update(made)
        vars(problem)["weights"] = jnp.asarray([one.weight for one in problem.objectives.values()])
        return problem


class Alone(NamedTuple):
    """The form of something that shares its programs with nothing."""

    whole: Any

    def __call__(self, content: tuple[()]) -> Any:
        """The whole, of no numbers."""
        return self.whole


def split_problem(problem: Problem) -> tuple[Callable[[Any], Problem], Any]:
    """Splits a problem into its form and its numbers.

    A problem with objectives or constraints that are not jaxball's own is its own form: such classes may need to know
    their numbers.
    """
    requirements = dict(problem.objectives), dict(problem.constraints)
    own = all(map(_is_own, (*problem.objectives.values(), *problem.constraints.values())))
    key = _key(problem, requirements) if own else None
    if key is None:
        return Alone(problem), ()
    space = problem.space
    objectives, constraints = (eqx.filter(part, eqx.is_array) for part in requirements)
    bounds = Bounds(*(jnp.asarray(side) for side in space.bounds))
    times = to_array(space.scenario.times)
    content = Content(space.values_of_others, space.factors, bounds, times, objectives, constraints, problem.errors)
    return Form(problem, key), content


def _key(problem: Problem, requirements: tuple[dict[str, Any], dict[str, Any]]) -> Any:
    """What distinguishes the form of a problem from others; None where it cannot be compared."""
    space, scenario = problem.space, problem.space.scenario
    solve = scenario.solver, scenario.rtol, scenario.atol, scenario.max_steps
    layout = tuple(problem.layout.sizes.items()), problem.balls, problem.perturbations is None, scenario.times.size
    leaves, structure = jax.tree.flatten(_rest(requirements))
    system = jax.tree.structure((scenario.system, scenario.state))
    sizes = tuple(len(variable.paths) for variable in space.variables)
    key = space.outline.text, space.outline.paths, sizes, solve, layout, tuple(leaves), structure, system
    try:
        hash(key)
    except TypeError:
        return None
    return key


def _is_own(part: Any) -> bool:
    """Whether all classes of an objective or a constraint are jaxball's own, and it has no function of a user."""
    if not isinstance(part, eqx.Module):
        return True
    return (
        home_of(type(part)) is not None and not isinstance(part, OfFunction) and all(map(_is_own, vars(part).values()))
    )


def _rest(part: Any) -> Any:
    """All that is no array."""
    return eqx.filter(dict(part) if isinstance(part, dict) else part, eqx.is_array, inverse=True)


@functools.lru_cache(maxsize=32)
def program(function: Callable[..., Any], form: Callable[[Any], Any]) -> programs.Program:
    """``function``, compiled, applied to the object that a ``form`` makes from numbers, and to other arguments."""
    return programs.jit(functools.partial(_of_content, function, form))


def _of_content(function: Callable[..., Any], form: Callable[[Any], Any], content: Any, *others: Any) -> Any:
    return function(form(content), *others)
