"""Which results of a program depend on which of its operands, and programs of which only a part is computed.

A ``reversible_loop`` pulls back only what varies.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ...interface.compat import Literal, Program, argument, branches, function_of, inner_program, loop
from .steering import is_control


def varying(program: Program, constants: Sequence[bool], operands: Sequence[bool]) -> list[bool]:
    """Returns which results of a program have derivatives with respect to the ``constants`` and ``operands`` that vary.

    A result that has none may be said to have some, but not the other way round.
    """
    jaxpr = program.jaxpr
    vary = {variable for variable, does in zip(jaxpr.constvars, constants, strict=True) if does}
    vary |= {variable for variable, does in zip(jaxpr.invars, operands, strict=True) if does}

    def does(variable: Any) -> bool:
        return not isinstance(variable, Literal) and variable in vary

    for equation in jaxpr.eqns:
        operands_vary = list(map(does, equation.invars))
        if any(operands_vary):
            results = zip(equation.outvars, _of_equation(equation, operands_vary), strict=True)
            vary |= {variable for variable, varies in results if varies and _has_derivatives(variable)}
    return list(map(does, jaxpr.outvars))


def varying_in_loop(body: Program, constants: Sequence[bool], carried: Sequence[bool]) -> list[bool]:
    """Returns which of the arrays that a loop carries vary at its start or after any number of turns.

    - ``constants``: of the program ``body``; its operands are those carried.
    """
    lasts = list(carried)
    while True:
        after = varying(body, constants, lasts)
        following = [before or other for before, other in zip(lasts, after, strict=False)]
        if following == lasts:
            return lasts
        lasts = following


@jax.custom_jvp
def move_with(arrays: list[Array], others: Any) -> list[Array]:
    """Returns arrays that have tangents, of zeros if need be, where others have some.

    Of what begins to move within a loop, JAX then knows at once. Otherwise it would differentiate a step again and
    again, each time with what has moved in the last.
    """
    return arrays


@move_with.defjvp
def _differentiate_move(primals: Any, tangents: Any) -> tuple[list[Array], list[Array]]:
    return primals[0], tangents[0]


def evaluate_chosen(
    program: Program,
    constants: Sequence[Any],
    operands: Sequence[Any],
    which: Sequence[bool],
    instead: Callable[[Any, list[Any]], Sequence[Any] | None],
) -> list[Any]:
    """Computes the results of a program that are chosen by ``which``, and nothing else.

    - ``instead``: of an equation and its operands its results, if it is not to be carried out, and None otherwise.
    """
    jaxpr = program.jaxpr
    targets = [variable for variable, is_wanted in zip(jaxpr.outvars, which, strict=True) if is_wanted]
    values = dict(zip(jaxpr.constvars, constants, strict=True)) | dict(zip(jaxpr.invars, operands, strict=True))

    def read(variable: Any) -> Any:
        return variable.val if isinstance(variable, Literal) else values[variable]

    for equation in _find_needed(program, targets):
        inputs = list(map(read, equation.invars))
        results = instead(equation, inputs)
        if results is None:
            results = function_of(equation)(*inputs)
            results = results if equation.primitive.multiple_results else [results]
        values |= dict(zip(equation.outvars, results, strict=True))
    return list(map(read, targets))


def _of_equation(equation: Any, operands_vary: list[bool]) -> list[bool]:
    name, inner = equation.primitive.name, inner_program(equation)
    if name == "stop_gradient" or is_control(equation):
        return [False] * len(equation.outvars)
    if inner is not None:
        return varying(inner, _none(inner), operands_vary)
    if name == "cond":
        each = [varying(branch, _none(branch), operands_vary[1:]) for branch in branches(equation)]
        return [any(ways) for ways in zip(*each, strict=True)]
    if name == "while":
        first = argument(equation, "cond_nconsts")
        start, body = first + argument(equation, "body_nconsts"), argument(equation, "body_jaxpr")
        return _after_a_loop(body, operands_vary[first:start], operands_vary[start:], [])[: len(operands_vary) - start]
    if name == "scan":
        scan = loop(equation)
        carried = scan.constants + scan.carried
        return _after_a_loop(
            scan.body, operands_vary[: scan.constants], operands_vary[scan.constants : carried], operands_vary[carried:]
        )
    return [any(operands_vary)] * len(equation.outvars)


def _after_a_loop(body: Program, constants: list[bool], carried: list[bool], sequences: list[bool]) -> list[bool]:
    """Returns which results vary of a loop whose constants are the first operands of its body."""
    while True:
        after = varying(body, _none(body), [*constants, *carried, *sequences])
        following = [before or other for before, other in zip(carried, after, strict=False)]
        if following == carried:
            return [*carried, *after[len(carried) :]]
        carried = following


def _find_needed(program: Program, targets: Sequence[Any]) -> list[Any]:
    """Finds the equations that some variables of a program need."""
    needed, equations = {variable for variable in targets if not isinstance(variable, Literal)}, []
    for equation in reversed(program.jaxpr.eqns):
        if not needed.isdisjoint(equation.outvars):
            needed |= {variable for variable in equation.invars if not isinstance(variable, Literal)}
            equations.append(equation)
    return equations[::-1]


def _none(program: Program) -> list[bool]:
    return [False] * len(program.consts)


def _has_derivatives(variable: Any) -> bool:
    return jnp.issubdtype(variable.aval.dtype, jnp.inexact)
