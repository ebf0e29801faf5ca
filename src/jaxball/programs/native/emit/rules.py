"""The rules of the compiler: for each StableHLO operation a function that writes its computation.

A rule takes the function being compiled, the operation, and its operands; it returns the result, or a list of results.
"""

from collections.abc import Callable
from typing import TypeAlias

from .values import Array

# Of a Function, an Operation and a list of Arrays. The first is left open, because its module asks this one.
Rule: TypeAlias = Callable[..., Array | list[Array]]

RULES: dict[str, Rule] = {}


def rule(*names: str) -> Callable[[Rule], Rule]:
    """Registers a function as the rule of operations with these names."""

    def enter(function: Rule) -> Rule:
        RULES.update(dict.fromkeys(names, function))
        return function

    return enter


def short(name: str) -> str:
    """Returns an operation's name without its dialect."""
    return name.partition(".")[2]
