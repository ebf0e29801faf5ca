"""Which results of a program change, to first order, with which of its operands."""

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp

from ..compat import Literal, Program, argument, branches, called, loop


def varying(program: Program, constants: Sequence[bool], operands: Sequence[bool]) -> list[bool]:
    """Which results of a program change with its ``constants`` and ``operands`` that vary.

    A result that does not may be said to, but not the other way round.
    """
    jaxpr = program.jaxpr
    vary = {variable for variable, does in zip(jaxpr.constvars, constants, strict=True) if does}
    vary |= {variable for variable, does in zip(jaxpr.invars, operands, strict=True) if does}

    def read(variable: Any) -> bool:
        return not isinstance(variable, Literal) and variable in vary

    for equation in jaxpr.eqns:
        given = [read(variable) for variable in equation.invars]
        if any(given):
            results = zip(equation.outvars, _equation(equation, given), strict=True)
            vary |= {variable for variable, does in results if does and _has_derivatives(variable)}
    return [read(variable) for variable in jaxpr.outvars]


def _equation(equation: Any, given: list[bool]) -> list[bool]:
    name, inner = equation.primitive.name, called(equation)
    if name == "stop_gradient":
        return [False]
    if inner is not None:
        return varying(inner, [False] * len(inner.consts), given)
    if name == "cond":
        each = [varying(branch, [False] * len(branch.consts), given[1:]) for branch in branches(equation)]
        return [any(ways) for ways in zip(*each, strict=True)]
    if name == "while":
        first = argument(equation, "cond_nconsts")
        start = first + argument(equation, "body_nconsts")
        return lasting(argument(equation, "body_jaxpr"), given[first:start], given[start:])
    if name == "scan":
        scan = loop(equation)
        sequences = given[scan.constants + scan.carried :]
        carried = given[scan.constants : scan.constants + scan.carried]
        lasts = lasting(scan.body, given[: scan.constants], carried, sequences)
        return varying(scan.body, [False] * len(scan.body.consts), [*given[: scan.constants], *lasts, *sequences])
    return [any(given)] * len(equation.outvars)


def lasting(
    body: Program, constants: Sequence[bool], carried: Sequence[bool], sequences: Sequence[bool] = ()
) -> list[bool]:
    """Which of the arrays that a loop carries vary at its start or after any number of steps."""
    lasts = list(carried)
    while True:
        results = varying(body, [False] * len(body.consts), [*constants, *lasts, *sequences])
        following = [before or after for before, after in zip(lasts, results, strict=False)]
        if following == lasts:
            return lasts
        lasts = following


def _has_derivatives(variable: Any) -> bool:
    return jnp.issubdtype(variable.aval.dtype, jnp.inexact)
