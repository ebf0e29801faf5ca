"""Design variables: numbers of a scenario, by their paths."""

import dataclasses
import math
import re
from collections.abc import Mapping
from typing import Any

from ..scenario.paths import check_number, numbers_of
from .errors import DesignError


@dataclasses.dataclass(frozen=True)
class Variable:
    """A number that a design may change: free, bounded, or shared by several entries of the scenario.

    - ``paths``: the entries that it sets, as in ``masses[0].rail.radius``; the first has the number itself.
    - ``factors``: its factor at each path, such as -1 for an opposite pulse; 1 if not given.
    - ``lower``, ``upper``: its bounds, which it never passes.
    - ``scale``: the size of change to expect; derived from its dimension if not given.
    - ``start``: the value to start from; by default the number at the first path.

    **Raises:** :class:`DesignError` for a lower bound that is not below the upper one, for a scale that is not
    positive, and unless there is one factor for each path.

    **Example:**

    >>> from jaxball.design import Variable
    >>> pulses = ("masses[0].schedule.height", "masses[1].schedule.height")
    >>> variable = Variable(pulses, factors=(1.0, -1.0), lower=0.1)
    >>> variable.lower, variable.upper
    (0.1, inf)
    """

    paths: tuple[str, ...]
    lower: float = -math.inf
    upper: float = math.inf
    scale: float | None = None
    factors: tuple[float, ...] = ()
    start: float | None = None

    def __post_init__(self):
        if not self.factors:
            object.__setattr__(self, "factors", (1.0,) * len(self.paths))
        if len(self.factors) != len(self.paths) or not self.paths:
            raise DesignError(
                f"Variable `{self.name}` must have one factor for each of its {len(self.paths)} paths, but it has "
                f"{len(self.factors)}."
            )
        if not self.lower < self.upper:
            raise DesignError(
                f"Variable `{self.name}` must have a lower bound below its upper one, but they are {self.lower!r} and "
                f"{self.upper!r}."
            )
        if self.scale is not None and not 0 < self.scale < math.inf:
            raise DesignError(f"Variable `{self.name}` must have a positive scale, but it is {self.scale!r}.")

    @property
    def name(self) -> str:
        """The first path."""
        return self.paths[0] if self.paths else "?"


def expanded(variable: Variable, document: Mapping[str, Any]) -> list[Variable]:
    """The variables that one with ``[*]`` in its path stands for: one for each number whose path matches.

    **Raises:** :class:`DesignError` when no number matches, when such a variable has several paths, and
    :class:`~jaxball.ScenarioError` when a path names no number.
    """
    if "*" not in variable.name:
        for path in variable.paths:
            check_number(document, path)
        return [variable]
    if len(variable.paths) > 1:
        raise DesignError(f"Variable `{variable.name}` must have no other path, because it stands for many numbers.")
    pattern = re.escape(variable.name).replace(r"\*", r"\d+")
    paths = [path for path in numbers_of(document) if re.fullmatch(pattern, path)]
    if not paths:
        raise DesignError(f"Variable `{variable.name}` must match a number of the scenario, but none has such a path.")
    return [dataclasses.replace(variable, paths=(path,)) for path in paths]
