"""The contract of constraints."""

import abc

from jaxtyping import Array, Float

from ..plane import Requirement
from ..run import Run


class AbstractConstraint(Requirement):
    """Signed violations, dimensionless: positive where violated, and at most 0 in a design that fulfils it.

    Lengths are in radii r, forces in weights M g, times in √(r/g).
    """

    @abc.abstractmethod
    def __call__(self, run: Run) -> Float[Array, "..."]:
        """The violation at each point or time at which it is evaluated."""


class AbstractRunningConstraint(AbstractConstraint):
    """A constraint on the state and the actuation at each time."""

    def margins(self, run: Run) -> Float[Array, "t ..."]:
        """A function that is nonnegative where the constraint holds, with second derivatives everywhere.

        Near the boundary it is minus the violation, to first order; by default, everywhere.
        """
        return -self(run)
