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
    """A number that a design may change: free, bounded, or shared by several places of the scenario.

    - ``paths``: where it stands, as in ``masses[0].rail.radius``; the first place has the number itself.
    - ``factors``: what it is multiplied by at each path, such as -1 for an opposite pulse; 1 if not given.
    - ``lower``, ``upper``: its bounds, which it never passes.
    - ``scale``: by how much it is expected to change; from its dimension if not given.
    - ``start``: where to start; what stands at the first path if not given.

    **Raises:** :class:`DesignError` for bounds that leave no room, for a scale that is not positive, and for another
    number of factors than of paths.

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
    """The variables that one with ``[*]`` in its path stands for: each number whose path fits.

    **Raises:** :class:`DesignError` when no number fits, when such a variable has several paths, and
    :class:`~jaxball.ScenarioError` when a path names no number.
    """
    if "*" not in variable.name:
        for path in variable.paths:
            check_number(document, path)
        return [variable]
    if len(variable.paths) > 1:
        raise DesignError(f"Variable `{variable.name}` must have no other path beside it, because it is many numbers.")
    pattern = re.escape(variable.name).replace(r"\*", r"\d+")
    paths = [path for path in numbers_of(document) if re.fullmatch(pattern, path)]
    if not paths:
        raise DesignError(f"Variable `{variable.name}` must fit a number of the scenario, but none has such a path.")
    return [dataclasses.replace(variable, paths=(path,)) for path in paths]
