"""Conditions that parameters and initial states must meet, as values that can be traced.

For NumPy arrays they are computed by NumPy, and nothing is compiled.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..interface.wording import beyond_numbers
from ..numerics.arrays import AnyArray, namespace_of
from ..numerics.declare import FINITE, declarations

UNIT = 1e-6  # how far the square of a unit vector may be from 1


class Condition(NamedTuple):
    """A condition on one or several numbers: whether it holds, their names, their values, and what they must be.

    ``name`` is that of one number, however many entries it has; a tuple has one for each entry of ``holds``. Where the
    condition is on the kind of a part, ``value`` is that part.
    """

    holds: Bool[Array, "*several"]
    name: str | tuple[str, ...]
    value: Any
    must: str

    def problems(self) -> Iterator["Problem"]:
        """Yields a problem for each number that violates the condition, where numbers are known."""
        if isinstance(self.name, str):
            cases = [(self.holds, self.name, self.value)]
        else:
            cases = zip(self.holds, self.name, self.value, strict=True)
        for holds, name, value in cases:
            if not bool(holds):
                shown = np.asarray(value).tolist()
                yield Problem(name, f"be {self.must}", f"it is {shown}{beyond_numbers(shown)}")


class ExplainedCondition(NamedTuple):
    """A condition with a sentence of its own: whether it holds, and the problem where it is known not to."""

    holds: Any
    problem: "Callable[[], Problem]"

    def problems(self) -> Iterator["Problem"]:
        """Yields the problem if the condition is violated, where that is known."""
        if not bool(self.holds):
            yield self.problem()


class Problem(NamedTuple):
    """An impossible number: its name in Python, and, as clauses, what it must do and what it does."""

    name: str
    must: str
    but: str

    def sentence(self, kind: str = "Argument", name: str | None = None) -> str:
        """Describes the problem in a sentence, in which the number may have another name."""
        return f"{kind} `{self.name if name is None else name}` must {self.must}, but {self.but}."


def all_hold(conditions: Iterable[Condition | ExplainedCondition]) -> Bool[Array, ""]:
    """Returns whether all conditions hold; traceable."""
    holds = [jnp.all(c.holds) if c.holds.ndim else c.holds for c in conditions]
    return jnp.all(jnp.stack(holds)) if holds else jnp.asarray(True)


def positive(x: AnyArray) -> Any:
    """Returns whether every entry is positive and finite."""
    return ((x > 0) & namespace_of(x).isfinite(x)).all()


def on_numbers(item: Any, prefix: str) -> Iterator[Condition]:
    """Yields the condition on each number of an item whose field declares a rule, with the field's name after
    ``prefix``.

    Angles must be finite only: the limits on those that somebody writes are against degrees, and others may be beyond.
    """
    for name, declared in declarations(type(item)).items():
        value = getattr(item, name)
        if declared.rule is not None and value is not None:
            rule = FINITE if declared.rule.is_angle else declared.rule
            yield Condition(rule.holds(value), prefix + name, value, rule.words(declared.shape))


def real_inertia(d: Float[AnyArray, "3"]) -> Condition:
    """Returns the condition that three principal moments belong to some distribution of mass."""
    return Condition(
        namespace_of(d).all(2 * d <= d.sum() * (1 + 1e-6)),
        "inertia",
        d,
        "three moments of which none exceeds the sum of the other two, as in every real body",
    )


def unit(name: str, x: Float[Array, " size"]) -> Condition:
    """Returns the condition on a vector of an initial state that its length is 1."""
    must = "a versor, four numbers whose squares add up to 1" if x.size == 4 else "a unit vector"
    return Condition(jnp.abs(jnp.sum(x**2) - 1) < UNIT, name, x, must)
