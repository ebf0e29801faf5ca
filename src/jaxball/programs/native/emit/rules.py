"""The rules of the compiler: for each StableHLO operation a function that writes its computation.

A rule takes the function being compiled, the operation, and its operands; it returns the result, or a list of results.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..ir.program import Operation
    from .lowering import Function
    from .values import Array

Rule = Callable[["Function", "Operation", "list[Array]"], "Array | list[Array]"]

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
