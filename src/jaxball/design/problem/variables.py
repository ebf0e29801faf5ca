"""Design variables: numbers of a scenario, by their paths, with scales and bounds."""

import dataclasses
import math
import re
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...physics.body import System
from ...scenario import ScenarioError
from ...scenario.paths import check_number, numbers_of
from ...scenario.values import Dimension

# A start on a bound, from which it could not move away, is moved inside by this fraction of its scale.
INSIDE = 1e-3


class DesignError(ScenarioError):
    """A design problem cannot be posed, or cannot be resumed; the message is one sentence that says which."""


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


def default_scale(dimension: Dimension | None, value: float, system: System) -> float:
    """The scale of a number of this ``dimension``; its own magnitude, or 1, if its key declares none.

    Lengths are measured in radii r of the shell, times in √(r/g), and angles in radians.
    """
    if dimension is None:
        return abs(value) or 1.0
    r, g = float(system.radius), abs(float(system.gravity))
    time = math.sqrt(r / g) if g > 0 else 1.0
    return r**dimension.length * time**dimension.time


class Bounds(NamedTuple):
    """The lower and upper bounds of n numbers, infinite where there are none, and their scales.

    Within them the numbers are functions of unbounded ones, after MINUIT: an optimum on a bound is an interior
    stationary point of the unbounded variable, at which the Hessian is definite, so that it is nothing special to a
    quasi-Newton method (James & Roos, Comput. Phys. Commun. 10 (1975) 343).

    **Arguments:**

    - ``lower``, ``upper``, ``scale``: one entry for each number, shape (n,).

    **Example:**

    >>> import jax.numpy as jnp
    >>> import numpy as np
    >>> from jaxball.design import Bounds
    >>> bounds = Bounds(lower=np.array([0.0]), upper=np.array([2.0]), scale=np.array([1.0]))
    >>> print(bounds.numbers(jnp.array([-jnp.pi / 2])), bounds.numbers(jnp.array([0.0])))
    [0.] [1.]
    """

    lower: Float[np.ndarray, " n"]
    upper: Float[np.ndarray, " n"]
    scale: Float[np.ndarray, " n"]

    def numbers(self, y: Float[Array, " n"]) -> Float[Array, " n"]:
        """The numbers of unbounded variables: scale y, scale (√(1 + y²) − 1) from one bound, or a sine between two."""
        low, high = (jnp.asarray(x, dtype=y.dtype) for x in self._finite())
        scale = jnp.asarray(self.scale, dtype=y.dtype)
        away = scale * (jnp.sqrt(1 + y**2) - 1)
        middle, half = (low + high) / 2, (high - low) / 2
        both = middle + half * jnp.sin(scale * y / jnp.where(half > 0, half, 1.0))
        below, above = np.isfinite(self.lower), np.isfinite(self.upper)
        return jnp.where(below & above, both, jnp.where(below, low + away, jnp.where(above, high - away, scale * y)))

    def variables(self, x: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """The unbounded variables of numbers; those on a bound are moved slightly inside."""
        below, above = np.isfinite(self.lower), np.isfinite(self.upper)
        low, high = self._finite()
        half = np.where(below & above, (high - low) / 2, 1.0)
        inside = INSIDE * np.where(below & above, np.minimum(self.scale, half), self.scale)
        x = np.where(below, np.maximum(x, low + inside), x)
        x = np.where(above, np.minimum(x, high - inside), x)
        away = np.where(below, x - low, high - x) / self.scale
        one = np.sqrt((1 + np.where(below ^ above, away, 0.0)) ** 2 - 1)
        both = half / self.scale * np.arcsin(np.clip((x - (low + high) / 2) / half, -1, 1))
        return np.where(below & above, both, np.where(below ^ above, one, x / self.scale))

    def _finite(self) -> tuple[np.ndarray, np.ndarray]:
        """The bounds, 0 where there is none."""
        return tuple(np.where(np.isfinite(x), x, 0.0) for x in (self.lower, self.upper))  # pyright: ignore[reportReturnType]
