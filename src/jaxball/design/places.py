"""How the violations of all constraints, at all their places and times, lie in one vector."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float


@dataclasses.dataclass(frozen=True)
class Places:
    """Where constraints are evaluated: one constraint after the other, and one ball after the other.

    - ``sizes``: at how many places each constraint is, for one ball.
    - ``balls``: how many balls there are.
    """

    sizes: Mapping[str, int]
    balls: int = 1

    @property
    def size(self) -> int:
        """The length of the vector."""
        return self._of_ball * self.balls

    @property
    def shares(self) -> Float[np.ndarray, " places"]:
        """1 / the number of places of its constraint, for each place."""
        return self.spread({name: 1 / (size * self.balls) for name, size in self.sizes.items() if size})

    def spread(self, values: Mapping[str, float]) -> Float[np.ndarray, " places"]:
        """A value for each constraint, 0 where none is given, at all its places."""
        each = np.asarray([values.get(name, 0.0) for name in self.sizes], dtype=float)
        return np.tile(np.repeat(each, self._lengths), self.balls)

    def by_constraint(self, violations: Float[np.ndarray, " places"]) -> dict[str, Float[np.ndarray, " k"]]:
        """The violations of each constraint, by its name; of one ball, or of any number."""
        rows = np.reshape(violations, (len(violations) // max(self._of_ball, 1), self._of_ball))
        parts = np.split(rows, np.cumsum(self._lengths), axis=1)
        return {name: np.ravel(part) for name, part in zip(self.sizes, parts, strict=False)}

    def name(self, place: int) -> str:
        """The constraint at a place; none at −1."""
        return str(np.repeat(list(self.sizes), self._lengths)[place % self._of_ball]) if place >= 0 else ""

    @property
    def _lengths(self) -> np.ndarray:
        return np.asarray(list(self.sizes.values()), dtype=int)

    @property
    def _of_ball(self) -> int:
        return sum(self.sizes.values())
