"""The rules of the compiler: for each operation of StableHLO a function that says what it computes.

A rule is given the function that is being compiled, the operation, and its operands; it gives the result, or a list of
the results where there are several.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from .elements import Element

if TYPE_CHECKING:
    from .lowering import Function
    from .program import Operation
    from .values import Array

Rule = Callable[["Function", "Operation", "list[Array]"], "Array | list[Array]"]
Scalar = Callable[..., Element]

RULES: dict[str, Rule] = {}


def rule(*names: str) -> Callable[[Rule], Rule]:
    """Enters a function as the rule of operations of these names."""

    def enter(function: Rule) -> Rule:
        RULES.update(dict.fromkeys(names, function))
        return function

    return enter


def short(name: str) -> str:
    """An operation's name without its dialect."""
    return name.partition(".")[2]


__all__ = ["RULES", "Any", "Rule", "Scalar", "Sequence", "rule", "short"]
